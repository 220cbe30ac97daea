"""A plot: measured values over time, as a figure."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mjrun.errors import UsageError, concerning, option, quoted
from mjrun.formats.figure_format import figure_format
from mjrun.options.option import options
from mjrun.options.plot import PlotOptions
from mjrun.outputs.drawing import metadata_tags
from mjrun.outputs.output_files import named_files
from mjrun.outputs.perform import perform
from mjrun.outputs.shared_rendering import SharedRendering
from mjrun.outputs.task import Artifact, Context, Job, Output, OutputResult, PassSummary, Preview
from mjrun.outputs.trace import row_steps
from mjrun.outputs.trace_rows import ProbeSampler, RowBuffer
from mjrun.physics.observe import Tap
from mjrun.plotting.figure_plan import FigurePlan, TableColumns
from mjrun.plotting.figure_writer import FigureWriter, require_matplotlib
from mjrun.plotting.panel import Panel, panels_by_unit
from mjrun.probe.select import split
from mjrun.reporter import Reporter
from mjrun.simulation.manifest import origin


@options
class Plot(PlotOptions, Job["PlotResult"]):
    """A plot of values measured in a simulation: its options are keywords."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.probe:
            raise UsageError(f"{option('probe')}: a plot needs values: energy, qpos[left_*], …")

    @property
    def files(self) -> list[tuple[str, str]]:
        """Every file that it writes, with what it is."""
        return named_files(output=self.output, manifest=self.manifest)

    def run(self, reporter: Reporter | None = None) -> "PlotResult":
        """Makes the plot. What can fail early fails before the first step.

        Raises:
          MjrunError: nothing was published, and an existing output is untouched.
        """
        return perform([self], reporter)[0]

    def task(self) -> "PlotTask":
        """Its task, with the format chosen.

        Raises:
          UsageError: a format that cannot hold a plot, or no matplotlib.
        """
        require_matplotlib()
        return PlotTask(self, figure_format(self.output, self.format))


@dataclass(frozen=True)
class PlotResult(OutputResult):
    """What plot was made.

    Attributes:
      path: where it is.
      size: width and height [pixels].
      samples: of each curve.
      panels: their labels, in order.
      wall: wall time of all [s].
      warnings: MuJoCo's.
    """

    size: tuple[int, int]
    samples: int
    panels: Sequence[str]
    wall: float
    warnings: Sequence[str]


@dataclass(frozen=True)
class PlotTask:
    """A plot, with its format chosen."""

    job: Plot
    format: str

    renderer = None

    def plan(self, context: Context) -> "PlotPlan":
        """Finds the probes in the model, and the curves among their columns."""
        job, panels = self.job, list[Panel]()
        for index, text in enumerate(job.probe):
            with concerning("probe", index):
                probed = ProbeSampler(context.model, split(text), context.timeline, context.episode).columns[1:]
                if not probed:
                    raise UsageError(f"plot {quoted(text)}: this model has none of it")
                panels += panels_by_unit([c.name for c in probed], {c.name: c.unit for c in probed})
        # One table of all, so that each instant is computed once.
        probes = [part for text in job.probe for part in split(text)]
        table = ProbeSampler(context.model, list(dict.fromkeys(probes)), context.timeline, context.episode)
        columns = TableColumns(Path(job.output).stem, {column.name: column.unit for column in table.columns})
        figure = FigurePlan(job, [columns], panels)
        return PlotPlan(self, context, row_steps(context.timeline, job.every, job.rate), table, figure)


@dataclass(frozen=True)
class PlotPlan:
    """A plot of a model.

    Attributes:
      steps: of the samples.
      table: all columns.
      figure: what is shown of them.
    """

    task: PlotTask
    context: Context
    steps: Sequence[int]
    table: ProbeSampler
    figure: FigurePlan

    keep_partial = False

    @property
    def enable_flags(self) -> int:
        return self.table.model.opt.enableflags

    @property
    def until(self) -> int:
        return self.context.timeline.steps

    def preview(self) -> Preview:
        job = self.task.job
        about = f"{self.task.format}, {'; '.join(panel.label for panel in self.figure.panels)}"
        return Preview("plot", job.output, len(self.steps), "samples", self.figure.grid.size, about)

    def open(self, stack: ExitStack, rendering: SharedRendering) -> "PlotOutput":
        job, context = self.task.job, self.context
        facts = origin(job, job.simulation, context.model, context.timeline)
        tags = metadata_tags(job.output, facts)
        writer = stack.enter_context(FigureWriter(job.output, self.task.format, self.figure.grid.size, tags))
        return PlotOutput(self, facts, writer)


class PlotOutput(Output[PlotResult]):
    """A plot whose file is open."""

    def __init__(self, plan: PlotPlan, facts: Mapping[str, object], writer: FigureWriter) -> None:
        self._plan, self._facts, self._writer = plan, facts, writer
        self._names = [column.name for column in plan.table.columns]
        self._collector = plan.figure.collector(0)
        self._buffer = RowBuffer(plan.table, plan.steps, lambda block: self._take(block.values))
        self.taps = [Tap(plan.steps, plan.table.read, self._buffer.add)]

    def finish(self) -> Artifact[PlotResult]:
        self._buffer.flush()
        figure = self._plan.figure
        for text in (*figure.notes, *self._collector.notes()):
            self._plan.context.reporter.note(text)
        self._writer.write(figure.drawing([self._collector]), figure.grid, self._plan.task.job.style)
        self._writer.finish()
        return Artifact(self._facts, [self._writer], self._result)

    def _take(self, rows: np.ndarray) -> None:
        self._collector.feed(dict(zip(self._names, rows.T, strict=True)))

    def _result(self, files: Sequence[Path], summary: PassSummary) -> PlotResult:
        job, figure = self._plan.task.job, self._plan.figure
        labels = [panel.label for panel in figure.panels]
        path = str(Path(job.output))
        return PlotResult(path, figure.grid.size, self._collector.rows, labels, summary.wall, summary.warnings)
