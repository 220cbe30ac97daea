"""Plot output: measured values over time, as a figure."""

from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UsageError, concerning, option, quoted
from mjrun.formats.image_format import figure_format
from mjrun.options.option import options
from mjrun.options.plot import PlotOptions
from mjrun.outputs import output
from mjrun.outputs.output_files import named_files
from mjrun.outputs.trace import row_steps
from mjrun.outputs.trace_rows import ProbeSampler, RowBuffer
from mjrun.physics.observe import AnyTap, Tap
from mjrun.plotting.figure_plan import FigurePlan, TableColumns
from mjrun.plotting.figure_writer import FigureWriter, require_matplotlib
from mjrun.plotting.panel import Panel, panels_by_unit
from mjrun.probe.select import split


@options
class Plot(PlotOptions, output.Job["PlotResult"]):
    """A plot of values measured in a simulation: its options are keywords."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.probe:
            raise UsageError(f"{option('probe')}: a plot requires values, as in energy or qpos[left_*]")

    @property
    def files(self) -> list[tuple[str, str]]:
        """Every file that is written, with its role."""
        return named_files(output=self.output, manifest=self.manifest)

    def check(self) -> None:
        """Checks the format.

        Raises:
          UsageError: the format cannot hold a plot, or matplotlib is missing.
        """
        require_matplotlib()
        figure_format(self.output, self.format)

    def plan(self, context: output.Context) -> "output.Plan[PlotResult]":
        """Resolves the probes in the model and the curves among their columns."""
        panels: list[Panel] = []
        for index, text in enumerate(self.probe):
            with concerning("probe", index):
                probed = ProbeSampler(context.model, split(text), context.timeline, context.episode).columns[1:]
                if not probed:
                    raise UsageError(f"plot {quoted(text)}: this model has no such values")
                panels += panels_by_unit([c.name for c in probed], {c.name: c.unit for c in probed})
        # One table for all panels, so that each instant is computed once.
        probes = [part for text in self.probe for part in split(text)]
        table = ProbeSampler(context.model, list(dict.fromkeys(probes)), context.timeline, context.episode)
        columns = TableColumns(Path(self.output).stem, {column.name: column.unit for column in table.columns})
        figure = FigurePlan(self, [columns], panels)
        steps = row_steps(context.timeline, self.every, self.rate)

        about = f"{figure_format(self.output, self.format)}, {'; '.join(panel.label for panel in figure.panels)}"
        preview = output.Preview("plot", self.output, len(steps), "samples", figure.grid.size, about)
        opened = partial(PlotOutput, self, context, table, steps, figure)
        return output.Plan(preview, context.timeline.steps, opened, table.model.opt.enableflags)


@dataclass(frozen=True)
class PlotResult(output.OutputResult):
    """The result of a plot output.

    Attributes:
      path: path of the plot.
      size: width and height [pixels].
      samples: the number of samples of each curve.
      panels: their labels, in order.
      wall: total wall time [s].
      warnings: MuJoCo's warnings.
    """

    size: tuple[int, int]
    samples: int
    panels: Sequence[str]
    wall: float
    warnings: Sequence[str]


class PlotOutput(output.Output[PlotResult]):
    """A plot with an open file.

    Args:
      table: the columns of all panels.
      steps: the steps of the samples.
      figure: the plan of the figure.
    """

    def __init__(
        self,
        job: Plot,
        context: output.Context,
        table: ProbeSampler,
        steps: Sequence[int],
        figure: FigurePlan,
        stack: ExitStack,
        _: output.SharedRendering,
    ) -> None:
        self._job, self._reporter, self._table, self._steps, self._figure = job, context.reporter, table, steps, figure
        self._names = [column.name for column in table.columns]
        self._collector = figure.collector(0)
        self._buffer = RowBuffer(table, steps, lambda block: self._take(block.values))
        self.facts = context.facts(job)
        tags, form = output.metadata_tags(job.output, self.facts), figure_format(job.output, job.format)
        self._writer = stack.enter_context(FigureWriter(job.output, form, figure.grid.size, tags))

    def taps(self, event_steps: output.EventSteps) -> Sequence[AnyTap]:
        return [Tap(self._steps, self._table.read, self._buffer.add)]

    def finish(self) -> Sequence[FigureWriter]:
        self._buffer.flush()
        for text in (*self._figure.notes, *self._collector.notes()):
            self._reporter.note(text)
        self._writer.write(self._figure.drawing([self._collector]), self._figure.grid, self._job.style)
        self._writer.finish()
        return [self._writer]

    def result(self, files: Sequence[Path], summary: output.PassSummary) -> PlotResult:
        return PlotResult(
            path=str(Path(self._job.output)),
            size=self._figure.grid.size,
            samples=self._collector.rows,
            panels=[panel.label for panel in self._figure.panels],
            wall=summary.wall,
            warnings=summary.warnings,
        )

    def _take(self, rows: np.ndarray) -> None:
        self._collector.feed(dict(zip(self._names, rows.T, strict=True)))
