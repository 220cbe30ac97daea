"""Plot output: measured values over time, as a figure."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import field

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UsageError, concerning, quoted
from mjrun.formats.image_format import figure_format
from mjrun.model.table_column import Column
from mjrun.options.option import options
from mjrun.options.plot import PlotOptions
from mjrun.options.trace import PROBES
from mjrun.outputs import output
from mjrun.outputs.trace import row_steps
from mjrun.outputs.trace_rows import TIME, ProbeSampler, RowBuffer
from mjrun.physics.simulation_loop import Tap
from mjrun.physics.stepper import Stepper
from mjrun.plotting.figure_plan import FigurePlan, Panel, TableColumns, panels_by_unit
from mjrun.plotting.figure_writer import FigureWriter, require_matplotlib
from mjrun.probe.select import available_columns, split


@options
class Plot(PlotOptions, output.OutputRequest["PlotResult"]):
    """A plot of values measured in a simulation: its options are keywords."""

    @property
    def target(self) -> str | None:
        """The output path; None for standard output."""
        return None if self.output == "-" else self.output

    @property
    def figure_format(self) -> str:
        """The name of the format."""
        return figure_format(self.target, self.format)

    def check(self) -> None:
        """Checks the format.

        Raises:
          UsageError: the format cannot hold a plot, or matplotlib is missing.
        """
        require_matplotlib()
        _ = self.figure_format

    def plan(self, context: output.PassContext) -> "output.OutputPlan[PlotResult]":
        """Resolves the probes in the model and the curves among their columns."""
        panels = self.probe_panels(context)  # first, since it names the probe that is wrong
        table = self.probe_sampler(context)
        figure = FigurePlan(self, [table_columns(table.columns)], panels)
        steps = row_steps(context.timeline, self.every, self.rate)

        about = f"{self.figure_format}, {'; '.join(panel.label for panel in figure.panels)}"
        preview = output.OutputPreview("plot", self.output, len(steps), "samples", figure.grid.size, about)
        return output.OutputPlan(
            preview=preview,
            until=context.timeline.steps,
            open=lambda stack, _: OpenPlot(self, context, table, steps, figure, stack),
            enable_flags=table.model.opt.enableflags,
        )

    def probe_sampler(self, context: output.PassContext) -> ProbeSampler:
        """Returns the sampler of the columns of all panels, so that each instant is computed once."""
        probes = [part for text in self.probe for part in split(text)] or self._usual_probes(context)
        return ProbeSampler(context.model, list(dict.fromkeys(probes)), context.timeline, context.episode)

    def probe_panels(self, context: output.PassContext) -> list[Panel] | None:
        """Returns the panels of each probe; None if there are no probes."""
        if not self.probe:
            return None
        panels: list[Panel] = []
        for index, text in enumerate(self.probe):
            with concerning("probe", index):
                probed = ProbeSampler(context.model, split(text), context.timeline, context.episode).columns[1:]
                if not probed:
                    raise UsageError(f"plot {quoted(text)}: this model has no such values")
                panels += panels_by_unit([c.name for c in probed], {c.name: c.unit for c in probed})
        return panels

    def _usual_probes(self, context: output.PassContext) -> Sequence[str]:
        """Returns the columns that the curves read, or the usual probes of a trace."""
        if not self.y:
            return PROBES
        available = [TIME, *available_columns(context.model, context.episode)]
        return [name for name in FigurePlan(self, [table_columns(available)]).columns if name != TIME.name]


@dataclass(frozen=True)
class PlotResult(output.OutputResult):
    """The result of a plot output.

    Attributes:
      path: path of the plot.
      size: width and height [pixels].
      samples: the number of samples of each curve; of all points, if parameters vary.
      panels: their labels, in order.
      curves: total number of curves.
      points: the samples of each point, by its values; empty unless parameters vary.
    """

    size: tuple[int, int]
    samples: int
    panels: Sequence[str]
    curves: int
    points: Mapping[str, int] = field(default_factory=dict[str, int])


class OpenPlot(output.OpenBlockOutput[PlotResult]):
    """A plot with an open file.

    Args:
      table: the columns of all panels.
      steps: the steps of the samples.
      figure: the plan of the figure.
    """

    def __init__(
        self,
        request: Plot,
        context: output.PassContext,
        table: ProbeSampler,
        steps: Sequence[int],
        figure: FigurePlan,
        stack: ExitStack,
    ) -> None:
        self._request, self._context, self._table, self._steps, self._figure = request, context, table, steps, figure
        self._collectors = [figure.collector(index) for index in range(len(figure.tables))]
        self._buffer = RowBuffer(table, steps, lambda block: self.feed(0, table.names, block.values))
        self.taps = [Tap(steps, self._buffer.record)]
        self._facts = context.facts(request)
        tags, form = output.metadata_tags(request.output, self._facts), request.figure_format
        self._writer = stack.enter_context(FigureWriter(request.target, form, figure.grid.size, tags))

    def simulate(self, stepper: Stepper, until: int) -> None:
        """Steps physics in C, block by block."""
        for block in self._table.blocks(stepper, self._steps):
            self.feed(0, self._table.names, block().values)
        stepper.advance(until)

    def finish(self, simulation_wall: float) -> output.FinishedOutput[PlotResult]:
        self._buffer.flush()
        for text in (*self._figure.notes, *(text for collector in self._collectors for text in collector.notes())):
            self._context.reporter.note(text)
        self._writer.write(self._figure.drawing(self._collectors), self._figure.grid, self._request.style)
        result = PlotResult(
            path=self._request.output,
            size=self._figure.grid.size,
            samples=sum(self.rows),
            panels=[panel.label for panel in self._figure.panels],
            curves=sum(len(panel.curves) for panel in self._figure.panels) * len(self._collectors),
        )
        self._writer.finish()
        return output.FinishedOutput(result, [self._writer], self._facts)

    @property
    def rows(self) -> list[int]:
        """The number of rows of each table."""
        return [collector.rows for collector in self._collectors]

    def feed(self, table: int, names: Sequence[str], rows: np.ndarray) -> None:
        """Adds rows `(n, ncolumns)` of a table whose columns have these names."""
        self._collectors[table].feed(dict(zip(names, rows.T, strict=True)))


def table_columns(columns: Iterable[Column], name: str = "") -> TableColumns:
    """Returns the columns of a table with this name in the legend."""
    return TableColumns(name, {column.name: column.unit for column in columns})
