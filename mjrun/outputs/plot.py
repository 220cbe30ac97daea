"""Plot output: measured values over time, as a figure."""

from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UsageError, concerning, quoted
from mjrun.formats.image_format import figure_format
from mjrun.model.table_column import Column
from mjrun.options.option import options
from mjrun.options.plot import PlotOptions
from mjrun.options.trace import PROBES
from mjrun.outputs import output
from mjrun.outputs.output_files import named_files
from mjrun.outputs.trace import row_steps
from mjrun.outputs.trace_rows import TIME, ProbeSampler, RowBuffer
from mjrun.physics.observe import AnyTap, Tap
from mjrun.plotting.figure_plan import FigurePlan, TableColumns
from mjrun.plotting.figure_writer import FigureWriter, require_matplotlib
from mjrun.plotting.panel import Panel, panels_by_unit
from mjrun.probe.select import available_columns, split


@options
class Plot(PlotOptions, output.Job["PlotResult"]):
    """A plot of values measured in a simulation: its options are keywords."""

    @property
    def target(self) -> str | None:
        """The output path; None for standard output."""
        return None if self.output == "-" else self.output

    @property
    def figure_format(self) -> str:
        """The name of the format."""
        return figure_format(self.target, self.format)

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
        _ = self.figure_format

    def plan(self, context: output.Context) -> "output.Plan[PlotResult]":
        """Resolves the probes in the model and the curves among their columns."""
        panels = self._panels(context) if self.probe else None
        # One table for all panels, so that each instant is computed once.
        probes = [part for text in self.probe for part in split(text)] or self._usual_probes(context)
        table = ProbeSampler(context.model, list(dict.fromkeys(probes)), context.timeline, context.episode)
        figure = FigurePlan(self, [_columns(table.columns)], panels)
        steps = row_steps(context.timeline, self.every, self.rate)

        about = f"{self.figure_format}, {'; '.join(panel.label for panel in figure.panels)}"
        preview = output.Preview("plot", self.output, len(steps), "samples", figure.grid.size, about)
        opened = partial(PlotOutput, self, context, table, steps, figure)
        return output.Plan(preview, context.timeline.steps, opened, table.model.opt.enableflags)

    def _panels(self, context: output.Context) -> list[Panel]:
        """Returns the panels of each probe."""
        panels: list[Panel] = []
        for index, text in enumerate(self.probe):
            with concerning("probe", index):
                probed = ProbeSampler(context.model, split(text), context.timeline, context.episode).columns[1:]
                if not probed:
                    raise UsageError(f"plot {quoted(text)}: this model has no such values")
                panels += panels_by_unit([c.name for c in probed], {c.name: c.unit for c in probed})
        return panels

    def _usual_probes(self, context: output.Context) -> Sequence[str]:
        """Returns the columns that the curves read, or the usual probes of a trace."""
        if not self.y:
            return PROBES
        available = [TIME, *available_columns(context.model, context.episode)]
        return [name for name in FigurePlan(self, [_columns(available)]).columns if name != TIME.name]


@dataclass(frozen=True)
class PlotResult(output.OutputResult):
    """The result of a plot output.

    Attributes:
      path: path of the plot.
      size: width and height [pixels].
      samples: the number of samples of each curve.
      panels: their labels, in order.
      curves: total number of curves.
      wall: total wall time [s].
      warnings: MuJoCo's warnings.
    """

    size: tuple[int, int]
    samples: int
    panels: Sequence[str]
    curves: int
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
        tags, form = output.metadata_tags(job.output, self.facts), job.figure_format
        self._writer = stack.enter_context(FigureWriter(job.target, form, figure.grid.size, tags))

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
            path=self._job.output,
            size=self._figure.grid.size,
            samples=self._collector.rows,
            panels=[panel.label for panel in self._figure.panels],
            curves=sum(len(panel.curves) for panel in self._figure.panels),
            wall=summary.wall,
            warnings=summary.warnings,
        )

    def _take(self, rows: np.ndarray) -> None:
        self._collector.feed(dict(zip(self._names, rows.T, strict=True)))


def _columns(columns: Iterable[Column]) -> TableColumns:
    return TableColumns("", {column.name: column.unit for column in columns})
