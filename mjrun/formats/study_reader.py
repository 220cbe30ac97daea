"""Reads the results of a study: a row for each point, with numbers and texts."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast, overload

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import FileError, clean, option
from mjrun.formats.input_file import decoding, parse_manifest
from mjrun.formats.local_and_remote_folders import Folder, folder_at, opened_at
from mjrun.formats.tables import input_format
from mjrun.model.table_column import with_unit
from mjrun.options.sweep import MANIFEST
from mjrun.suffixes import MODELS, is_url

if TYPE_CHECKING:
    import pyarrow

RESULTS, TRACE = "results.parquet", "trace.parquet"  # files of a study, and of a point
EPISODES = "episodes.csv"  # file of an evaluation
SENSITIVITY = "sensitivity.parquet"  # file of a study
FIRST, STATUS = "point", "status"  # columns around the parameters and the metrics
POINTS = "points"  # folder of the folders of points
NAME = "point.json"  # the manifest of a point
Numbers = Mapping[str, np.ndarray]  # columns (n,), by name
NO_UNITS: Mapping[str, str] = {}
HINT = "a study is a folder that mjrun sweep has written"


class TextColumn(Sequence[str]):
    """A column of texts, each of which is in memory once.

    Args:
      codes: place of each text in `words`, `(n,)`.
      words: the different texts.
    """

    def __init__(self, codes: np.ndarray, words: Sequence[str]) -> None:
        place = {word: index for index, word in enumerate(dict.fromkeys(words))}
        self.words, self.codes = [*place], codes
        if len(place) < len(words):
            self.codes = np.array([place[word] for word in words], codes.dtype)[codes]

    @classmethod
    def of(cls, texts: Sequence[str]) -> "TextColumn":
        """Returns the column of these texts."""
        return cls(np.arange(len(texts), dtype=np.int32), texts)

    def __len__(self) -> int:
        return len(self.codes)

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice) -> list[str]: ...
    def __getitem__(self, index: int | slice) -> str | list[str]:
        if isinstance(index, slice):
            return [self.words[code] for code in self.codes[index].tolist()]
        return self.words[int(self.codes[index])]


Texts = Mapping[str, TextColumn]


@dataclass(frozen=True)
class StudyResults:
    """The results of the points of a study.

    Attributes:
      folder: folder of the study, or its URL.
      parameters: names of the varied parameters.
      metrics: names of the metrics.
      numbers: columns of numbers `(n,)`, by name: metrics, and most parameters; NaN where a number is missing.
      texts: columns of texts, by name: `status`, `message`, and parameters such as models.
      metric_columns: columns of traces that the metrics read.
      units: units of parameters and metrics, by name; of those that have one.
      with_files: numbers of the points that have files of their present simulation.
      sensitivity: sensitivity of each metric, by the name of the index and of the parameter; empty without a design for
        it.
    """

    folder: str
    parameters: Sequence[str]
    metrics: Sequence[str]
    numbers: Mapping[str, np.ndarray]
    texts: Texts
    metric_columns: Sequence[str] = ()
    units: Mapping[str, str] = field(default_factory=dict[str, str])
    with_files: frozenset[int] = frozenset()
    sensitivity: Mapping[str, Mapping[str, Mapping[str, float]]] = field(
        default_factory=dict[str, Mapping[str, Mapping[str, float]]]
    )

    def with_unit(self, name: str) -> str:
        """Returns the name of a parameter or a metric with its unit: `slid [m]`."""
        return with_unit(name, self.units.get(name))

    @property
    def status(self) -> np.ndarray:
        """The outcome of each point `(n,)`: `ok`, `unstable`, …"""
        return np.array(self.texts[STATUS].words)[self.texts[STATUS].codes]

    @property
    def traces(self) -> Mapping[int, Path]:
        """The stored traces, by the number of their point."""
        traces = {point: folder / TRACE for point, folder in point_folders(self.folder).items()}
        return {point: path for point, path in traces.items() if point in self.with_files and path.is_file()}

    @property
    def is_of_evaluation(self) -> bool:
        """True if the points are those of an evaluation, which keeps no traces."""
        return folder_at(self.folder).has(EPISODES)

    def __len__(self) -> int:
        return len(self.texts[STATUS])


def folder_of_results(path: str) -> str:
    """Returns the folder or the URL of the study whose table of results is at `path`; empty for other tables."""
    folder, _, name = path.rpartition("/")
    is_results = name in (RESULTS, Path(RESULTS).with_suffix(".csv").name)
    return (folder or ".") if is_results and folder_at(folder or ".").has(MANIFEST) else ""


def _missing_results_hint(place: Folder) -> str:
    """Returns what a folder without results is, and how to get a table or a plot of it."""
    folder = clean(place.path())
    if place.has(EPISODES):
        plot = f"mjrun plot {folder}/{EPISODES} --x seed --y return -o returns.png"
        return f"an evaluation has results for each point of {option('vary')}; `{plot}` plots its episodes"
    if (place / "parts").exists():
        return f"the study is not finished: `mjrun sweep {folder} --collect` makes a table of the finished points"
    return HINT


def read_study(folder: str | Path) -> StudyResults:
    """Reads the results in the folder of a study.

    Raises:
      FileError: the folder has no results, or they cannot be read.
      MissingExtraError: pyarrow is not installed.
    """
    place = folder_at(folder)
    path = place.path(RESULTS)
    input_format(Path(path))  # which checks that its library is installed
    if not place.has(RESULTS):
        raise FileError(place.path(), f"has no {RESULTS}", _missing_results_hint(place))
    numbers, texts, names, manifest, units = read_results(path)
    if STATUS not in names or names[:1] != [FIRST] or not isinstance(manifest.get("metrics"), dict):
        raise FileError(path, "holds no results of a study", HINT)
    if not texts[STATUS]:
        raise FileError(path, "has no rows")

    metrics = [name for name in manifest["metrics"] if name in names]
    parameters = [name for name in names[1 : names.index(STATUS)] if name not in metrics]
    columns = manifest.get("columns")
    metric_columns = list(map(str, columns)) if isinstance(columns, list) else []
    sensitivity = _sensitivity(place.path(SENSITIVITY)) if place.has(SENSITIVITY) else {}
    files = _points_with_files(study_manifest(place))
    return StudyResults(place.path(), parameters, metrics, numbers, texts, metric_columns, units, files, sensitivity)


def study_manifest(folder: Folder) -> dict[str, Any]:
    """Returns the manifest of a study; empty where none can be read, as in a new folder."""
    with suppress(OSError, FileError), folder.open(MANIFEST) as stream:
        return parse_manifest(stream.read()) or {}
    return {}


def _points_with_files(manifest: Mapping[str, object]) -> frozenset[int]:
    """Returns the numbers of points that the manifest of a study lists as having files; none if it lists none."""
    match manifest:
        case {"with_files": list(points)}:
            return frozenset(point for point in cast("list[object]", points) if isinstance(point, int))
        case _:
            return frozenset()


def _sensitivity(path: str) -> dict[str, dict[str, dict[str, float]]]:
    """Reads indices by the names of metrics, indices and parameters.

    Raises:
      FileError: the table cannot be read.
    """
    numbers, texts, _, _, _ = read_results(path)
    if not {"metric", "parameter"} <= texts.keys():
        raise FileError(path, "holds no sensitivities of a study", HINT)
    made = dict[str, dict[str, dict[str, float]]]()
    for index, values in numbers.items():
        for metric, parameter, value in zip(texts["metric"], texts["parameter"], values.tolist(), strict=True):
            made.setdefault(metric, {}).setdefault(index, {})[parameter] = value
    return made


def check_result_folder(folder: str) -> None:
    """Raises FileError if the folder of a result in Python no longer exists."""
    if not is_url(folder) and not Path(folder).is_dir():
        hint = "without output=FOLDER, files exist as long as the result and its copies in this process"
        raise FileError(folder, "this folder of results has been removed or moved", hint)


def read_results(path: str | Path) -> tuple[Numbers, Texts, list[str], Mapping[str, Any], Mapping[str, str]]:
    """Reads a table of results at a path or a URL.

    Returns:
      Its columns of numbers and of texts, all names in order, its manifest, and units.

    Raises:
      FileError: it cannot be read.
      MissingExtraError: pyarrow is not installed.
    """
    shown = Path(path)
    input_format(shown)
    from pyarrow import parquet

    from mjrun.formats.arrow_columns import column_numbers, parquet_columns, units

    numbers, texts = dict[str, np.ndarray](), dict[str, TextColumn]()
    with opened_at(path, "table", [shown.suffix]) as stream, decoding(shown, "cannot be read as results of a study"):
        schema = parquet.read_schema(stream)
        names, text_columns = schema.names, [field.name for field in schema if _is_text(field.type)]
        for field, column in parquet_columns(shown, stream, text_columns):
            if _is_text(column.type):
                texts[field.name] = _text_column(column)
            else:
                numbers[field.name] = column_numbers(column)
    manifest = parse_manifest((schema.metadata or {}).get(b"mjrun")) or {}
    known = units(schema, dict(zip(names, range(len(names)), strict=True)))
    return numbers, texts, names, manifest, {name: unit for name, unit in known.items() if unit}


def _text_column(column: "pyarrow.ChunkedArray") -> TextColumn:
    """Returns a column of texts; null becomes empty."""
    from mjrun.formats.arrow_columns import array_numbers, array_validity

    codes, words = list[np.ndarray](), list[str]()
    for chunk in column.chunks:
        indices = chunk.indices
        found = array_numbers(indices, str(indices.type)).astype(np.int32)
        codes.append(np.where(array_validity(indices), found, len(chunk.dictionary)) + len(words))
        words += [*(word or "" for word in chunk.dictionary.to_pylist()), ""]
    return TextColumn(np.concatenate([np.array([], np.int32), *codes]), words)


def _is_text(kind: "pyarrow.DataType") -> bool:
    from pyarrow import types

    return types.is_string((types.is_dictionary(kind) and kind.value_type) or kind)


def point_folders(folder: str | Path) -> dict[int, Path]:
    """Returns the folders of single points in the folder of a study, by the number of the point, ascending."""
    numbered = {int(path.name): path for path in Path(folder).glob(f"{POINTS}/*") if path.name.isdecimal()}
    return dict(sorted(numbered.items()))


def read_point(folder: Path) -> Mapping[str, object]:
    """Returns the manifest in the folder of a point; empty if it is missing or cannot be read."""
    with suppress(OSError):
        return parse_manifest((folder / NAME).read_bytes()) or {}
    return {}


def point_values(folder: Path) -> Mapping[str, str]:
    """Returns the values of the parameters of a point, by name; none without a manifest."""
    values = read_point(folder).get("values")
    return {str(name): str(text) for name, text in values.items()} if isinstance(values, dict) else {}


def values_in_words(values: Mapping[str, str], units: Mapping[str, str] = NO_UNITS, digits: int = 4) -> list[str]:
    """Returns `timestep 0.01 s`, `floor.friction[0] 0.5`: each value after the shortest unique end of its name, with
    its unit if that is known. Other texts than numbers, such as `30deg`, hold their unit.
    """
    names = list(values)
    written = {name: _with_unit(text, units.get(name, ""), digits) for name, text in values.items()}
    return [f"{_short(name, names)} {text}" for name, text in written.items()]


def point_names(points: Sequence[Mapping[str, str]], units: Mapping[str, str] = NO_UNITS) -> list[str]:
    """Returns the name of each of several points: the values that differ among them, with more digits where two would
    be equal. The names are empty if the points have different parameters.
    """
    if any(values.keys() != points[0].keys() for values in points):
        return [""] * len(points)
    differing = [name for name in points[0] if len({values[name] for values in points}) > 1]
    chosen = [{name: values[name] for name in differing} for values in points]
    for digits in (4, 9):
        made = [", ".join(values_in_words(values, units, digits)) for values in chosen]
        if len(set(made)) == len(made):
            return made
    return [", ".join(f"{name} {text}" for name, text in values.items()) for values in chosen]


def _short(name: str, names: Sequence[str]) -> str:
    for separator in (".", "/"):
        end = name.rpartition(separator)[2].rpartition("/")[2]
        if sum(other.endswith(end) for other in names) == 1:
            return end
    return name


def _with_unit(text: str, unit: str, digits: int) -> str:
    try:
        return f"{float(text):.{digits}g} {unit}".rstrip()
    except ValueError:
        return Path(text).stem if text.endswith(MODELS) else text
