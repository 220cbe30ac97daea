"""Files of single points of a study: traces, recordings and videos of the points that options choose.

Each file is made by the ordinary output of its kind, in a separate process.
"""

import contextlib
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import cast

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, MjrunError, UnknownNameError, UsageError, attributing, clean, concerning, option
from mjrun.experiment.design import parameter_names
from mjrun.experiment.results_table import ColumnVocabulary
from mjrun.formats.codecs import encoding
from mjrun.formats.local_and_remote_folders import LocalFolder, written_file
from mjrun.formats.study_reader import NAME, POINTS, point_folders, read_point, values_in_words
from mjrun.formats.temporary_output import remove_left_behind, scratch_folder
from mjrun.options.option import values_of
from mjrun.options.sweep import KeptFileOptions
from mjrun.options.video import PointOrEpisodeVideoOptions
from mjrun.outputs.output import OutputRequest, OutputResult, ReservedFiles
from mjrun.platform.cores import available_cores
from mjrun.probe.row_expression import Condition, parse_condition
from mjrun.probe.select import selected_columns
from mjrun.python_code import PickledWithCode
from mjrun.reporter import Reporter
from mjrun.simulation.origin import plain
from mjrun.simulation.simulation import Simulation
from mjrun.study.isolation import LocalExecutor, process_stop
from mjrun.study.prepared import PreparedStudy
from mjrun.study.results import STATUSES, ResultColumns, with_flags
from mjrun.study.spec import PointResult
from mjrun.worker import Worker, WorkerEndedError

NAMES = {"trace": "trace.parquet", "recording": "recording.npz", "video": "video.mp4"}
_RANKED = re.compile(r"\s*([1-9]\d*)\s*:(.+)", re.DOTALL)


@dataclass(frozen=True)
class KeptFiles:
    """Files of single points that a study keeps.

    Attributes:
      points: numbers of the points whose files are kept.
      made: number of points of which files were missing.
      files: all files that exist.
      failures: reasons why files could not be made, by the number of the point.
    """

    points: Sequence[int] = ()
    made: int = 0
    files: Sequence[str] = ()
    failures: Mapping[int, str] = field(default_factory=dict[int, str])


class PointFileMaker:
    """A maker of the files of points. The options are checked before there are any results.

    Args:
      simulates: whether the files are made after a simulation, before which this machine must be able to make them.

    Raises:
      UsageError: a name is unknown, or a value is invalid.
      MjrunError: this machine cannot make the files.
    """

    def __init__(self, options: KeptFileOptions, prepared: PreparedStudy, *, simulates: bool = False) -> None:
        self._prepared = prepared
        self._options = replace(keep_options(options), probe=_probes(options, prepared))
        self._choice = PointSelection(options, prepared.points.names, [name for name, _ in prepared.spec.metrics])
        kinds = {*options.keep, *(["video"] if options.contact_sheet is not None else [])}
        self.kinds = tuple(kind for kind in NAMES if kind in kinds)
        if self.kinds and not isinstance(prepared.folder, LocalFolder):
            name, url = "keep" if options.keep else "contact_sheet", clean(prepared.folder.path())
            where = f"files of points are made on this machine, and {url} is in a store"
            raise UsageError(f"{option(name)}: {where}\nuse a local folder with the same points")
        if options.contact_sheet is not None:
            with attributing("output", "contact_sheet"):
                reserved = ReservedFiles()
                reserved.reserve(prepared.folder.path(POINTS), "the files of points")
                reserved.reserve(options.contact_sheet, option("contact_sheet"))
                encoding(options.contact_sheet).check_fps(options.fps)
        if self.kinds:
            from mjrun.formats.ffmpeg import VideoWriter
            from mjrun.outputs.perform import preview, rehearse

            first = self._outputs(0, PointResult(0, "ok", (), 0))
            with scratch_folder() as folder:
                requests = replace(first, simulation=prepared.first, folder=folder).requests(self.kinds)
                check = rehearse if simulates else preview
                check(requests)
            if simulates and options.contact_sheet is not None:
                with VideoWriter(options.contact_sheet, encoding(options.contact_sheet), options.size, options.fps):
                    pass  # which shows that it can be written

    def remove_left_behind(self) -> None:
        """Removes what ended processes have left in the folders of points."""
        folder = self._prepared.folder
        for each in point_folders(folder.path()).values() if isinstance(folder, LocalFolder) else ():
            remove_left_behind(each)

    def points_with_files(self) -> list[int]:
        """Returns the points that have files of their present simulation, whichever run has made them."""
        prepared = self._prepared
        if not isinstance(prepared.folder, LocalFolder):
            return []
        count = len(prepared.points.points)
        folders = {index: path for index, path in point_folders(prepared.folder.path()).items() if index < count}
        keys = prepared.keys_of([*folders])
        return [
            index
            for (index, path), key in zip(folders.items(), keys, strict=True)
            if read_point(path).get("key") == key
        ]

    def keep(
        self, columns: Mapping[str, np.ndarray], results: ResultColumns, jobs: int | str, reporter: Reporter
    ) -> KeptFiles:
        """Makes the missing files of the chosen points.

        Args:
          columns: parameters and metrics as numbers `(n,)`.
          jobs: number of processes.
        """
        if not self.kinds:
            return KeptFiles()
        # Another simulation of such a point costs no process, and has a step at least.
        status = np.array(STATUSES)[results.status]
        able = (status == "ok") | ((status == "unstable") & (results.steps > 1))
        if lost := int((~able).sum()):
            plural = "s" if lost > 1 else ""
            reporter.note(f"{lost} point{plural} without a completed step, or that ended the process: no files")
        chosen = self._choice.points(columns, status, able)
        outputs = {index: self._outputs(index, results[index]) for index in chosen}
        missing = [index for index, each in outputs.items() if each.missing()]
        failures = dict[int, str]()
        try:
            with LocalExecutor(jobs if isinstance(jobs, int) else available_cores()) as pool:
                messages = pool.map(make_isolated, [outputs[index] for index in missing])
                for done, (index, message) in enumerate(zip(missing, messages, strict=True), 1):
                    if message:
                        failures[index] = message
                    failed = f", {len(failures)} failed" if failures else ""
                    reporter.progress(f"files of points{failed}", done, len(missing))
        except BaseException:  # such as an interruption, after which the processes have been killed
            self.remove_left_behind()
            raise
        sheet = self._contact_sheet([i for i in chosen if i not in failures], outputs, results, reporter)
        paths = [each.folder / NAMES[kind] for each in outputs.values() for kind in self.kinds]
        return KeptFiles(chosen, len(missing), [*(str(path) for path in paths if path.is_file()), *sheet], failures)

    def _contact_sheet(
        self,
        points: Sequence[int],
        outputs: Mapping[int, "PointFileRequest"],
        results: Sequence[PointResult],
        reporter: Reporter,
    ) -> list[str]:
        """Makes the contact sheet if it is requested, and returns its path."""
        from mjrun.study.video_grid import MOST, VideoCell, write_contact_sheet

        path, options = self._options.contact_sheet, self._options
        if path is None:
            return []
        if not points:
            reporter.warn(f"{clean(path)} is not made: no point has a video")
            return []
        if len(points) > MOST:
            reporter.note(f"{clean(path)} shows {MOST} of {len(points)} points, evenly chosen")
            points = [points[i] for i in np.linspace(0, len(points) - 1, MOST).round().astype(int)]
        reporter.note(f"{clean(path)}: points {', '.join(map(str, points))}")
        cells = [
            VideoCell(
                outputs[index].folder / NAMES["video"],
                "\n".join(values_in_words(self._prepared.points.values(index), self._prepared.units)),
                f"unstable at step {results[index].steps}" if results[index].status == "unstable" else "",
            )
            for index in points
        ]
        return [str(file) for file in write_contact_sheet(path, cells, options.fps, options.speed)]

    def _outputs(self, index: int, result: PointResult) -> "PointFileRequest":
        prepared = self._prepared
        simulation = prepared.spec.simulation(prepared.points.points[index])
        if result.status == "unstable":
            simulation = up_to(simulation, result.steps - 1)
        metrics = {name: value for (name, _), value in zip(prepared.spec.metrics, result.metrics, strict=False)}
        facts = {
            "point": index,
            "values": prepared.points.values(index),
            "status": result.status,
            "steps": result.steps,
            "metrics": {name: value if np.isfinite(value) else None for name, value in metrics.items()},
        }
        folder = Path(prepared.folder.path(POINTS)) / f"{index:06}"
        key, every = prepared.keys[index], prepared.spec.every
        return PointFileRequest(folder, simulation, key, self.kinds, self._options, every, facts)


def _probes(options: KeptFileOptions, prepared: PreparedStudy) -> Sequence[str]:
    """Returns the probes of traces: those of the options, and the columns that the metrics read."""
    if "trace" not in options.keep:
        return options.probe
    episode = prepared.first.episode
    selected = selected_columns(prepared.model, options.probe, episode.columns if episode else None)
    names = {column.name for column in selected}
    return [*options.probe, *(name for name in prepared.columns if name not in names)]


class PointSelection:
    """The selection of points by conditions and ranks. The options are checked before there are any results.

    Args:
      parameters: names of the parameters.
      metrics: names of the metrics.

    Raises:
      UsageError: a condition is malformed, or a metric is unknown.
    """

    def __init__(self, options: KeptFileOptions, parameters: Sequence[str], metrics: Sequence[str]) -> None:
        names = ColumnVocabulary({**parameter_names(parameters), **dict(zip(metrics, metrics, strict=True))}, STATUSES)
        self._conditions = list[tuple[str, Condition]]()
        for index, text in enumerate(options.keep_where):
            with concerning("keep_where", index):
                self._conditions.append((text, parse_condition(with_flags(text), names, option("keep_where"))))
        ranked = (("keep_lowest", options.keep_lowest, 1), ("keep_highest", options.keep_highest, -1))
        self._ranked = [
            (*_count_and_metric(name, index, text, metrics), sign)
            for name, texts, sign in ranked
            for index, text in enumerate(texts)
        ]

    def points(self, columns: Mapping[str, np.ndarray], status: np.ndarray, able: np.ndarray) -> list[int]:
        """Returns the numbers of the points in ascending order; without a condition or rank, all that are able.

        Args:
          columns: parameters and metrics, `(n,)` each.
          status: status of each point `(n,)`.
          able: points that can be simulated again `(n,)`.

        Raises:
          UsageError: a condition reads values that are not numbers.
        """
        chosen = able.copy()
        table = {**columns, **{name: (status == name).astype(float) for name in STATUSES}}
        for text, condition in self._conditions:
            if texts := [name for name in condition.columns if name not in table]:
                raise UsageError(f"{option('keep_where')} {text}: {clean(texts[0])} has values that are not numbers")
            chosen &= np.broadcast_to(condition.holds(table), len(status))
        if not self._ranked:
            return np.flatnonzero(chosen).tolist()
        ranked = set[int]()
        for count, metric, sign in self._ranked:
            usable = np.flatnonzero(chosen & np.isfinite(columns[metric]))
            order = np.argsort(sign * columns[metric][usable], kind="stable")
            ranked.update(usable[order[:count]].tolist())
        return sorted(ranked)


def _count_and_metric(name: str, index: int, text: str, metrics: Sequence[str]) -> tuple[int, str]:
    """Splits `4:drift`."""
    with concerning(name, index):
        match = _RANKED.fullmatch(text)
        if not match:
            raise BadValueError(option(name), text, "a number of points and a metric, 4:drift")
        metric = match[2].strip()
        if metric not in metrics:
            raise UnknownNameError("metric", metric, metrics, where=option(name))
        return int(match[1]), metric


# --- one point ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PointFileRequest:
    """A request to make files of a point: a picklable value.

    Attributes:
      folder: folder of the point.
      simulation: simulation of the point; of an unstable one, up to the last good step.
      key: key of the point; see `point_keys`.
      kinds: kinds of the files; see `NAMES`.
      options: options of the files.
      every: steps between two rows of a trace.
      facts: other entries of the manifest.
    """

    folder: Path
    simulation: Simulation
    key: str
    kinds: tuple[str, ...]
    options: KeptFileOptions
    every: int
    facts: Mapping[str, object]

    def requests(self, kinds: Sequence[str]) -> list[OutputRequest[OutputResult]]:
        """Returns the outputs of these kinds."""
        return [self._request(kind, str(self.folder / NAMES[kind])) for kind in kinds]

    def missing(self) -> list[str]:
        """Returns the kinds of files that do not exist, or are of another simulation or other options."""
        digests = self._known_digests()
        return [
            kind
            for kind in self.kinds
            if digests.get(NAMES[kind]) != self._digest(kind) or not (self.folder / NAMES[kind]).is_file()
        ]

    def make(self) -> None:
        """Makes the missing files and the manifest, and removes files of an earlier simulation.

        Raises:
          MjrunError: a file could not be made; all files are as before.
        """
        from mjrun.outputs.perform import perform

        kinds, digests = self.missing(), self._known_digests()
        if kinds:
            perform(self.requests(kinds))
        digests |= {NAMES[kind]: self._digest(kind) for kind in kinds}
        for name in NAMES.values():
            if name not in digests:
                (self.folder / name).unlink(missing_ok=True)
        document = {"key": self.key, **self.facts, "files": digests}
        with written_file(self.folder / NAME, f"{json.dumps(document, indent=2)}\n".encode()) as output:
            output.publish()

    def _known_digests(self) -> dict[str, object]:
        """Returns the digests of existing files of the same simulation, by name."""
        known = read_point(self.folder)
        files = known.get("files") if known.get("key") == self.key else None
        return dict(cast("Mapping[str, object]", files)) if isinstance(files, dict) else {}

    def _request(self, kind: str, path: str) -> OutputRequest[OutputResult]:
        options = self.options
        match kind:
            case "trace":
                from mjrun.outputs.trace import Trace

                return Trace(self.simulation, path, probe=options.probe, every=self.every)
            case "recording":
                from mjrun.outputs.recording import Recording

                return Recording(self.simulation, path)
            case "video":
                from mjrun.outputs.video import Video

                return Video(self.simulation, path, jobs=1, **values_of(options, PointOrEpisodeVideoOptions))
            case _:
                raise ValueError(f"no output {kind} can be kept")

    def _digest(self, kind: str) -> str:
        """Returns a hash of everything that determines a file, except the simulation."""
        request = plain(self._request(kind, NAMES[kind]))
        assert isinstance(request, dict)
        del request["simulation"]
        return hashlib.sha256(json.dumps(request, sort_keys=True).encode()).hexdigest()[:16]


class PointFileServer:
    """Server of a process that makes the files of a point."""

    def make(self, pickled: PickledWithCode) -> None:
        """Makes the missing files of pickled `PointFileRequest`."""
        outputs = cast("PointFileRequest", pickled.open())
        snapshot = outputs.simulation.snapshot
        with snapshot.original_names_in_errors() if snapshot else contextlib.nullcontext():
            outputs.make()


def make_isolated(outputs: PointFileRequest) -> str:
    """Makes the files of a point in a separate process; returns the reason of a failure, empty on success."""
    with contextlib.closing(process_stop().new_worker(_new_worker)) as worker:
        try:
            worker.ask("make", PickledWithCode.of(outputs, outputs.simulation.code))
        except WorkerEndedError as error:
            return f"the process that simulated it {error}"
        except MjrunError as error:
            return str(error)
    return ""


def _new_worker() -> Worker:
    return Worker("mjrun.study.point_files:PointFileServer", environment={})


def up_to(simulation: Simulation, steps: int) -> Simulation:
    """Returns the same simulation, ending after `steps` steps."""
    return replace(simulation, steps=steps, duration=None)


def keep_options(options: KeptFileOptions) -> KeptFileOptions:
    """Returns these options alone, without those of derived classes."""
    return KeptFileOptions(**values_of(options, KeptFileOptions))
