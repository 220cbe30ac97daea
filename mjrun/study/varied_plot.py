"""Plot of a simulation with varied parameters: a curve for each point, in the same panels."""

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import field, replace
from functools import cached_property
from itertools import chain

from mjrun.dataclass import dataclass
from mjrun.errors import MjrunError, SimulationError, UsageError, flag, option
from mjrun.experiment.design import Design
from mjrun.formats.study_reader import point_names
from mjrun.model.variants import VariantLoader
from mjrun.options.option import options
from mjrun.options.sweep import VariationOptions
from mjrun.outputs import output
from mjrun.outputs.event_detection import final_timeline
from mjrun.outputs.plot import OpenPlot, Plot, PlotResult, table_columns
from mjrun.outputs.trace import row_steps
from mjrun.outputs.trace_rows import TIME, ProbeSampler
from mjrun.physics.stepper import Stepper
from mjrun.plotting.figure_plan import FigurePlan
from mjrun.probe.select import available_columns
from mjrun.simulation.simulation import Simulation
from mjrun.study.prepared import checked_design, parameter_units, varied_files
from mjrun.study.spec import MODEL, StudySpec

MOST = 100  # points in a figure


@dataclass(frozen=True)
class LegendPoint:
    """A point in a figure: its name in the legend, its values as written, and its simulation."""

    name: str
    values: str
    simulation: Simulation

    @contextmanager
    def named_in_errors(self) -> Generator[None]:
        """Adds its values to errors."""
        try:
            yield
        except MjrunError as error:
            error.add_note(f"at the point {self.values}")
            raise


@options
class VariedPlot(VariationOptions, Plot):
    """A plot of a simulation with varied parameters, with a curve for each point: its options are keywords.

    The numbers of a point are exactly those of its trace. A point that becomes unstable is drawn up to there.

    Args:
      controllers: functions by the values of `controller`, where the controller varies.
    """

    controllers: Mapping[str, Callable[..., object]] = field(default_factory=dict[str, Callable[..., object]])

    @property
    def inputs(self) -> Sequence[tuple[str, str]]:
        """The files that only some points read."""
        return [
            ("file of a point", str(path))
            for files in varied_files(self.simulation, self._design)
            for path in chain(*files)
        ]

    @property
    def code(self) -> Sequence[object]:
        return [*self.simulation.code, *self.controllers.values()]

    @property
    def keeps_partial(self) -> bool:
        return True

    def plan(self, context: output.PassContext) -> "output.OutputPlan[PlotResult]":
        """Checks the values of all points, and resolves the curves among the columns of their traces."""
        points = self._points(context)
        varies = MODEL in self._design.names  # otherwise, all points have the same columns
        contexts = [self.context(point, context) for point in (points if varies else points[:1])]
        with points[0].named_in_errors():
            points[0].simulation.stepper(contexts[0].model)
        panels = self.probe_panels(contexts[0])  # first, since it names the probe that is wrong
        columns = [self.probe_sampler(each).columns for each in contexts] * (1 if varies else len(points))
        tables = [table_columns(each, point.name) for each, point in zip(columns, points, strict=True)]
        figure = FigurePlan(self, tables, panels)
        about = f"{self.figure_format}, {'; '.join(panel.label for panel in figure.panels)}"
        preview = output.OutputPreview("plot", self.output, len(points), "points", figure.grid.size, about)
        table = self.probe_sampler(contexts[0])
        return output.OutputPlan(
            preview=preview,
            until=0,
            open=lambda stack, _: OpenVariedPlot(self, context, table, figure, points, stack),
        )

    def context(self, point: LegendPoint, base: output.PassContext) -> output.PassContext:
        """Returns the context of the simulation of a point, with the reporter of `base`."""
        simulation = point.simulation
        with point.named_in_errors():
            model = simulation.episode.model() if simulation.episode else self._variants.load(simulation.source).model
            return output.PassContext(simulation, model, final_timeline(simulation, model), base.reporter)

    @cached_property
    def _variants(self) -> VariantLoader:
        return VariantLoader()

    @cached_property
    def _design(self) -> Design:
        """The points, with all names and values checked."""
        spec = StudySpec(self.simulation, (), (), controllers=tuple(self.controllers.items()))
        made = checked_design(self, spec, *self.simulation.compile())
        if not made.names:
            raise UsageError(f"nothing varies: give {option('vary')} NAME=VALUES or {option('repeats')} N")
        if len(made.points) > MOST:
            other = f"mjrun sweep {flag('keep')} trace stores the curves of more"
            raise UsageError(f"{len(made.points):,} points; a figure shows {MOST} at most\n{other}")
        return made

    def _points(self, context: output.PassContext) -> list[LegendPoint]:
        names, points = self._design.names, self._design.points
        spec = StudySpec(self.simulation, names, (), controllers=tuple(self.controllers.items()))
        columns = [TIME, *available_columns(context.model, context.episode)]
        units = parameter_units(names, {each.name: each.unit for each in columns}, context.model)
        values = [self._design.values(index) for index in range(len(points))]
        titled = bool(self.legend_title) and len(names) == 1  # by the name of the parameter
        shown = [point[0] for point in points] if titled else point_names(values, units)
        return [
            LegendPoint(label, ", ".join(f"{name}={text}" for name, text in each.items()), spec.simulation(point))
            for label, each, point in zip(shown, values, points, strict=True)
        ]


class OpenVariedPlot(OpenPlot):
    """A plot with an open file, of points that are simulated one after another."""

    def __init__(
        self,
        request: VariedPlot,
        context: output.PassContext,
        table: ProbeSampler,
        figure: FigurePlan,
        points: Sequence[LegendPoint],
        stack: ExitStack,
    ) -> None:
        super().__init__(request, context, table, (), figure, stack)
        self._varied, self._points = request, points

    def simulate(self, stepper: Stepper, until: int) -> None:
        """Simulates every point, instead of `stepper`.

        Raises:
          SimulationError: points failed; the others, and these up to there, are drawn nevertheless.
        """
        failures = dict[str, SimulationError]()
        for index, point in enumerate(self._points):
            context = self._varied.context(point, self._context)
            table = self._varied.probe_sampler(context)
            steps = row_steps(context.timeline, self._varied.every, self._varied.rate)
            try:
                with point.named_in_errors():
                    measured = point.simulation.stepper(table.model)
                    for block in table.blocks(measured, steps):
                        self.feed(index, table.names, block().values)
                    measured.advance(context.timeline.steps)
            except SimulationError as error:
                failures[point.values] = error
            self._context.reporter.progress("points", index + 1, len(self._points))
        if failures:
            (_, first), *others = failures.items()
            for values, error in others:
                first.add_note(f"{values} failed at step {error.step}, time {error.time:.9g} s")
            raise first

    def finish(self, simulation_wall: float) -> output.FinishedOutput[PlotResult]:
        finished = super().finish(simulation_wall)
        points = {point.values: rows for point, rows in zip(self._points, self.rows, strict=True)}
        return replace(finished, result=replace(finished.result, points=points))
