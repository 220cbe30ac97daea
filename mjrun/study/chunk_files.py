"""Results of a study on disk: chunks that end within a short time share a Parquet file; these are the only record.

Each row is identified by the key of its point, a hash of everything that determines its result. A study can therefore
be stopped, changed and continued by any number of processes at once.
"""

import hashlib
import json
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, replace
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Self, cast, get_args

import mujoco
import numpy as np

from mjrun.errors import FileError, MjrunError
from mjrun.formats.atomic_output import OutputWriter
from mjrun.formats.destinations import StagedFile
from mjrun.formats.input_file import is_folder
from mjrun.formats.temporary_output import remove_left_behind
from mjrun.model.fingerprint import content_fingerprint
from mjrun.options.sweep import PARTS
from mjrun.python_code import ModuleSource, code_hash
from mjrun.simulation.manifest import plain
from mjrun.study.spec import FILES, MODEL, PointResult, Status, StudySpec, simulation_at, versions
from mjrun.task.task import Task

if TYPE_CHECKING:
    import pyarrow

SUFFIX = ".parquet"
METRIC = "metric:"  # precedes the name of each metric
FINAL = ("ok", "unstable")  # statuses that another attempt would not change
LAST = ("steps", "exit_code", "message", "wall")
PATHS = ("model", "ctrl_from", "replay")  # options of a simulation that are files


def study_identity(spec: StudySpec, model: mujoco.MjModel, modules: Sequence[ModuleSource] = ()) -> dict[str, object]:
    """Returns everything that determines the results of a study except the values of its points, as plain values.

    Args:
      model: compiled base model.
      modules: the user's code as it will be executed.
    """
    assert spec.base.snapshot, "a study reads copies of its files"
    base, snapshot = replace(spec.base, snapshot=None), spec.base.snapshot
    simulation = cast("dict[str, object]", plain(base))
    simulation |= dict.fromkeys(PATHS)  # the contents of the files count, not their places
    simulation["map"] = [text for text in base.map if not text.startswith("@")]
    return {
        **versions(),
        "model": content_fingerprint(model),
        "files": [snapshot.digest(path) for _, path in base.inputs],
        "code": code_hash(base.code, modules),
        "environment": base.source.code,
        "controllers": {text: code_hash([controller], modules) for text, controller in spec.controllers},
        "simulation": {**simulation, "overrides": plain(base.source.overrides)},
        "metrics": dict(spec.metrics),
        "every": spec.every,
        "engine": spec.engine,
        **({"task": _task_terms(base.source)} if isinstance(base.source, Task) else {}),
        **({"product": spec.product.identity} if spec.product else {}),
    }


def _task_terms(task: Task) -> dict[str, object]:
    """Returns the terms of a task, which its document alone does not determine: values in it can be overridden."""
    place = ("model", "path", "name", "overrides")
    return {each.name: plain(getattr(task, each.name)) for each in fields(task) if each.repr and each.name not in place}


def point_keys(identity: Mapping[str, object], spec: StudySpec, points: Iterable[Sequence[str]]) -> list[str]:
    """Returns the key of each point: 32 hexadecimal digits."""
    base = hashlib.sha256(json.dumps(identity, sort_keys=True).encode())
    keys = list[str]()
    files = {index: _file_hashes(spec, name) for index, name in enumerate(spec.names) if name in FILES}
    for values in points:
        if files:
            values = [files[i](text) if i in files else text for i, text in enumerate(values)]
        digest = base.copy()
        digest.update(json.dumps(sorted(zip(spec.names, values, strict=True))).encode())
        keys.append(digest.hexdigest()[:32])
    return keys


def _file_hashes(spec: StudySpec, name: str) -> Callable[[str], str]:
    """Returns a function from a value of the option `name` to the hash of its files; a value without files stays."""
    assert spec.base.snapshot
    snapshot, base = spec.base.snapshot, replace(spec.base, snapshot=None)

    @cache
    def hashed(text: str) -> str:
        try:
            varied = simulation_at(base, (name,), (text,))
            files = varied.source.files if name == MODEL else [Path(text)]
            code = varied.source.code if name == MODEL else ""
        except MjrunError:  # the point will fail with this error
            return text
        return "".join(map(snapshot.digest, files)) + code or text

    return hashed


class ChunkFiles:
    """The part files in the folder of a study.

    Args:
      folder: folder of the study.
      metrics: names of the metrics.

    Attributes:
      damaged: parts that the last `read` could not read.
    """

    def __init__(self, folder: Path, metrics: Sequence[str]) -> None:
        self._folder, self._metrics = folder / PARTS, tuple(metrics)
        self.damaged = list[Path]()

    def create(self) -> None:
        """Creates the folder of the parts if it does not exist.

        Raises:
          FileError: the folder cannot be created.
        """
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FileError(self._folder, f"cannot be made: {error.strerror}") from None
        remove_left_behind(self._folder)

    def exist(self) -> bool:
        """Returns whether the folder of the parts exists."""
        return is_folder(self._folder)

    def size(self) -> int:
        """Returns the size of all parts [bytes]."""
        return sum(path.stat().st_size for path in self._paths())

    def read(self) -> dict[str, PointResult]:
        """Reads all results, by the key of their points; of several results of a point, prefers one that is final.

        The `index` of a result has no meaning yet. Files that are not parts of this study are skipped. So are `damaged`
        ones, such as a power failure leaves: their points will be simulated again.

        Raises:
          FileError: a part cannot be read for lack of permission.
        """
        self.damaged = []
        results = dict[str, PointResult]()
        paths = self._paths()
        if not paths:
            return results
        import pyarrow

        from mjrun.formats.arrow_columns import read_whole_parquet

        for path in paths:
            try:
                with path.open("rb") as stream:
                    table = read_whole_parquet(path, stream)
                rows = table.to_pylist() if self._is_part(table.schema) else []
            except PermissionError as error:
                raise FileError(path, f"cannot be read: {error.strerror}") from None
            except (OSError, pyarrow.ArrowException):
                self.damaged.append(path)
                continue
            for row in rows:
                result = self._result(row)
                if result and (row["key"] not in results or results[row["key"]].status not in FINAL):
                    results[row["key"]] = result
        return results

    def write(self, keys: Sequence[str], results: Sequence[PointResult], host: str) -> None:
        """Publishes a part in one step.

        Raises:
          FileError: the part cannot be written.
        """
        import pyarrow.parquet

        table = _part(keys, results, host, self._metrics)
        name = hashlib.sha256("".join(keys).encode()).hexdigest()[:16]
        with OutputWriter(StagedFile(self._folder / f"{name}{SUFFIX}")) as output, output.writing():
            with Path(output.destination.path).open("wb") as stream:  # as a path, the name would have to be UTF-8
                pyarrow.parquet.write_table(table, stream, compression="zstd")
            output.publish()

    def _paths(self) -> list[Path]:
        """Lists the files that may be parts.

        Raises:
          FileError: the folder cannot be read.
        """
        try:
            return sorted(self._folder.glob(f"*{SUFFIX}"))
        except OSError as error:
            raise FileError(self._folder, f"cannot be read: {error.strerror}") from None

    def _is_part(self, schema: "pyarrow.Schema") -> bool:
        """Returns whether a file with these columns is a part of this study."""
        metrics = {name for name in schema.names if name.startswith(METRIC)}
        if metrics != {METRIC + name for name in self._metrics} or len(set(schema.names)) < len(schema.names):
            return False
        ours = _part([], [], "", self._metrics).schema
        return all(name in schema.names and schema.field(name).type == ours.field(name).type for name in ours.names)

    def _result(self, row: Mapping[str, object]) -> PointResult | None:
        """Returns the result in a row; None if the row is invalid, since files are untrusted."""
        if row["status"] not in get_args(Status) or None in row.values():
            return None
        metrics = tuple(row[METRIC + name] for name in self._metrics)
        return PointResult(-1, row["status"], metrics, *(row[name] for name in LAST))  # type: ignore[arg-type]


class PartWriter:
    """A writer of results that arrive within `interval` [s] as one part; writes all at the end of its `with` block."""

    def __init__(self, files: ChunkFiles, interval: float) -> None:
        self._files, self._interval = files, interval
        self._waiting = dict[str, tuple[list[str], list[PointResult]]]()  # keys and results, by host
        self._written = time.monotonic()

    def add(self, keys: Sequence[str], results: Sequence[PointResult], host: str) -> None:
        """Adds results of points to the next part."""
        its_keys, its_results = self._waiting.setdefault(host, ([], []))
        its_keys.extend(keys)
        its_results.extend(results)

    def write_if_due(self) -> None:
        """Writes the part if the last one was written long enough ago; without results, prepares to write later.

        Raises:
          FileError: the part cannot be written.
        """
        if not self._waiting:
            import_module("pyarrow.parquet")  # while the first points are simulated
        elif time.monotonic() - self._written >= self._interval:
            self._write()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._write()

    def _write(self) -> None:
        waiting, self._waiting = self._waiting, {}
        for host, (keys, results) in waiting.items():
            self._files.write(keys, results, host)
        self._written = time.monotonic()


def part_bytes(metrics: Sequence[str], count: int) -> int:
    """Estimates the size of a part of `count` points [bytes], from a part with random numbers."""
    import pyarrow
    import pyarrow.parquet

    numbers = np.random.default_rng(0).standard_normal((count, len(metrics) + 1))
    keys = [hashlib.sha256(str(index).encode()).hexdigest()[:32] for index in range(count)]
    results = [PointResult(-1, "ok", tuple(row[1:]), 0, wall=float(row[0])) for row in numbers]
    stream = pyarrow.BufferOutputStream()
    pyarrow.parquet.write_table(_part(keys, results, "host", metrics), stream, compression="zstd")
    return stream.getvalue().size


def _part(keys: Sequence[str], results: Sequence[PointResult], host: str, metrics: Sequence[str]) -> "pyarrow.Table":
    import pyarrow

    from mjrun.formats.arrow_columns import number_array, text_array

    columns = {
        "key": text_array(keys),
        "status": text_array([result.status for result in results]),
        "steps": number_array(np.array([result.steps for result in results], np.int64)),
        "exit_code": number_array(np.array([result.exit_code for result in results], np.int64)),
        "message": text_array([result.message for result in results]),
        "host": text_array([host] * len(results)),
        "wall": number_array(np.array([result.wall for result in results], float)),
    }
    for index, name in enumerate(metrics):
        columns[METRIC + name] = number_array(np.array([result.metrics[index] for result in results], float))
    return pyarrow.Table.from_arrays(list(columns.values()), names=list(columns))
