"""Results of a study on disk: chunks that end within a short time share a Parquet file; these are the only record.

Each row has the number of its point in one study, and its key, a hash of everything that determines its result. A study
can therefore be stopped, changed and continued by any number of processes at once.
"""

import hashlib
import json
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import fields, replace
from functools import cache
from importlib import import_module
from json.encoder import encode_basestring_ascii as json_text
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Self, cast

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import FileError, MjrunError, PartlyDoneError, clean
from mjrun.experiment.design import ABSENT, Design
from mjrun.formats.local_and_remote_folders import Folder, LocalFolder, folder_at
from mjrun.formats.output_writer import OutputWriter
from mjrun.model.source import content_fingerprint
from mjrun.options.sweep import PARTS
from mjrun.python_code import ModuleSource, code_hash
from mjrun.simulation.origin import plain
from mjrun.study.range_folders import PointRange, RangeFolders
from mjrun.study.results import MISSING, STATUSES, ResultColumns, ResultRows
from mjrun.study.spec import (
    FILES,
    MODEL,
    ChunkResult,
    PointResult,
    StudySpec,
    WorkerVersions,
    places_in_any_order,
    simulation_at,
    versions,
)
from mjrun.task.task import Task

if TYPE_CHECKING:
    import pyarrow
    import pyarrow.parquet

SUFFIX = ".parquet"
METRIC = "metric:"  # precedes the name of each metric
STUDY = "study"  # in the metadata of a part
DIGITS = 16  # of the hash at the end of the name of a part
TEXTS, INTEGERS = ("status", "message", "host"), ("point", "steps", "exit_code")
KEY_BYTES = 16
KEYS = f"S{KEY_BYTES}"  # of numpy, which ignores zeros at the end
TOGETHER = 8  # parts that are merged into one
PART_BYTES = 2**25  # largest part that is made by merging
GROUP = 2**14  # rows that are merged at once
PATHS = ("model", "ctrl_from", "replay")  # options of a simulation that are files
PLACES = ("policy", "normalize")  # options that are files, code or words; the folder of a file does not count


def study_identity(spec: StudySpec, model: mujoco.MjModel, modules: Sequence[ModuleSource] = ()) -> dict[str, object]:
    """Returns everything that determines the results of a study except the values of its points, as plain values.

    The elements of the files count in addition to the compiled model, which lacks what a value of a point can bring to
    bear: the density of a geom that has a mass, or classes of defaults.

    Args:
      model: compiled base model.
      modules: the user's code as it will be executed.
    """
    assert spec.base.snapshot, "a study reads copies of its files"
    base, snapshot = replace(spec.base, snapshot=None), spec.base.snapshot
    simulation = cast("dict[str, object]", plain(base))
    simulation |= dict.fromkeys(PATHS)  # the contents of the files count, not their places
    simulation |= {name: Path(text).name for name in PLACES if isinstance(text := getattr(base, name), str)}
    simulation["map"] = [text for text in base.map if not text.startswith("@")]
    return {
        **versions(spec.packages),
        "model": content_fingerprint(model),
        "files": [snapshot.content_digest(path) for _, path in base.inputs],
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


def point_keys(
    identity: Mapping[str, object],
    spec: StudySpec,
    points: Iterable[Sequence[str]],
    own: Mapping[int, frozenset[str]] = MappingProxyType({}),
) -> list[str]:
    """Returns the key of each point: 32 hexadecimal digits.

    Args:
      own: values of parameters, by their places, that change nothing; see `own_values`.
    """
    base = hashlib.sha256(json.dumps(identity, sort_keys=True).encode())
    keys, places = list[str](), places_in_any_order(spec.names)
    files = {index: _file_hashes(spec, name) for index, name in enumerate(spec.names) if name in FILES}
    names = [json.dumps(name) for name in spec.names]
    for values in points:
        changes = [
            f"[{names[i]}, {json_text(files[i](values[i]) if i in files else values[i])}]"
            for i in places
            if values[i] != ABSENT and (i not in own or values[i] not in own[i])
        ]
        digest = base.copy()
        digest.update(f"[{', '.join(changes)}]".encode())  # json.dumps would take several times as long
        keys.append(digest.hexdigest()[:32])
    return keys


def points_digest(spec: StudySpec, points: Design) -> str:
    """Returns a hash of the values of all points, and of their order: of files, the contents count."""
    grid = points.grid
    for index, name in enumerate(spec.names):
        if name in FILES:
            grid = grid.replaced(index, _file_hashes(spec, name))
    return hashlib.sha256(json.dumps(spec.names).encode() + grid.digest).hexdigest()


def study_digest(identity: Mapping[str, object], points: str) -> str:
    """Returns a hash of everything that determines the results of all points, given the hash of their values."""
    return hashlib.sha256(json.dumps([identity, points], sort_keys=True).encode()).hexdigest()


def _file_hashes(spec: StudySpec, name: str) -> Callable[[str], str]:
    """Returns a function from a value of the option `name` to the hash of its files; a value without files stays."""
    assert spec.base.snapshot
    snapshot, base = spec.base.snapshot, replace(spec.base, snapshot=None)

    @cache
    def hashed(text: str) -> str:
        if text == ABSENT:
            return text
        try:
            varied = simulation_at(base, (name,), (text,))
            files = varied.source.files if name == MODEL else [Path(text)]
            code = varied.source.code if name == MODEL else ""
        except MjrunError:  # the point will fail with this error
            return text
        return "".join(map(snapshot.content_digest, files)) + code or text

    return hashed


@contextmanager
def kept_results_in_errors(folder: str | Path | Folder, noun: str) -> Generator[None]:
    """Makes errors of outputs in a `with` block state that the results in the folder remain, if it has some.

    Args:
      noun: the word for a point.
    """
    try:
        yield
    except (FileError, PartlyDoneError) as error:
        parts = folder_at(folder) / PARTS
        with suppress(MjrunError):
            if RangeFolders(parts, "", 0).names(SUFFIX):
                error.add_note(f"finished {noun}s are kept in {clean(parts.path())}; repeat the command to continue")
        raise


class PartFiles:
    """The part files in the folder of a study.

    The name of a part states the study and the range of points of its rows: `STUDY-FIRST-LAST-HASH.parquet`. Parts are
    read without regard to keys where they are of the same study, and by the keys of points where they are not.

    Args:
      folder: folder of the study.
      metrics: names of the metrics.
      study: hash of everything that determines the results of all points, 64 hexadecimal digits.
      points: number of points of the study.

    Attributes:
      folder: folder of the parts, and of the folders of their ranges.
      ranges: folders of ranges of points.
      width: number of metrics.
      bounds: ascending points where new parts begin, since different processes work on either side.
      damaged: names of the parts that the last `read` could not read.
      adopted: places of the results that the last `read` has found by keys, ascending.
    """

    def __init__(self, folder: str | Path | Folder, metrics: Sequence[str], study: str, points: int = 0) -> None:
        self._place, self._metrics, self.study = folder_at(folder), tuple(metrics), study
        self.folder, self._points = self._place / PARTS, points
        self.ranges = RangeFolders(self.folder, study, points)
        self.width = len(self._metrics)
        self.bounds = np.arange(self.ranges.window, points, self.ranges.window)
        self.damaged = list[str]()
        self.adopted = np.array([], np.intp)
        self._parts = set[str]()  # of this study whose results are known

    def create(self) -> None:
        """Creates the folder of the parts if it does not exist.

        Raises:
          FileError: the folder cannot be created.
        """
        self.folder.create()

    def exist(self) -> bool:
        """Returns whether the folder of the parts exists."""
        return self.folder.exists()

    def size(self) -> int:
        """Returns the size of all parts [bytes]."""
        return sum(map(self.folder.size, self.ranges.names(SUFFIX)))

    def read(self, points: Sequence[int] | np.ndarray, keys: Callable[[np.ndarray], Sequence[str]]) -> ResultColumns:
        """Reads the results of points; of several results of a point, prefers one that is final.

        Files that are not parts of this study are skipped. So are `damaged` ones, such as a power failure leaves: their
        points will be simulated again.

        Args:
          points: numbers of the points, ascending; other parts of the same study are not opened.
          keys: function from the numbers of points to their keys, for parts of other designs of the study.

        Raises:
          FileError: a part cannot be opened.
        """
        self.damaged, self.adopted = [], np.array([], np.intp)
        known, seen, others = ResultColumns(points, len(self._metrics)), set[str](), list[str]()
        self._parts = set()

        def is_relevant(part: PointRange) -> bool:
            return part.study == self.ranges.study and known.has_between(part.first, part.last)

        while new := [name for name in self.ranges.names(SUFFIX, is_relevant) if name not in seen]:  # others merge them
            seen.update(new)
            for name in new:
                if (part := PointRange.of(name)) and is_relevant(part) and not self._put(name, known):
                    others.append(name)
        open_places = np.flatnonzero(~known.is_final)
        if len(open_places):
            others += self._names(is_own=False)
        if others and len(open_places):
            self._read_by_key(others, known, open_places, _binary(keys(known.points[open_places])))
        return known

    def update(self, known: ResultColumns, first: int, last: int) -> bool:
        """Adds the results in parts that other processes have published since, if their points overlap a range.

        Returns:
          Whether there are such parts.

        Raises:
          FileError: a part cannot be opened.
        """
        has_new = False
        for name in self._names(lambda part: part.overlaps(first, last)):
            if name not in self._parts:
                has_new = self._put(name, known) or has_new
        return has_new

    def write(self, points: Sequence[int] | np.ndarray, keys: Sequence[str], results: ResultRows) -> str:
        """Publishes a part in one step, and returns its name.

        Args:
          points: numbers of the points.

        Raises:
          FileError: the part cannot be written.
        """
        table = _part(np.asarray(points, np.int64), keys, results, self._metrics)
        return self._publish([table], min(points), max(points), "".join(keys))

    def shared(self, witness: str, keys: Sequence[str], versions: WorkerVersions) -> "PartPublisher":
        """Returns the part of a chunk for a process on any machine; see `PartPublisher`."""
        place = self._place.path()
        folder = str(Path(place).absolute()) if isinstance(self._place, LocalFolder) else place
        return PartPublisher(folder, self._metrics, self.study, self._points, witness, keys, versions)

    def merge(self, parts: Sequence[str]) -> str | None:
        """Replaces parts of this study by one; returns None if some are damaged, or merged by another process.

        Raises:
          FileError: the new part cannot be written.
        """
        ranges = [part for part in map(PointRange.of, parts) if part]
        first, last = min(part.first for part in ranges), max(part.last for part in ranges)
        try:
            made = self._publish(self._grouped(parts), first, last, "".join(parts))
        except _UnreadablePartError:
            return None
        if not self._parts.issuperset(parts):  # of which some are to be read
            self._parts.discard(made)
        for name in parts:
            self.folder.remove(name)
        return made

    def merge_all(self) -> None:
        """Merges the small parts of this study into large ones.

        Raises:
          FileError: a part cannot be written.
        """
        self.merge_small([name for name in self._names() if name not in self.damaged])
        self.ranges.remove_empty()

    def merge_small(self, parts: Sequence[str]) -> None:
        """Merges those of some parts of this study that are small, in order, into large ones.

        Raises:
          FileError: a part cannot be written.
        """
        group, size = list[str](), 0
        for name in [*parts, None]:
            own = self.folder.size(name) if name else 0
            if name and own < PART_BYTES // 2 and size + own <= PART_BYTES:
                group.append(name)
                size += own
                continue
            if len(group) > 1:
                self.merge(group)
            group, size = [name] if name and own < PART_BYTES // 2 else [], own

    def unused(self) -> tuple[list[str], list[str]]:
        """Returns the parts of other versions or designs of the study, and damaged parts; other files are in neither.

        Raises:
          FileError: a part cannot be opened.
        """
        import pyarrow
        import pyarrow.parquet

        others, damaged = list[str](), list[str]()
        for name in self.ranges.names(SUFFIX):
            try:
                with self.folder.open(name) as stream:
                    schema = pyarrow.parquet.read_schema(stream)
            except FileNotFoundError:  # merged by another process
                continue
            except (OSError, ValueError, pyarrow.ArrowException):
                damaged += [name] if PointRange.of(name) else []
                continue
            if _study_of(schema) != self.study and {*_schema(()).names} <= {*schema.names}:
                others.append(name)
            elif self._is_own(name) and not _is_part(schema, self._metrics):
                damaged.append(name)
        return others, damaged

    def _is_own(self, name: str) -> bool:
        """Returns whether a file is called like a part of this study."""
        part = PointRange.of(name)
        return part is not None and part.study == self.ranges.study

    def _publish(self, tables: Iterable["pyarrow.Table"], first: int, last: int, content: str) -> str:
        from mjrun.formats.arrow_columns import cast_texts

        digest = hashlib.sha256(content.encode()).hexdigest()[:DIGITS]
        name = self.ranges.new_name(first, last, f"{digest}{SUFFIX}")
        schema = _schema(self._metrics, self.study)
        with OutputWriter(self.folder.destination(name)) as output, output.writing():
            # as a path, the name would have to be UTF-8
            with (
                Path(output.destination.path).open("wb") as stream,
                _writer(stream, schema) as writer,
            ):
                for table in tables:
                    writer.write_table(cast_texts(table, schema))
            output.publish()
        self._parts.add(name)
        return name

    def _grouped(self, names: Sequence[str]) -> "Iterator[pyarrow.Table]":
        """Yields the rows of parts in groups of about `GROUP` rows.

        Raises:
          _UnreadablePartError: a part is damaged, has been removed, or belongs to another study.
        """
        import pyarrow

        from mjrun.formats.arrow_columns import parquet_groups

        waiting, count = list[pyarrow.Table](), 0
        for name in names:
            try:
                with self.folder.open(name) as stream:
                    for table in parquet_groups(Path(self.folder.path(name)), stream):
                        if _study_of(table.schema) != self.study or not _is_part(table.schema, self._metrics):
                            raise _UnreadablePartError
                        waiting.append(table)
                        count += table.num_rows
                        if count >= GROUP:
                            yield pyarrow.concat_tables(waiting)
                            waiting, count = [], 0
            except (OSError, ValueError, pyarrow.ArrowException):
                raise _UnreadablePartError from None
        if waiting:
            yield pyarrow.concat_tables(waiting)

    def _names(self, is_relevant: Callable[[PointRange], bool] = lambda _: True, *, is_own: bool = True) -> list[str]:
        """Lists parts of relevant points of this study, or the files that may be parts of others.

        Raises:
          FileError: a folder cannot be read.
        """

        def is_wanted(part: PointRange) -> bool:
            return (part.study == self.ranges.study) == is_own and is_relevant(part)

        names = self.ranges.names(SUFFIX, is_wanted)
        return [name for name in names if (is_wanted(part) if (part := PointRange.of(name)) else not is_own)]

    def _put(self, name: str, known: ResultColumns) -> bool:
        """Adds the results in a part; returns False for one of another study whose hash begins with the same digits."""
        self._parts.add(name)
        for rows in self._rows(name, has_keys=False):
            if rows.study != self.study:
                return False
            known.put_points(rows.points, rows.results)
        return True

    def _rows(self, name: str, *, has_keys: bool = True) -> Iterator["_PartRows"]:
        """Yields the valid rows of a part in groups; nothing if it is damaged, or not a part of a study.

        A file that is called like a part of this study but has other columns counts as damaged.

        Raises:
          FileError: it cannot be opened, as for lack of permission.
        """
        import pyarrow

        from mjrun.formats.arrow_columns import parquet_groups

        try:
            stream = self.folder.open(name)
        except FileNotFoundError:  # merged by another process: the new part is read instead
            return
        try:
            with stream:
                for table in parquet_groups(Path(self.folder.path(name)), stream, TEXTS, () if has_keys else ("key",)):
                    if not _is_part(table.schema, self._metrics, has_keys=has_keys):
                        self.damaged += [name] if self._is_own(name) else []
                        return
                    yield _part_rows(table, self._metrics)
        except (OSError, ValueError, pyarrow.ArrowException):
            self.damaged.append(name)

    def _read_by_key(self, names: Sequence[str], known: ResultColumns, places: np.ndarray, keys: np.ndarray) -> None:
        """Adds the results of the points at `places`, whose keys are `keys`, from parts of other designs."""
        was_missing = known.is_missing
        order = np.argsort(keys, kind="stable")
        places, keys = places[order], keys[order]
        for name in names:
            for rows in self._rows(name):
                first, end = (np.searchsorted(keys, rows.keys, side) for side in ("left", "right"))
                counts = end - first  # points with the key of each row
                row = np.repeat(np.arange(len(counts)), counts)
                place = np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts) + first[row]
                known.put(places[place], rows.results.at(row))
        self.adopted = np.flatnonzero(was_missing & ~known.is_missing)


@dataclass(frozen=True)
class PartPublisher:
    """A publisher of parts of chunks of a study, in a process on any machine that sees the same folder.

    Attributes:
      folder: absolute path of the folder of the study, or its URL.
      metrics, study, points: see `PartFiles`.
      witness: name of a file of this folder alone: a lease of the points of the chunk.
      keys: keys of these points.
      versions: versions that they are to be simulated with.
    """

    folder: str
    metrics: tuple[str, ...]
    study: str
    points: int
    witness: str
    keys: Sequence[str]
    versions: WorkerVersions

    def publish(self, result: ChunkResult) -> ChunkResult:
        """Publishes results; returns them where this process sees another folder, or cannot write to it."""
        if any(each.difference(self.versions) for each in result.worker_versions):
            return result
        try:
            folder = folder_at(self.folder, delays=())  # to return results is faster than to try again
            files = PartFiles(folder, self.metrics, self.study, self.points)
            if not files.folder.has(self.witness):
                return result
            rows = ResultRows.of(result.results, files.width, result.hosts)
            part = files.write([each.index for each in result.results], self.keys, rows)
        except (MjrunError, ImportError, OSError):
            return result
        good = [each for each in result.results if each.status == "ok"]
        others = [each for each in result.results if each.status != "ok"]
        steps, wall = sum(each.steps for each in good), sum(each.wall for each in good)
        return replace(result, results=others, part=part, steps=steps, wall=wall)


@dataclass(frozen=True)
class _PartRows:
    """Rows of a part: the study that wrote it, the number and the key of each point, and the results."""

    study: str
    points: np.ndarray
    keys: np.ndarray
    results: ResultRows


class _UnreadablePartError(Exception):
    """A part that cannot be merged."""


class PartWriter:
    """A writer of results that arrive within `interval` [s] as one part; writes all at the end of its `with` block.

    Parts are merged as they accumulate, so that their number grows with the logarithm of the number of results, and at
    the end, so that many tasks leave few files.

    Args:
      published: called with the points whose results have been published.
    """

    def __init__(
        self, files: PartFiles, interval: float, published: Callable[[Sequence[int]], None] = lambda _: None
    ) -> None:
        self._files, self._interval, self._published = files, interval, published
        # Points, keys and results by block, see `PartFiles.bounds`, and host.
        self._waiting = dict[tuple[int, str], tuple[list[int], list[str], list[PointResult]]]()
        self._levels = dict[tuple[int, int], list[str]]()  # parts, by block and the number of their merges
        self._written = time.monotonic()

    def add(self, points: Sequence[int], keys: Sequence[str], results: Sequence[PointResult], host: str) -> None:
        """Adds results of points to the next part."""
        blocks = np.searchsorted(self._files.bounds, points, "right").tolist()
        for block, point, key, result in zip(blocks, points, keys, results, strict=True):
            some = self._waiting.setdefault((block, host), ([], [], []))
            some[0].append(point)
            some[1].append(key)
            some[2].append(result)

    def adopt(self, part: str, points: Sequence[int]) -> None:
        """Adds a part of points of one block that another process has published."""
        self._keep(part, int(np.searchsorted(self._files.bounds, points[0], "right")), 0)
        self._published(points)

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

    def __exit__(self, error: type[BaseException] | None = None, *_: object) -> None:
        self._write()
        if error is None:
            for block in dict.fromkeys(block for block, _ in self._levels):
                levels = sorted((level for own, level in self._levels if own == block), reverse=True)
                self._files.merge_small([part for level in levels for part in self._levels[block, level]])

    def _write(self) -> None:
        waiting, self._waiting = self._waiting, {}
        for (block, host), (points, keys, results) in waiting.items():
            rows = ResultRows.of(results, self._files.width, host)
            self._keep(self._files.write(points, keys, rows), block, 0)
            self._published(points)
        self._written = time.monotonic()

    def _keep(self, part: str, block: int, level: int) -> None:
        """Adds a part to those of its block that were merged `level` times, and merges them once they are many."""
        parts = self._levels.setdefault((block, level), [])
        parts.append(part)
        if len(parts) < TOGETHER or sum(map(self._files.folder.size, parts)) > PART_BYTES:
            return
        del self._levels[block, level]
        if merged := self._files.merge(parts):
            self._keep(merged, block, level + 1)


def part_bytes(metrics: Sequence[str], count: int) -> int:
    """Estimates the size of a part of `count` points [bytes], from a part with random numbers."""
    import pyarrow
    import pyarrow.parquet

    numbers = np.random.default_rng(0).standard_normal((count, len(metrics) + 1))
    keys = [hashlib.sha256(str(index).encode()).hexdigest()[:32] for index in range(count)]
    results = [PointResult(-1, "ok", tuple(row[1:]), 0, wall=float(row[0])) for row in numbers]
    stream = pyarrow.BufferOutputStream()
    table = _part(np.arange(count), keys, ResultRows.of(results, len(metrics), "host"), metrics)
    with _writer(stream, table.schema) as writer:
        writer.write_table(table)
    return stream.getvalue().size


def _writer(stream: object, schema: "pyarrow.Schema") -> "pyarrow.parquet.ParquetWriter":
    """Returns a writer of a part: dictionaries of numbers that differ at each point would only take memory."""
    import pyarrow.parquet

    numbers = [name for name in schema.names if name == "wall" or name.startswith(METRIC)]
    encodings = {"point": "DELTA_BINARY_PACKED"} | dict.fromkeys(numbers, "BYTE_STREAM_SPLIT")
    repeated = [*TEXTS, "steps", "exit_code"]
    return pyarrow.parquet.ParquetWriter(
        stream,
        schema,
        compression="zstd",
        use_dictionary=repeated,  # type: ignore[arg-type] # whose stub does not know names
        column_encoding=encodings,
        write_page_checksum=True,
    )


def _schema(metrics: Sequence[str], study: str = "") -> "pyarrow.Schema":
    import pyarrow

    text, integer, number = pyarrow.string(), pyarrow.int64(), pyarrow.float64()
    columns = {"key": pyarrow.binary(KEY_BYTES), "point": integer, "status": text, "steps": integer}
    columns |= {"exit_code": integer, "message": text, "host": text, "wall": number}
    columns |= {METRIC + name: number for name in metrics}
    return pyarrow.schema(columns, {STUDY: study})


def _part(points: np.ndarray, keys: Sequence[str], results: ResultRows, metrics: Sequence[str]) -> "pyarrow.Table":
    import pyarrow

    from mjrun.formats.arrow_columns import number_array, text_array

    def coded(codes: np.ndarray, texts: Sequence[str]) -> "pyarrow.Array":
        return pyarrow.DictionaryArray.from_arrays(number_array(codes.astype(np.int32)), text_array(texts))

    content = pyarrow.py_buffer(bytes.fromhex("".join(keys)))
    columns = [
        pyarrow.FixedSizeBinaryArray.from_buffers(pyarrow.binary(KEY_BYTES), len(keys), [None, content]),
        number_array(points.astype(np.int64)),
        coded(results.status, STATUSES),
        number_array(results.steps.astype(np.int64)),
        number_array(results.exit_code.astype(np.int64)),
        coded(results.message, results.messages),
        coded(results.host, results.hosts),
        number_array(results.wall),
        *(number_array(results.metrics[:, index]) for index in range(len(metrics))),
    ]
    return pyarrow.Table.from_arrays(columns, names=_schema(metrics).names)


def _study_of(schema: "pyarrow.Schema") -> str:
    """Returns the hash of the study whose results a part contains."""
    return (schema.metadata or {}).get(STUDY.encode(), b"").decode("utf-8", "replace")


def _is_part(schema: "pyarrow.Schema", metrics: Sequence[str], *, has_keys: bool = True) -> bool:
    """Returns whether a file with these columns is a part of a study with these metrics."""
    from pyarrow import types

    found = {name for name in schema.names if name.startswith(METRIC)}
    if found != {METRIC + name for name in metrics} or len(set(schema.names)) < len(schema.names):
        return False
    ours = _schema(metrics)
    wanted = [name for name in ours.names if has_keys or name != "key"]

    def kind(name: str) -> "pyarrow.DataType":
        found = schema.field(name).type
        return found.value_type if types.is_dictionary(found) else found

    return all(name in schema.names and kind(name) == ours.field(name).type for name in wanted)


def _part_rows(table: "pyarrow.Table", metrics: Sequence[str]) -> _PartRows:
    """Returns the valid rows of a part; files are untrusted."""
    from mjrun.formats.arrow_columns import array_numbers, array_validity

    arrays = {name: table.column(name).combine_chunks() for name in table.column_names}
    is_valid = np.ones(table.num_rows, bool)
    for array in arrays.values():
        is_valid &= array_validity(array)

    def numbers(name: str) -> np.ndarray:
        return array_numbers(arrays[name], np.int64 if name in INTEGERS else np.float64)

    def coded(name: str) -> tuple[np.ndarray, list[str]]:
        codes = array_numbers(arrays[name].indices, np.int32)
        return np.where(is_valid, codes, 0), [text or "" for text in arrays[name].dictionary.to_pylist()] or [""]

    status, statuses = coded("status")
    codes = np.array([STATUSES.index(text) if text in STATUSES else MISSING for text in statuses])
    status = codes[status]
    results = ResultRows(
        status.astype(np.uint8),
        numbers("steps"),
        numbers("exit_code"),
        numbers("wall"),
        np.stack([numbers(METRIC + name) for name in metrics], axis=1) if metrics else np.empty((len(status), 0)),
        *coded("message"),
        *coded("host"),
    )
    rows = np.flatnonzero(is_valid & (status != MISSING))
    keys = array_numbers(arrays["key"], KEYS) if "key" in arrays else np.zeros(table.num_rows, KEYS)
    return _PartRows(_study_of(table.schema), numbers("point")[rows], keys[rows], results.at(rows))


def _binary(keys: Sequence[str]) -> np.ndarray:
    return np.array([bytes.fromhex(key) for key in keys], KEYS)
