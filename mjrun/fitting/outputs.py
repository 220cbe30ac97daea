"""The files of a fit: their names are checked before hours of fitting, and all of them appear together, or none.

Among them are a table of the measured signals beside the predictions of the model before and after the fit, a page with
the fitted values, their uncertainty and these signals, and a video that shows the fitted model with the measured motion
as a ghost.
"""

import itertools
import json
import os
import shutil
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from mjrun.confinement.confinement import OUTSIDE, is_readable
from mjrun.dataclass import dataclass
from mjrun.errors import FileError, ModelError, UsageError, attributing, clean, concerning, listing, option
from mjrun.fitting.free_parameter import FreeParameter, overrides, values_at
from mjrun.fitting.prediction import Chunk, Predictor
from mjrun.fitting.result import FitResult, FittedParameter
from mjrun.fitting.shooting_fit import SHORTEST
from mjrun.fitting.shooting_problem import Solution
from mjrun.fitting.starting_states import measured_positions
from mjrun.formats.local_and_remote_folders import written_file
from mjrun.formats.output_writer import OutputWriter, StagedFile, publish_together, require_own
from mjrun.formats.table_writer import TableWriter
from mjrun.formats.tables import output_format
from mjrun.formats.temporary_output import scratch_folder, temporary_file
from mjrun.model.attribute_edits import AttributeChange, changes, with_changes
from mjrun.model.override import Override
from mjrun.model.source import ModelSource, physics_fingerprint
from mjrun.model.sources.file import FileSource
from mjrun.model.table_column import Column
from mjrun.options.fit import FitOptions
from mjrun.options.option import is_given
from mjrun.options.plot import FigureOptions
from mjrun.outputs.output import ReservedFiles, named_files
from mjrun.outputs.perform import perform, rehearse
from mjrun.outputs.video import Video
from mjrun.plotting.figure_plan import FigurePlan, TableColumns
from mjrun.plotting.figure_writer import page_svg, require_matplotlib
from mjrun.plotting.html_page import MAKER, Page, PageFactTable, PageFigure, PageWriter, check_page_name, number
from mjrun.probe.fields import field_probe
from mjrun.probe.scanner import spelled
from mjrun.reporter import PythonApiReporter, Reporter
from mjrun.simulation.simulation import Simulation
from mjrun.suffixes import is_yaml

if TYPE_CHECKING:
    from mjrun.fitting.result import FitResult

HORIZON = 8 * SHORTEST  # held-out rows predicted from one initial state
TIME = Column("time", "s", "time in the log")
HELD = Column("holdout", meaning="whether the row was held out of the fit", integer=True)
LOG = Column("log", meaning="index of the table that the row belongs to, from 0", integer=True)
Solutions = Mapping[tuple[str, str], Solution]  # by part, `fitted` or `held`, and model, `nominal` or `fitted`
WHICH = {"nominal": "predicted by the original model", "fitted": "predicted by the fitted model"}
TEXT = "fitted model; ghost: as measured"
SUFFIX = ".xml"
OF_MODEL = ("integrator", "timestep", "ground", "set", "position_control")  # options that the fitted model lacks
RANGES = "# distributions of fitted parameters, for the key vary of a study"


def comparison_columns(signals: Sequence[Column]) -> list[Column]:
    """Returns the columns: time, each signal as measured and predicted, whether it was held out, and its log."""
    columns = [TIME]
    for signal in signals:
        columns += [signal, *(replace(signal, name=f"{signal.name}/{which}", meaning=WHICH[which]) for which in WHICH)]
    return [*columns, HELD, LOG]


def comparison_rows(comparisons: Solutions, logs: Sequence[str]) -> np.ndarray:
    """Returns a row for each sample, in the order of the logs and of time: `(n, columns)`.

    Args:
      comparisons: the predictions.
      logs: names of the measured tables.
    """
    rows = np.concatenate(
        [_rows(part, comparisons, logs) for part in ("fitted", "held") if (part, "fitted") in comparisons]
    )
    return rows[np.lexsort((rows[:, 0], rows[:, -1]))]


def write_comparison(stack: ExitStack, path: str, signals: Sequence[Column], rows: np.ndarray) -> TableWriter:
    """Writes the table, to be published by the caller; `stack` removes it otherwise.

    Raises:
      FileError: the table cannot be written.
    """
    writer = stack.enter_context(TableWriter(path, output_format(path).name, comparison_columns(signals)))
    writer.write(rows)
    return writer


def _rows(part: str, comparisons: Solutions, logs: Sequence[str]) -> np.ndarray:
    solutions = [comparisons[part, which] for which in WHICH]
    chunks = solutions[0].chunks
    tables: list[np.ndarray] = []
    for index, chunk in enumerate(chunks):
        measured = chunk.values
        predicted = [measured + each.residuals[index] * each.noise for each in solutions]
        table = np.stack([measured, *predicted], axis=-1).reshape(len(measured), -1)
        last = len(measured) - (index + 1 < len(chunks) and chunks[index + 1].segment is chunk.segment)
        times = chunk.segment.times[chunk.rows]
        held, log = (np.full(len(times), value) for value in (float(part == "held"), logs.index(chunk.segment.source)))
        tables.append(np.column_stack([times, table, held, log])[:last])
    return np.concatenate(tables)


@dataclass(frozen=True, eq=False)
class FittedChunkMotion:
    """The motion of the fitted model in a stretch of a log.

    Attributes:
      chunk: the stretch.
      positions: `qpos` of the fitted model at the rows of the stretch, `(n, nq)`.
    """

    chunk: Chunk
    positions: np.ndarray


class _Progress(PythonApiReporter):
    """A reporter that passes on progress but no warnings, which would concern temporary tables."""

    def __init__(self, reporter: Reporter) -> None:
        self._reporter = reporter

    def warn(self, text: str) -> None:
        pass

    def progress(self, what: str, done: int, total: int) -> None:
        self._reporter.progress(what, done, total)


class FitVideo:
    """The video of a fit.

    Args:
      signals: names of the measured columns.

    Raises:
      UsageError: no position is measured, the camera is unknown, or no video format matches the name.
      MjrunError: this machine cannot make the video.
    """

    def __init__(self, options: FitOptions, model: mujoco.MjModel, signals: Sequence[str]) -> None:
        assert options.video is not None
        self._options, self._measured = options, measured_positions(model, signals)
        if not self._measured:
            raise UsageError(
                f"{option('video')}: no position such as qpos/knee is measured, so there is no motion to show"
            )
        if "%" in options.video or not Path(options.video).suffix:
            raise UsageError(f"{option('video')} {clean(options.video)}: give a single file such as fit.mp4")
        with attributing("output", "video"):
            rehearse([replace(self._video(Simulation(model, duration=1), options.video), jobs=1)])

    def writer(
        self, model: mujoco.MjModel, stretches: Sequence[FittedChunkMotion], delays: Sequence[float], reporter: Reporter
    ) -> OutputWriter:
        """Renders the video, to be published and closed by the caller.

        Stretches follow each other without the time between segments and logs. Positions that were not measured are
        those of the model in the ghost too.

        Args:
          model: the fitted model.
          delays: delay of each measured signal [s].

        Raises:
          MjrunError: the video cannot be rendered or written.
        """
        options = self._options
        writer = OutputWriter(StagedFile(Path(str(options.video))))
        with writer.opening(), scratch_folder() as folder:
            modelled, measured = self._rows(stretches, delays)
            for name, rows in (("model", modelled), ("log", measured)):
                path = f"{folder}/{name}.npz"
                columns = [TIME, *field_probe(model, "qpos").columns]
                with TableWriter(path, output_format(path).name, columns) as table:
                    table.write(rows)
                    table.publish()
            video = str(folder / f"video{Path(str(options.video)).suffix}")
            simulation = Simulation(model, replay=f"{folder}/model.npz")
            perform([self._video(simulation, video, f"trace={folder}/log.npz")], _Progress(reporter))
            shutil.copyfile(video, writer.destination.path)
        return writer

    def _video(self, simulation: Simulation, path: str, *ghosts: str) -> Video:
        options = self._options
        return Video(simulation, path, camera=options.camera, size=options.size, text=TEXT, ghost=ghosts)

    def _rows(self, stretches: Sequence[FittedChunkMotion], delays: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
        """Returns times of the video with positions of the model and of the ghost, `(n, 1 + nq)` each."""
        tables: list[np.ndarray] = []
        ghosts: list[np.ndarray] = []
        end = 0.0
        for stretch, following in itertools.zip_longest(stretches, stretches[1:]):
            chunk = stretch.chunk
            times = chunk.segment.times[chunk.rows]
            usual = float(np.median(np.diff(times)))
            continues = following is not None and following.chunk.segment is chunk.segment
            rows = slice(0, len(times) - continues)  # its last row is the first of the next
            ghost = stretch.positions.copy()
            for place, signal in self._measured.items():
                values = chunk.segment.values[:, signal]
                known = np.isfinite(values)
                if known.any():
                    ghost[:, place] = np.interp(times + delays[signal], chunk.segment.times[known], values[known])
            shown = end + times - times[0]
            tables.append(np.column_stack([shown, stretch.positions])[rows])
            ghosts.append(np.column_stack([shown, ghost])[rows])
            end = shown[-1] if continues else shown[-1] + usual
        return np.concatenate(tables), np.concatenate(ghosts)


class FitOutputs:
    """The files that a fit writes.

    Args:
      simulation: simulation of the model to fit.

    Raises:
      UsageError: a name does not suit its file, two outputs are the same file, or one is an input.
      FileError: a file cannot be written.
    """

    def __init__(
        self, fit: FitOptions, simulation: Simulation, predictor: Predictor, parameters: Sequence[FreeParameter]
    ) -> None:
        self._fit, self._simulation, self._predictor, self._parameters = fit, simulation, predictor, parameters
        _check_names(fit, simulation)
        self._model_file = FittedModelFile(Path(fit.output), simulation.source) if fit.output is not None else None
        if self._model_file:
            self._model_file.check(overrides(parameters, [each.value(0.5) for each in parameters]))
        signals = [column.name for column in predictor.columns]
        self._video = FitVideo(fit, predictor.model, signals) if fit.video is not None else None

    @property
    def remarks(self) -> list[str]:
        """Remarks on options that the file of the fitted model does not contain."""
        fit, simulation = self._fit, self._simulation
        others = {path for path, _ in simulation.set} - {path for path, _ in fit.free}
        names = [name for name in OF_MODEL if is_given(simulation, name) and (name != "set" or others)]
        if fit.output is None or not names:
            return []
        shown = ", ".join(map(option, names))
        return [f"{clean(fit.output)} contains only the fitted values, so later commands also need {shown}"]

    def publish(
        self,
        result: FitResult,
        comparisons: Solutions,
        logs: Sequence[str],
        reporter: Reporter,
        *,
        model_alone: bool = False,
    ) -> FitResult:
        """Writes all files, and returns the result with their names and the changes of the model.

        Args:
          comparisons: predictions by part, `fitted` or `held`, and model, `nominal` or `fitted`.
          logs: names of the measured tables.
          model_alone: whether to write only the model.

        Raises:
          MjrunError: a file cannot be written; then none is.
        """
        fit, columns = self._fit, self._predictor.columns
        values = [each.value for each in result.parameters]
        with ExitStack() as stack:
            writers: list[OutputWriter] = []
            if self._model_file:
                writer, made = self._model_file.write(stack, overrides(self._parameters, values))
                writers.append(writer)
                result = replace(result, changes=[each.sentence for each in made])
            if model_alone:
                return replace(result, files=[str(file) for file in publish_together(writers)])
            if fit.ranges is not None:
                writers.append(write_ranges(stack, fit.ranges, self._parameters, result.parameters, fit.confidence))
            rows = comparison_rows(comparisons, logs)
            if fit.comparison is not None:
                writers.append(write_comparison(stack, fit.comparison, columns, rows))
            if fit.html is not None:
                name = Path(self._simulation.source.text).name
                writers.append(write_fit_page(stack, fit.html, name, result, columns, rows, logs))
            if self._video:
                stretches = self._stretches(comparisons, logs)
                delays = {name: v for p, v in zip(self._parameters, values, strict=True) for name in p.delayed}
                late = [delays.get(column.name, 0.0) for column in columns]
                model = self._predictor.model_with(values)
                writers.append(stack.enter_context(self._video.writer(model, stretches, late, reporter)))
            return replace(result, files=[str(file) for file in publish_together(writers)])

    def _stretches(self, comparisons: Solutions, logs: Sequence[str]) -> list[FittedChunkMotion]:
        """Returns all stretches in the order of logs and time, with the motion of the fitted model."""
        stretches: list[FittedChunkMotion] = []
        for part in ("fitted", "held"):
            if solution := comparisons.get((part, "fitted")):
                values = values_at(self._parameters, solution.coordinates)
                positions = self._predictor.field("qpos", solution.chunks, values, solution.states)
                stretches += map(FittedChunkMotion, solution.chunks, positions)

        def order(stretch: FittedChunkMotion) -> tuple[int, float]:
            segment = stretch.chunk.segment
            return logs.index(segment.source), float(segment.times[stretch.chunk.rows][0])

        return sorted(stretches, key=order)


def _check_names(fit: FitOptions, simulation: Simulation) -> None:
    if fit.comparison is not None:
        with concerning("comparison"):
            output_format(fit.comparison)
    if fit.ranges is not None and not is_yaml(fit.ranges):
        raise UsageError(f"{option('ranges')} {clean(fit.ranges)}: ranges are written as .yaml")
    if fit.ranges is not None:
        require_own(Path(fit.ranges), RANGES, "ranges of an earlier fit")
    if fit.html is not None:
        check_page_name(fit.html)
        require_matplotlib()
    reserved = ReservedFiles()
    for log in [*fit.data, *fit.holdout_data]:
        reserved.reserve_input(log, "the log, which is read")
    replaced = fit.output is not None and os.path.realpath(fit.output)
    for what, path in replace(simulation, snapshot=None).inputs:
        if what != "model" or os.path.realpath(path) != replaced:
            reserved.reserve_input(path, f"the {what}, which is read")
    outputs = {"output": fit.output, "comparison": fit.comparison, "ranges": fit.ranges, "html": fit.html}
    for name, path in named_files(**outputs, video=fit.video):
        with concerning(name):
            reserved.reserve(path, f"the {name}")
            StagedFile(Path(path)).cleanup()  # shows that the file can be written


@dataclass(frozen=True)
class FittedModelFile:
    """A copy of the model's text in which only the fitted attributes differ.

    Attributes:
      path: file to write, with the suffix .xml.
      source: the model, with its overrides, which are not written.
    """

    path: Path
    source: ModelSource

    def check(self, overrides: Sequence[Override]) -> None:
        """Checks with any values that the text of the model can hold the overrides.

        Raises:
          UsageError: the path does not end in .xml, or the text cannot hold them.
        """
        main = self._main
        if self.path.suffix != SUFFIX:
            raise UsageError(f"{option('output')} {clean(str(self.path))}: a fitted model is an {SUFFIX} file")
        if not is_readable(self.path):
            raise UsageError(
                f"{option('output')} {clean(str(self.path))} {OUTSIDE}, and is read to check it\n"
                f"write it beside {clean(str(main))}, or set {option('root')} to a folder with both"
            )
        elsewhere = [each.element.file.name for each in changes(main, overrides) if each.element.file != main]
        if elsewhere:
            raise UsageError(
                f"{option('output')}: free parameters are set in {listing(list(dict.fromkeys(elsewhere)))}, which "
                f"{clean(str(main))} includes, and only one file is written\nleave {option('output')} out and edit "
                "the values there, or fit the included file"
            )
        self._text(overrides)

    def write(self, stack: ExitStack, overrides: Sequence[Override]) -> tuple[OutputWriter, list[AttributeChange]]:
        """Writes the text, to be published by the caller; `stack` removes it otherwise.

        Raises:
          FileError: the file cannot be written, or is that of the model and has changed in the meantime.
          UsageError: the text does not compile to the model with `overrides`.
        """
        is_replaced = self.path.is_file() and os.path.realpath(self.path) == os.path.realpath(self.source.text)
        if is_replaced and self.path.read_bytes() != self._main.read_bytes():
            raise FileError(self.path, "has changed since it was read, and is left unchanged")
        text, made = self._text(overrides)
        return stack.enter_context(written_file(self.path, text)), made

    def _text(self, overrides: Sequence[Override]) -> tuple[bytes, list[AttributeChange]]:
        made = changes(self._main, overrides)
        text = with_changes(self._main.read_bytes(), made)
        fitted = replace(self.source, overrides=tuple(overrides)).load()
        # A writer makes the folder of the output, which is removed with it.
        with (
            written_file(self.path, text) as output,
            output.writing(),
            temporary_file(self.path, text, SUFFIX) as beside,
            suppress(ModelError),
        ):
            if physics_fingerprint(FileSource(beside).load()) == physics_fingerprint(fitted):
                return text, made
        raise UsageError(
            f"{option('output')} {clean(str(self.path))} would not be the fitted model: an attribute of its text sets "
            f"several numbers, or a file that it includes differs there\nleave {option('output')} out, write it beside "
            f"{clean(str(self._main))}, or free single numbers such as geom/box.friction[0]"
        )

    @property
    def _main(self) -> Path:
        main = self.source.main_file
        if main is None or main.suffix != SUFFIX:
            raise UsageError(f"{option('output')}: {clean(self.source.text)} has no {SUFFIX} file to change")
        return main


def write_ranges(
    stack: ExitStack, path: str, free: Sequence[FreeParameter], fitted: Sequence[FittedParameter], confidence: float
) -> OutputWriter:
    """Writes the section `vary` of a study, to be published by the caller; `stack` removes it otherwise.

    Each parameter that an override can set alone has a normal distribution with the confidence interval of the fit,
    truncated to the bounds.

    Raises:
      FileError: the file cannot be written.
    """
    from scipy import special

    width = 2 * float(special.ndtri((1 + confidence) / 2))
    lines = [RANGES, "vary:"]
    for parameter, result in zip(free, fitted, strict=True):
        if (varied := parameter.override_path) is None:
            continue
        spread = max((result.high - result.low) / width, 1e-12 * abs(result.value), 1e-300)
        numbers = ", ".join(repr(float(n)) for n in (result.value, spread, parameter.low, parameter.high))
        lines.append(f"  {json.dumps(varied)}: {{truncnormal: [{numbers}]}}")
    return stack.enter_context(written_file(Path(path), ("\n".join(lines) + "\n").encode()))


def write_fit_page(
    stack: ExitStack,
    path: str,
    model: str,
    result: "FitResult",
    signals: Sequence[Column],
    rows: np.ndarray,
    logs: Sequence[str],
) -> PageWriter:
    """Writes the page, to be published by the caller; `stack` removes it otherwise.

    Args:
      model: name of the model.
      signals: measured columns.
      rows: rows of the comparison, `(n, columns)`.
      logs: names of the measured tables.

    Raises:
      FileError: the page cannot be written.
    """
    figures = [_figure(name, signals, rows[rows[:, -1] == log]) for log, name in enumerate(logs)]
    facts = [_parameters(result), *_inertias(result), _errors(result), *_correlations(result), _about(result)]
    writer = stack.enter_context(PageWriter(path))
    writer.write(Page(f"Fit of {clean(model)}", MAKER, figures, facts=facts))
    return writer


def _parameters(result: "FitResult") -> PageFactTable:
    rows = [
        (
            p.label,
            number(p.start),
            number(p.value),
            _interval(p.low, p.high),
            f"at its {p.bound} bound" if p.bound else "",
        )
        for p in result.parameters
    ]
    heads = ("Parameter", "Before", "Fitted", _confidence(result), "")
    return PageFactTable("Parameters", "Free parameters of the model", heads, rows, (1, 2, 3))


def _inertias(result: "FitResult") -> list[PageFactTable]:
    rows = [
        (f"{each.body} {q.name}", number(q.start), number(q.value), _interval(q.low, q.high), q.unit)
        for each in result.inertias
        for q in each.quantities
    ]
    heads = ("Quantity", "Before", "Fitted", _confidence(result), "Unit")
    caption = "Mass, centre of mass in the frame of the body, and principal moments of inertia"
    return [PageFactTable("Inertias", caption, heads, rows, (1, 2, 3))] if rows else []


def _errors(result: "FitResult") -> PageFactTable:
    rows = [
        (
            each.name,
            f"{number(each.noise)} {each.unit}".rstrip(),
            number(each.misfit),
            *(_share(e) for e in (each.nominal, each.fitted, each.holdout_nominal, each.holdout_fitted)),
        )
        for each in result.signals
    ]
    heads = ("Signal", "Residual", "Over noise", "Before", "Fitted", "Held out, before", "Held out, fitted")
    caption = "Root mean square errors of predictions, relative to the standard deviation of the signal"
    if result.loss != "linear":
        caption = f"Errors of predictions over the spread of the signal, by medians because the loss is {result.loss}"
    return PageFactTable("Errors", caption, heads, rows, range(1, 7))


def _correlations(result: "FitResult") -> list[PageFactTable]:
    paths = [each.path for each in result.parameters]
    if len(paths) < 2:
        return []
    rows = [
        (path, *(f"{value:.2f}".replace("-", "−") for value in row[: i + 1]), *[""] * (len(paths) - i - 1))
        for i, (path, row) in enumerate(zip(paths, result.correlation, strict=True))
    ]
    caption = "Near 1 or −1, two parameters compensate for each other: only their difference or sum is well determined"
    return [PageFactTable("Correlations", caption, ["", *paths], rows, range(1, len(paths) + 1))]


def _about(result: "FitResult") -> PageFactTable:
    rows = [
        ("fitted", f"{result.rows:,} rows in {result.segments} segment{'' if result.segments == 1 else 's'}"),
        ("simulated", f"{result.rollouts:,} rollouts"),
        ("searched", ", then ".join(result.ways)),
        ("condition", f"{result.condition:.4g}"),
        ("reduced χ²", f"{result.reduced_chi2:.4g}"),
        *(("changed", text) for text in result.changes),
        *(("remark", text) for text in result.remarks),
    ]
    return PageFactTable("About the fit", "Fitted data, and changes of the model", ("Fact", "Value"), rows)


def _figure(log: str, signals: Sequence[Column], rows: np.ndarray) -> PageFigure:
    """Plots every signal as measured and predicted, and its residuals."""
    panels: list[str] = []
    for signal in signals:
        measured, nominal, fitted = (spelled(f"{signal.name}{end}") for end in ("", "/nominal", "/fitted"))
        unit = f" [{signal.unit}]" if signal.unit else ""
        panels += [
            f"{signal.name}: before{unit}={nominal}, measured{unit}={measured}, fitted{unit}={fitted}",
            f"residual of {signal.name}: residual{unit}={fitted} - {measured}",
        ]
    held = rows[rows[:, -2] > 0, 0]
    marks = [f"x:held out={held[0]:.9g}"] if len(held) else []
    options = FigureOptions(y=panels, mark=marks, columns=2)
    columns = comparison_columns(signals)
    plan = FigurePlan(options, [TableColumns(log, {column.name: column.unit for column in columns})])
    collector = plan.collector(0)
    collector.feed({column.name: values for column, values in zip(columns, rows.T, strict=True)})
    svg = page_svg(plan.drawing([collector]), plan.page_grid(), options.style)
    description = f"{clean(log)}: measured, predicted by the original model, and predicted by the fitted model"
    segments = f"Each segment begins in the state that fits best; held-out data begin again about every {HORIZON} rows."
    return PageFigure(svg, description, [*plan.notes, *collector.notes(), segments])


def _confidence(result: "FitResult") -> str:
    return f"{100 * result.confidence:g} % interval"


def _interval(low: float, high: float) -> str:
    return f"{number(low)} … {number(high)}" if low < high else ""


def _share(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.3g} %"
