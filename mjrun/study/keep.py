"""Files of single points of a study: traces, recordings and videos of those that options choose."""

import re
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from dataclasses import replace as replaced

import numpy as np

from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean, concerning, option
from mjrun.experiment.design import parameter_names
from mjrun.experiment.results_table import TableNames
from mjrun.formats.study_folder import values_in_words
from mjrun.options.number_kinds import AUTO
from mjrun.options.sweep import KeepOptions
from mjrun.platform.cores import available_cores
from mjrun.probe.row_expression import Condition, parse_condition
from mjrun.probe.select import selected_columns
from mjrun.reporter import Reporter, WarningReporter
from mjrun.study.point_files import FOLDER, NAMES, PointOutputs, keep_options, make_isolated, up_to
from mjrun.study.prepared import PreparedStudy
from mjrun.study.results import STATUSES, with_flags
from mjrun.study.spec import PointResult

_RANKED = re.compile(r"\s*([1-9]\d*)\s*:(.+)", re.DOTALL)


@dataclass(frozen=True)
class KeptFiles:
    """What is kept of points.

    Attributes:
      points: of which files are kept, by their numbers.
      made: how many of them had files that were missing.
      files: all that are there.
      failures: of points whose files could not be made, why.
    """

    points: Sequence[int] = ()
    made: int = 0
    files: Sequence[str] = ()
    failures: Mapping[int, str] = field(default_factory=dict[int, str])


class PointKeeper:
    """Makes the files of points, checked before there are any results.

    Raises:
      UsageError: a name that is not there, or a value that cannot be.
    """

    def __init__(self, options: KeepOptions, prepared: PreparedStudy) -> None:
        self._prepared = prepared
        self._options = replaced(keep_options(options), probe=_probes(options, prepared))
        metrics = [name for name, _ in prepared.spec.metrics]
        self._choice = PointChoice(options, prepared.points.names, metrics)
        kinds = {*options.keep, *(["video"] if options.contact_sheet is not None else [])}
        self.kinds = tuple(kind for kind in NAMES if kind in kinds)
        if options.contact_sheet is not None:
            from mjrun.formats.codecs import encoding  # which takes its time, and few studies keep files

            with concerning("contact_sheet"):
                encoding(options.contact_sheet).check_fps(options.fps)
        if self.kinds:
            from mjrun.outputs.perform import preview

            first = self._outputs(0, PointResult(0, "ok", (), 0))
            preview(replaced(first, simulation=prepared.first).jobs(self.kinds), WarningReporter())

    def keep(
        self, columns: Mapping[str, np.ndarray], results: Sequence[PointResult], jobs: int | str, reporter: Reporter
    ) -> KeptFiles:
        """Makes what is missing of the files of the points that are chosen.

        Args:
          columns: what varies and metrics, as numbers `(n,)`.
          jobs: processes at a time.
        """
        if not self.kinds:
            return KeptFiles()
        able = np.array([_can_be_seen(result) for result in results])
        if lost := int((~able).sum()):
            reporter.note(f"{lost} point{'s' * (lost > 1)} without a single step, or that cost the process: no files")
        chosen = self._choice.points(columns, [result.status for result in results], able)
        outputs = {index: self._outputs(index, results[index]) for index in chosen}
        missing = [index for index, each in outputs.items() if each.missing()]
        failures: dict[int, str] = {}
        with ThreadPoolExecutor(available_cores() if jobs == AUTO else int(jobs)) as pool:
            messages = pool.map(make_isolated, [outputs[index] for index in missing])
            for done, (index, message) in enumerate(zip(missing, messages, strict=True), 1):
                if message:
                    failures[index] = clean(message)
                failed = f", {len(failures)} failed" if failures else ""
                reporter.progress(f"files of points{failed}", done, len(missing))
        sheet = self._contact_sheet([i for i in chosen if i not in failures], outputs, results, reporter)
        paths = [each.folder / NAMES[kind] for each in outputs.values() for kind in self.kinds]
        return KeptFiles(chosen, len(missing), [*(str(path) for path in paths if path.is_file()), *sheet], failures)

    def _contact_sheet(
        self,
        points: Sequence[int],
        outputs: Mapping[int, PointOutputs],
        results: Sequence[PointResult],
        reporter: Reporter,
    ) -> list[str]:
        """The video of all videos, if it is asked for."""
        from mjrun.study.contact_sheet import MOST, SheetCell, write_contact_sheet

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
        names = self._prepared.points.names
        cells = [
            SheetCell(
                outputs[index].folder / NAMES["video"],
                "\n".join(values_in_words(dict(zip(names, self._prepared.points.points[index], strict=True)))),
                f"unstable at step {results[index].steps}" if results[index].status == "unstable" else "",
            )
            for index in points
        ]
        return [str(file) for file in write_contact_sheet(path, cells, options.fps, options.speed)]

    def _outputs(self, index: int, result: PointResult) -> PointOutputs:
        prepared, values = self._prepared, self._prepared.points.points[index]
        simulation = prepared.spec.simulation(values)
        if result.status == "unstable":
            simulation = up_to(simulation, result.steps - 1)
        metrics = {name: value for (name, _), value in zip(prepared.spec.metrics, result.metrics, strict=False)}
        facts = {
            "point": index,
            "values": dict(zip(prepared.points.names, values, strict=True)),
            "status": result.status,
            "steps": result.steps,
            "metrics": {name: value if np.isfinite(value) else None for name, value in metrics.items()},
        }
        folder = prepared.folder / FOLDER / f"{index:06}"
        key, every = prepared.keys[index], prepared.spec.every
        return PointOutputs(folder, simulation, key, self.kinds, self._options, every, facts)


class PointChoice:
    """The points that options choose, checked before there are any results.

    Args:
      parameters: the names of what varies.
      metrics: their names.

    Raises:
      UsageError: a condition that is not well formed, or a metric that is not there.
    """

    def __init__(self, options: KeepOptions, parameters: Sequence[str], metrics: Sequence[str]) -> None:
        names = TableNames({**parameter_names(parameters), **dict(zip(metrics, metrics, strict=True))}, STATUSES)
        self._conditions: list[tuple[str, Condition]] = []
        for index, text in enumerate(options.keep_where):
            with concerning("keep_where", index):
                self._conditions.append((text, parse_condition(with_flags(text), names, option("keep_where"))))
        ranked = (("keep_lowest", options.keep_lowest, 1), ("keep_highest", options.keep_highest, -1))
        self._ranked = [
            (*_ranked(name, index, text, metrics), sign)
            for name, texts, sign in ranked
            for index, text in enumerate(texts)
        ]
        given = bool(self._conditions or self._ranked)
        if given and not options.keep and options.contact_sheet is None:
            raise UsageError(f"nothing is kept of the points that are chosen; see {option('keep')}")

    def points(self, columns: Mapping[str, np.ndarray], status: Sequence[str], able: np.ndarray) -> list[int]:
        """The numbers of the points, ascending: all that are able, if nothing chooses.

        Args:
          columns: what varies and metrics, `(n,)` each.
          status: of each point.
          able: which points can be simulated once more `(n,)`.

        Raises:
          UsageError: a condition reads what is not a number.
        """
        states = np.array(status)
        chosen = able.copy()
        table = {**columns, **{name: (states == name).astype(float) for name in STATUSES}}
        for text, condition in self._conditions:
            if texts := [name for name in condition.columns if name not in table]:
                raise UsageError(f"{option('keep_where')} {text}: {clean(texts[0])} has values that are not numbers")
            chosen &= np.broadcast_to(condition.holds(table), len(states))
        if not self._ranked:
            return np.flatnonzero(chosen).tolist()
        ranked = set[int]()
        for count, metric, sign in self._ranked:
            usable = np.flatnonzero(chosen & np.isfinite(columns[metric]))
            order = np.argsort(sign * columns[metric][usable], kind="stable")
            ranked.update(usable[order[:count]].tolist())
        return sorted(ranked)


def _ranked(name: str, index: int, text: str, metrics: Sequence[str]) -> tuple[int, str]:
    """The count and the metric of `4:drift`."""
    with concerning(name, index):
        found = _RANKED.fullmatch(text)
        if not found:
            raise BadValueError(option(name), text, "a number of points and a metric, 4:drift")
        metric = found[2].strip()
        if metric not in metrics:
            raise UnknownNameError("metric", metric, metrics, where=option(name))
        return int(found[1]), metric


def _probes(options: KeepOptions, prepared: PreparedStudy) -> Sequence[str]:
    """What traces measure: as the options say, and the columns that the metrics read."""
    if "trace" not in options.keep:
        return options.probe
    episode = prepared.first.episode
    selected = selected_columns(prepared.model, options.probe, episode.columns if episode else None)
    names = {column.name for column in selected}
    return [*options.probe, *(name for name in prepared.columns if name not in names)]


def _can_be_seen(result: PointResult) -> bool:
    """Whether a point can be simulated once more without losing the process, for a step at least."""
    return result.status == "ok" or (result.status == "unstable" and result.steps > 1)
