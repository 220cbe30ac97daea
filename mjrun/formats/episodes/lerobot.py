"""LeRobot datasets, version 3: tables in Parquet, a video for each camera with many episodes in a file, statistics.

https://huggingface.co/docs/lerobot/lerobot-dataset-v3

Readers look up the frame of a row by its time in the video, at the first time of the episode plus the row's own time,
both of which they convert to 32 bits. All times are therefore computed from numbers of frames, and files are short
enough that 32 bits distinguish neighbours by less than the readers' tolerance of 0.1 ms.
"""

import html
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from fractions import Fraction
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyarrow
import pyarrow.parquet

from mjrun.dataclass import dataclass
from mjrun.errors import FileError, UsageError, clean, option
from mjrun.formats.episodes import CameraVideoLayout, EpisodeLayout, EpisodeRows
from mjrun.formats.local_and_remote_folders import written_file
from mjrun.formats.mp4_joining import Mp4Samples, join, read_samples
from mjrun.formats.output_writer import OutputWriter, StagedFile, closing_quietly

VERSION = "v3.0"
PRECISION = "float32"  # of numbers
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
EPISODES = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
INFO, STATS, TASKS, CARD = "meta/info.json", "meta/stats.json", "meta/tasks.parquet", "README.md"
COLORS = "mjrun/colors.parquet"  # `EpisodeRows.colors` of each episode, for more episodes
STATE, ACTION, IMAGES = "observation.state", "action", "observation.images."
REWARD, DONE, TRUNCATED, SUCCESS = "next.reward", "next.done", "next.truncated", "next.success"
INDICES = ("frame_index", "episode_index", "index", "task_index")
CODECS = {"h264": "h264", "h265": "hevc", "av1": "av1"}  # names of codecs in LeRobot

MEGABYTE = 2**20
DATA_SIZE, VIDEO_SIZE, CHUNK = 100, 200, 1000  # megabytes in a file, and files in a folder
LONGEST = 1000  # [s] of a video file: from 1024 s on, 32 bits distinguish no more than 0.12 ms
ROWS = 100  # episodes that are written at once
OPTIONS: dict[str, Any] = {"compression": "snappy", "use_dictionary": True}
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
SAMPLED = 2**16  # rows at most that quantiles are computed from
MOST = 255  # of a colour


def check(layout: EpisodeLayout) -> None:
    """Checks that LeRobot can hold such episodes.

    Raises:
      UsageError: the rate is not a whole number, a codec is unknown or pads the images, or these are too small.
    """
    if layout.fps.denominator != 1:
        rounded = f"{option('fps')} {round(layout.fps)} rounds it"
        message = f"LeRobot has whole numbers of frames per second, not {float(layout.fps):g}; {rounded}"
        raise UsageError(message, ("fps",))
    for camera in layout.cameras:
        codec, (width, height) = camera.encoding.codec, camera.size
        if codec not in CODECS:
            raise UsageError(f"LeRobot reads videos of {', '.join(CODECS)}, not of {codec}", ("codec",))
        camera.encoding.check_size(width, height)
        if any(camera.encoding.padding(width, height)):
            raise UsageError(f"{option('size')} {width}x{height}: {codec} requires even sides", ("size",))


def write(
    stack: ExitStack, folder: Path, layout: EpisodeLayout, episodes: Iterable[EpisodeRows], before: int = 0
) -> list[OutputWriter]:
    """Writes a dataset; see `mjrun.formats.episodes`.

    Raises:
      FileError: a file cannot be read or written, or an episode is too long.
    """
    dataset = _Dataset(stack, folder, layout)
    if before:
        dataset.read(before)
    for episode in episodes:
        dataset.add(episode)
    return dataset.finish()


def features(layout: EpisodeLayout) -> dict[str, dict[str, Any]]:
    """Returns the columns of the tables and the videos, as LeRobot describes them."""
    described: dict[str, dict[str, Any]] = {}
    for key, columns in ((STATE, layout.observations), (ACTION, layout.actions)):
        if columns:
            described[key] = _feature("float32", len(columns), [clean(column.name) for column in columns])
    for camera in layout.cameras:
        described[IMAGES + camera.name] = _video_feature(camera, layout.fps)
    if layout.has_rewards:
        described[REWARD] = _feature("float32")
    described[DONE] = _feature("bool")
    if layout.has_rewards:
        described |= {TRUNCATED: _feature("bool"), SUCCESS: _feature("bool")}
    return {**described, "timestamp": _feature("float32"), **{name: _feature("int64") for name in INDICES}}


def _feature(dtype: str, count: int = 1, names: Sequence[str] | None = None) -> dict[str, Any]:
    return {"dtype": dtype, "shape": [count], "names": names}


def _video_feature(camera: CameraVideoLayout, fps: Fraction) -> dict[str, Any]:
    width, height = camera.size
    encoding = camera.encoding
    info = {
        "video.height": height,
        "video.width": width,
        "video.codec": CODECS[encoding.codec],
        "video.pix_fmt": "yuv420p",
        "video.fps": int(fps),
        "video.channels": 3,
        "video.g": encoding.keyframe_every,
        "video.crf": encoding.crf,
        "video.preset": encoding.preset,
        "video.is_depth_map": False,
        "is_depth_map": False,
        "has_audio": False,
    }
    return {"dtype": "video", "shape": [height, width, 3], "names": ["height", "width", "channels"], "info": info}


def _schema(layout: EpisodeLayout) -> pyarrow.Schema:
    kinds = {"float32": pyarrow.float32(), "int64": pyarrow.int64(), "bool": pyarrow.bool_()}
    fields = list[pyarrow.Field]()
    for key, feature in features(layout).items():
        if feature["dtype"] != "video":
            kind, (count,) = kinds[feature["dtype"]], feature["shape"]
            fields.append(pyarrow.field(key, kind if count == 1 else pyarrow.list_(kind, count)))
    return pyarrow.schema(fields)


class _Dataset:
    """A dataset that grows by an episode at a time."""

    def __init__(self, stack: ExitStack, folder: Path, layout: EpisodeLayout) -> None:
        self._stack, self._folder, self._layout = stack, folder, layout
        self._schema = _schema(layout)
        self._tasks = list[str]()
        self._episodes = self._frames = 0
        self._statistics = {name: RunningStatistics() for name in self._schema.names}
        self._colors = {camera.name: np.zeros((3, MOST + 1), np.int64) for camera in layout.cameras}
        kind = pyarrow.list_(pyarrow.int64(), 3 * (MOST + 1))
        self._color_schema = pyarrow.schema([pyarrow.field(name, kind) for name in self._colors])
        self._color_rows = _TableFiles(stack, folder, COLORS, self._color_schema)
        self._data = _TableFiles(stack, folder, DATA, self._schema)
        self._videos = {camera.name: _VideoFiles(stack, folder, camera, layout.fps) for camera in layout.cameras}
        self._meta = _EpisodeRows(stack, folder)

    def read(self, count: int) -> None:
        """Continues the dataset in the folder after its first `count` episodes.

        Raises:
          FileError: its files are damaged, or missing.
        """
        try:
            self._read(count)
        except (OSError, ValueError, KeyError, TypeError, pyarrow.ArrowException) as error:
            raise FileError(self._folder, f"contains a damaged dataset: {clean(str(error))}") from None

    def add(self, episode: EpisodeRows) -> None:
        """Adds an episode.

        Raises:
          FileError: a video cannot be read, or the episode is too long.
        """
        count, layout = len(episode), self._layout
        if count / layout.fps > LONGEST:
            reason = f"an episode of {float(count / layout.fps):g} s is too long for LeRobot, whose times have 32 bits"
            raise FileError(self._folder, reason, f"the longest has {LONGEST} s")
        if episode.task not in self._tasks:
            self._tasks.append(episode.task)
        columns = self._columns(episode)
        row: dict[str, Any] = {
            "episode_index": self._episodes,
            "tasks": [episode.task],
            "length": count,
            **_place("data", self._data.add(_table(self._schema, columns))),
            "dataset_from_index": self._frames,
            "dataset_to_index": self._frames + count,
        }
        for name, files in self._videos.items():
            place, first = files.add(read_samples(episode.videos[name]), count)
            key = f"videos/{IMAGES}{name}"
            row |= _place(key, place)
            row[f"{key}/from_timestamp"] = float(first / layout.fps)
            row[f"{key}/to_timestamp"] = float((first + count) / layout.fps)
        for name, values in columns.items():
            alone = RunningStatistics()
            alone.add(values)
            row |= _row_statistics(name, alone.result())
            self._statistics[name].add(values)
        for name, counts in episode.colors.items():
            row |= _row_statistics(IMAGES + name, color_statistics(counts, count))
        self._add_colors(episode.colors)
        self._meta.add(row)
        self._episodes, self._frames = self._episodes + 1, self._frames + count

    def finish(self) -> list[OutputWriter]:
        """Writes the rest; `info.json`, without which nothing can be read, is the last to be published."""
        writers = self._data.finish()
        for files in self._videos.values():
            writers += files.finish()
        writers += self._meta.finish()
        writers.append(self._parquet(TASKS, _task_table(self._tasks)))
        writers += self._color_rows.finish()
        documents = {
            STATS: _json(self._dataset_statistics()),
            CARD: _card(self._layout, self._episodes, self._frames, self._tasks).encode(),
            INFO: _json(self._info()),
        }
        for path, content in documents.items():
            writers.append(self._stack.enter_context(written_file(self._folder / path, content)))
        return writers

    def _add_colors(self, colors: Mapping[str, np.ndarray]) -> None:
        if colors:
            self._color_rows.write(_table(self._color_schema, colors))
        for name, counts in colors.items():
            self._colors[name] += counts

    def _columns(self, episode: EpisodeRows) -> dict[str, np.ndarray]:
        """Returns the columns of the table `(T, n)`."""
        count = len(episode)
        frames = np.arange(count)
        columns: dict[str, np.ndarray] = {
            STATE: episode.observations[:count],
            ACTION: episode.actions,
            REWARD: episode.rewards,
            DONE: episode.done,
            TRUNCATED: episode.at_end(episode.truncated),
            SUCCESS: episode.at_end(episode.success),
            "timestamp": frames / float(self._layout.fps),
            "frame_index": frames,
            "episode_index": np.full(count, self._episodes),
            "index": self._frames + frames,
            "task_index": np.full(count, self._tasks.index(episode.task)),
        }
        return {field.name: columns[field.name].reshape(count, -1).astype(_dtype(field.type)) for field in self._schema}

    def _read(self, count: int) -> None:
        rows = list[dict[str, Any]]()
        for path in sorted((self._folder / "meta" / "episodes").glob("*/*.parquet")):
            rows += pyarrow.parquet.read_table(path).to_pylist()
        rows = sorted(rows, key=lambda row: row["episode_index"])[:count]
        if len(rows) < count:
            raise ValueError(f"{len(rows)} of {count} episodes are in {EPISODES.partition('/chunk')[0]}")
        self._tasks = list(dict.fromkeys(task for row in rows for task in row["tasks"]))
        for index, table in self._data.read(rows):
            for name in self._schema.names:
                self._statistics[name].add(_values(table, name))
            self._episodes, self._frames = index + 1, self._frames + table.num_rows
        for name, files in self._videos.items():
            files.read(rows, f"videos/{IMAGES}{name}")
        if self._colors:
            file = pyarrow.parquet.ParquetFile(self._folder / COLORS)
            for group in range(count):
                table = file.read_row_group(group).cast(self._color_schema)
                self._add_colors({name: _values(table, name).reshape(3, -1) for name in self._colors})
        for row in rows:
            self._meta.add({key: value for key, value in row.items() if not key.startswith("meta/")})

    def _dataset_statistics(self) -> dict[str, Any]:
        made = {name: _plain(each.result()) for name, each in self._statistics.items()} if self._episodes else {}
        for name, counts in self._colors.items() if self._episodes else ():
            made[IMAGES + name] = _plain(color_statistics(counts, self._frames), is_image=True)
        return made

    def _info(self) -> dict[str, Any]:
        return {
            "codebase_version": VERSION,
            "robot_type": clean(self._layout.robot) or None,
            "total_episodes": self._episodes,
            "total_frames": self._frames,
            "total_tasks": len(self._tasks),
            "chunks_size": CHUNK,
            "data_files_size_in_mb": DATA_SIZE,
            "video_files_size_in_mb": VIDEO_SIZE,
            "fps": int(self._layout.fps),
            "splits": {"train": f"0:{self._episodes}"},
            "data_path": DATA,
            "video_path": VIDEO if self._layout.cameras else None,
            "features": features(self._layout),
        }

    def _parquet(self, path: str, table: pyarrow.Table) -> OutputWriter:
        writer = self._stack.enter_context(OutputWriter(StagedFile(self._folder / path)))
        with writer.writing(), writer.open_file() as file:
            pyarrow.parquet.write_table(table, file, **OPTIONS)
        return writer


# --- files ---------------------------------------------------------------------------------------


class _TableFiles:
    """Parquet files of tables, one for each episode as a row group; a new file is begun before one is too large.

    Attributes:
      number: number of the current file.
    """

    def __init__(self, stack: ExitStack, folder: Path, pattern: str, schema: pyarrow.Schema) -> None:
        self._stack, self._folder, self._pattern, self._schema = stack, folder, pattern, schema
        self.number, self._size = 0, 0
        self._writers = list[OutputWriter]()
        self._file: pyarrow.parquet.ParquetWriter | None = None
        self._stream: BinaryIO

    def add(self, table: pyarrow.Table) -> int:
        """Adds a table, and returns the number of its file."""
        self.make_room(table.nbytes)
        self.write(table)
        return self.number

    def make_room(self, size: int) -> None:
        """Begins a new file if the current one has no room for a table of this size [bytes]."""
        if self._size and self._size + size > DATA_SIZE * MEGABYTE:
            self._close()
            self.number, self._size = self.number + 1, 0
        self._size += size

    def write(self, table: pyarrow.Table) -> None:
        """Writes a table to the current file, which has room for it."""
        if self._file is None:
            path = self._folder / self._pattern.format(**_indices(self.number))
            writer = self._stack.enter_context(OutputWriter(StagedFile(path)))
            self._writers.append(writer)
            self._stream = writer.open_file()
            self._file = pyarrow.parquet.ParquetWriter(self._stream, self._schema, **OPTIONS)
            writer.resources.enter_context(closing_quietly(self._file))  # before its stream, where an episode fails
        with self._writers[-1].writing():
            self._file.write_table(table, max(1, table.num_rows))  # one group, of any number of rows

    def read(self, rows: Sequence[Mapping[str, Any]]) -> Iterator[tuple[int, pyarrow.Table]]:
        """Yields the tables of episodes that the folder has, and continues the last of their files."""
        last = _number(rows[-1], "data")
        file, number, group = None, -1, 0
        for row in rows:
            if number != _number(row, "data"):
                number, group = _number(row, "data"), 0
                file = pyarrow.parquet.ParquetFile(self._folder / self._pattern.format(**_indices(number)))
            assert file is not None
            content = file.read_row_group(group).cast(self._schema)
            # As large as it was when it was written: a table that is read has bits of validity in addition.
            table = _table(self._schema, {name: _values(content, name) for name in self._schema.names})
            group += 1
            if number == last:
                self.number = last
                self.add(table)
            yield row["episode_index"], table

    def finish(self) -> list[OutputWriter]:
        """Returns the writers of all files."""
        self._close()
        return [*self._writers]

    def _close(self) -> None:
        if self._file:
            with self._writers[-1].writing():
                self._file.close()
                self._stream.close()  # what it still holds is to be on the disk before the file is published
        self._file = None


class _EpisodeRows:
    """The table of episodes."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        self._stack, self._folder = stack, folder
        self._files: _TableFiles | None = None
        self._rows = list[dict[str, Any]]()

    def add(self, row: dict[str, Any]) -> None:
        """Adds the row of an episode."""
        self._rows.append(row)
        if len(self._rows) == ROWS:
            self._write()

    def finish(self) -> list[OutputWriter]:
        """Returns the writers of all files."""
        self._write()
        return self._files.finish() if self._files else []

    def _write(self) -> None:
        if not self._rows:
            return
        rows = pyarrow.Table.from_pylist(self._rows)
        if self._files is None:
            indices = [pyarrow.field(f"meta/episodes/{name}", pyarrow.int64()) for name in _indices(0)]
            self._files = _TableFiles(self._stack, self._folder, EPISODES, pyarrow.schema([*rows.schema, *indices]))
        self._files.make_room(rows.nbytes)
        for name, value in _indices(self._files.number).items():
            rows = rows.append_column(f"meta/episodes/{name}", pyarrow.array([value] * len(self._rows)))
        self._files.write(rows)
        self._rows = []


class _VideoFiles:
    """Video files of a camera; a new file is begun before one is too large or too long, or if the codec differs."""

    def __init__(self, stack: ExitStack, folder: Path, camera: CameraVideoLayout, fps: Fraction) -> None:
        self._stack, self._folder, self._fps = stack, folder, fps
        self._key = f"{IMAGES}{camera.name}"
        self._number = self._size = self._frames = 0
        self._parts = list[Mp4Samples]()
        self._writers = list[OutputWriter]()

    def add(self, video: Mp4Samples, count: int) -> tuple[int, int]:
        """Adds the video of an episode, and returns the number of its file, and of its first frame in it.

        Raises:
          FileError: the video has another number of frames than the episode.
        """
        if len(video) != count:
            raise FileError(video.path, f"has {len(video)} frames, expected {count}")
        size = int(video.lengths.sum())
        is_full = self._size + size > VIDEO_SIZE * MEGABYTE or (self._frames + count) / self._fps > LONGEST
        if self._parts and (is_full or video.description != self._parts[0].description):
            self._write()
            self._number, self._size, self._frames = self._number + 1, 0, 0
        first = self._frames
        self._parts.append(video)
        self._size, self._frames = self._size + size, self._frames + count
        return self._number, first

    def read(self, rows: Sequence[Mapping[str, Any]], key: str) -> None:
        """Continues the last file of episodes that the folder has."""
        last = _number(rows[-1], key)
        lengths = [row["length"] for row in rows if _number(row, key) == last]
        video = read_samples(self._path(last)).part(0, sum(lengths))
        if len(video) != sum(lengths):
            raise ValueError(f"{self._path(last)} has {len(video)} frames, expected {sum(lengths)}")
        self._number, self._parts = last, [video]
        self._size, self._frames = int(video.lengths.sum()), len(video)

    def finish(self) -> list[OutputWriter]:
        """Returns the writers of all files."""
        self._write()
        return self._writers

    def _path(self, number: int) -> Path:
        return self._folder / VIDEO.format(video_key=self._key, **_indices(number))

    def _write(self) -> None:
        if self._parts:
            writer = self._stack.enter_context(OutputWriter(StagedFile(self._path(self._number))))
            with writer.writing(), writer.open_file() as file:
                join(file, self._parts, self._fps)
            self._writers.append(writer)
        self._parts = []


def _indices(number: int) -> dict[str, int]:
    """Returns the indices of the folder and the file with this number."""
    return {"chunk_index": number // CHUNK, "file_index": number % CHUNK}


def _number(row: Mapping[str, Any], key: str) -> int:
    return row[f"{key}/chunk_index"] * CHUNK + row[f"{key}/file_index"]


def _place(key: str, number: int) -> dict[str, int]:
    return {f"{key}/{name}": value for name, value in _indices(number).items()}


# --- statistics ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class FeatureStatistics:
    """Statistics of a feature, over the rows of an episode or over the pixels of images.

    Attributes:
      count: number of rows.
      min, max, mean, std: the statistics of each column `(n,)`.
      quantiles: those in `QUANTILES`, of each column `(n,)`.
    """

    count: int
    min: np.ndarray
    max: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    quantiles: dict[str, np.ndarray]


class RunningStatistics:
    """Statistics of rows that arrive piece by piece.

    Quantiles are those of all rows, or of `SAMPLED` rows at most at equal distances. Memory does not grow with the
    number of rows.
    """

    def __init__(self) -> None:
        self._count, self._distance = 0, 1
        self._mean = self._squares = np.zeros(0)  # `squares`: sum of the squared deviations from the mean
        self._min = self._max = np.zeros(0)
        self._sample = np.zeros((0, 0))

    def add(self, rows: np.ndarray) -> None:
        """Adds rows `(k, n)` of finite numbers.

        The formulas of Chan, Golub and LeVeque combine means and deviations without loss of digits.
        """
        if not len(rows):
            return
        rows = rows.astype(float)
        if not self._count:
            self._mean, self._squares = np.zeros((2, rows.shape[1]))
            self._min, self._max = rows[0], rows[0]
            self._sample = np.zeros((0, rows.shape[1]))
        mean = rows.mean(axis=0)
        before, self._count = self._count, self._count + len(rows)
        self._squares = self._squares + ((rows - mean) ** 2).sum(axis=0)
        self._squares += (mean - self._mean) ** 2 * before * len(rows) / self._count
        self._mean = self._mean + (mean - self._mean) * len(rows) / self._count
        self._min, self._max = np.minimum(self._min, rows.min(axis=0)), np.maximum(self._max, rows.max(axis=0))
        self._keep(rows[-before % self._distance :: self._distance])

    def result(self) -> FeatureStatistics:
        """Returns the statistics of all rows, at least one."""
        values = np.quantile(self._sample, list(QUANTILES.values()), axis=0)
        quantiles = dict(zip(QUANTILES, values, strict=True))
        std = np.sqrt(self._squares / self._count)
        return FeatureStatistics(self._count, self._min, self._max, self._mean, std, quantiles)

    def _keep(self, rows: np.ndarray) -> None:
        """Adds rows to the sample, and halves it when it is full."""
        self._sample = np.concatenate([self._sample, rows])
        while len(self._sample) > SAMPLED:
            self._sample, self._distance = self._sample[::2], 2 * self._distance


def color_statistics(counts: np.ndarray, images: int) -> FeatureStatistics:
    """Returns the statistics of the channels of images, from 0 to 1.

    Args:
      counts: the number of pixels with each value of each channel `(3, 256)`.
      images: number of images.
    """
    values = np.arange(MOST + 1) / MOST
    totals = counts.sum(axis=1)
    mean = counts @ values / totals
    std = np.sqrt(np.maximum(counts @ values**2 / totals - mean**2, 0))
    present = counts > 0
    low, high = values[present.argmax(axis=1)], values[MOST - present[:, ::-1].argmax(axis=1)]
    below = np.cumsum(counts, axis=1)
    quantiles = {
        name: np.array([values[np.searchsorted(row, share * row[-1])] for row in below])
        for name, share in QUANTILES.items()
    }
    return FeatureStatistics(images, low, high, mean, std, quantiles)


# --- contents ------------------------------------------------------------------------------------


def _dtype(kind: pyarrow.DataType) -> Any:
    inner = kind.value_type if pyarrow.types.is_fixed_size_list(kind) else kind
    return inner.to_pandas_dtype()


def _table(schema: pyarrow.Schema, columns: Mapping[str, np.ndarray]) -> pyarrow.Table:
    """Returns the table of `columns` `(T, n)`."""
    arrays = list[pyarrow.Array]()
    for field in schema:
        values = pyarrow.array(columns[field.name].ravel())
        if pyarrow.types.is_fixed_size_list(field.type):
            values = pyarrow.FixedSizeListArray.from_arrays(values, field.type.list_size)
        arrays.append(values)
    return pyarrow.Table.from_arrays(arrays, schema=schema)


def _values(table: pyarrow.Table, name: str) -> np.ndarray:
    """Returns a column as rows `(T, n)`."""
    column = table.column(name).combine_chunks()
    if pyarrow.types.is_fixed_size_list(column.type):
        column = column.flatten()
    return column.to_numpy(zero_copy_only=False).reshape(table.num_rows, -1)


def _plain(statistics: FeatureStatistics, is_image: bool = False) -> dict[str, Any]:
    """Returns statistics as lists; those of images have the shape (3, 1, 1)."""
    shape: Callable[[np.ndarray], Any] = lambda row: (row.reshape(-1, 1, 1) if is_image else row).tolist()  # noqa: E731
    numbers = {"min": statistics.min, "max": statistics.max, "mean": statistics.mean, "std": statistics.std}
    made = {name: shape(row) for name, row in numbers.items()}
    return {**made, "count": [statistics.count], **{name: shape(row) for name, row in statistics.quantiles.items()}}


def _row_statistics(name: str, statistics: FeatureStatistics) -> dict[str, Any]:
    made = _plain(statistics, is_image=name.startswith(IMAGES))
    return {f"stats/{name}/{key}": value for key, value in made.items()}


def _task_table(tasks: Sequence[str]) -> pyarrow.Table:
    """Returns the table of tasks, whose texts are the index that pandas reads."""
    columns = [
        {"name": "task_index", "field_name": "task_index", "pandas_type": "int64", "numpy_type": "int64"},
        {"name": "task", "field_name": "task", "pandas_type": "unicode", "numpy_type": "object"},
    ]
    pandas = {
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [{**column, "metadata": None} for column in columns],
        "pandas_version": "2.0.0",
    }
    table = pyarrow.table({"task_index": np.arange(len(tasks)), "task": pyarrow.array(tasks, pyarrow.string())})
    return table.replace_schema_metadata({"pandas": json.dumps(pandas)})


def _json(document: object) -> bytes:
    return f"{json.dumps(document, indent=4, allow_nan=False)}\n".encode()


def _card(layout: EpisodeLayout, episodes: int, frames: int, tasks: Sequence[str]) -> str:
    """Returns the card that the Hub shows."""
    described = [
        f"| `{key}` | {feature['dtype']} | {' × '.join(map(str, feature['shape']))} |"
        for key, feature in features(layout).items()
    ]
    origin = [f"- {name}: {_inline(text)}" for name, text in layout.origin.items() if text]
    return "\n".join(
        [
            "---",
            "task_categories:",
            "- robotics",
            "tags:",
            "- LeRobot",
            "- MuJoCo",
            "configs:",
            "- config_name: default",
            "  data_files: data/*/*.parquet",
            "---",
            "",
            f"# {_inline(layout.robot) or 'Episodes'}",
            "",
            f"A LeRobot dataset ({VERSION}) of {episodes:,} simulated episodes, {frames:,} frames at {int(layout.fps)} "
            "frames per second, made by mjrun.",
            "",
            "| feature | type | shape |",
            "|---|---|---|",
            *described,
            "",
            f"Tasks: {'; '.join(_inline(task) for task in tasks[:20])}{' …' if len(tasks) > 20 else ''}",
            "",
            *origin,
            "",
        ]
    )


def _inline(text: str) -> str:
    """Returns untrusted text in which neither HTML nor Markdown means anything."""
    return "".join(f"\\{char}" if char in "\\`*_[]|#~" else char for char in html.escape(clean(text), quote=False))
