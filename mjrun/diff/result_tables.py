"""Tables that mjrun makes of many simulations: the points of a study, and the episodes of an evaluation."""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mjrun.errors import MjrunError
from mjrun.formats.input_file import is_file, is_folder
from mjrun.formats.table_reader import open_table
from mjrun.formats.tables import input_format

STUDY, EPISODES = "results", "episodes"  # kinds, which are the stems of the files
SUFFIXES = (".parquet", ".csv")
POINT, EPISODE, POLICY, SEED, STATUS = "point", "episode", "policy", "seed", "status"
# The columns of each kind, by which it is recognised.
COLUMNS = {
    STUDY: (POINT, STATUS, "steps", "exit_code", "message"),
    EPISODES: (EPISODE, SEED, "return", "length", "steps", "ending", "outcome"),
}


@dataclass(frozen=True)
class ResultTable:
    """A table of results.

    Attributes:
      kind: one of `COLUMNS`.
      keys: columns of which a row's key may be made, and of a study its metrics.
    """

    kind: str
    keys: Sequence[str]

    @classmethod
    def of(cls, names: Sequence[str]) -> "ResultTable | None":
        """The table with columns of these names; None if it is another kind of table."""
        if names[:1] == [POINT] and {*COLUMNS[STUDY]} <= {*names}:
            return cls(STUDY, names[: names.index(STATUS)])
        if {*COLUMNS[EPISODES]} <= {*names}:
            return cls(EPISODES, names[: names.index(SEED) + 1])
        return None

    def common_key(
        self, other: "ResultTable", manifests: Sequence[Mapping[str, Any] | None]
    ) -> tuple[Sequence[str], Sequence[str]]:
        """The columns that identify a row in both tables, and the numbers of rows, which mean nothing then."""
        both = [name for name in self.keys if name in other.keys]
        if self.kind == EPISODES:
            return [name for name in both if name not in (POINT, EPISODE)], (POINT, EPISODE)
        metrics = [manifest["metrics"] for manifest in manifests if manifest and "metrics" in manifest]
        parameters = [name for name in both if name != POINT and not any(name in each for each in metrics)]
        if not metrics or not parameters:  # which are which is not known, or nothing varies
            return [POINT], ()
        return parameters, (POINT,)


def table_path(path: str) -> str:
    """The table in the folder of a study or an evaluation; any other path unchanged."""
    return next(map(str, _tables(Path(path))), path) if is_folder(Path(path)) else path


def is_results(folder: Path) -> bool:
    """Whether a folder is that of a study or an evaluation, and has a table."""
    return bool(_tables(folder))


def result_manifest(path: Path) -> Mapping[str, Any] | None:
    """The manifest of a .csv of results, which is in the table beside it."""
    beside = path.with_suffix(SUFFIXES[0])
    if path.stem not in COLUMNS or path.suffix != SUFFIXES[1] or not is_file(beside):
        return None
    with contextlib.suppress(MjrunError), open_table(beside, lambda name: False) as table:
        return table.manifest
    return None


def _tables(folder: Path) -> list[Path]:
    """The tables in a folder that can be read here, the best first."""
    paths = [folder / f"{kind}{suffix}" for kind in COLUMNS for suffix in SUFFIXES]
    return [path for path in paths if is_file(path) and _is_readable(path)]


def _is_readable(path: Path) -> bool:
    with contextlib.suppress(MjrunError):
        input_format(path)
        return True
    return False
