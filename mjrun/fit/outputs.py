"""The files of a fit: their names are checked before hours of fitting, and all of them appear together, or none."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from mjrun.errors import concerning
from mjrun.fit.comparison import comparison_rows, write_comparison
from mjrun.fit.film import FilmedStretch, FitFilm
from mjrun.fit.fit_page import write_fit_page
from mjrun.fit.fitted_model import FittedModel
from mjrun.fit.free_parameter import FreeParameter, overrides, values_at
from mjrun.fit.prediction import Predictor
from mjrun.fit.ranges import check_ranges_name, write_ranges
from mjrun.fit.result import FitResult
from mjrun.fit.solution import Solution
from mjrun.formats.atomic_output import OutputWriter, publish_together
from mjrun.formats.destinations import StagedFile
from mjrun.formats.tables import output_format
from mjrun.options.fit import FitOptions
from mjrun.outputs.output_files import ReservedFiles, named_files
from mjrun.plotting.figure_writer import require_matplotlib
from mjrun.plotting.page_writer import check_page_name
from mjrun.reporter import Reporter
from mjrun.simulation.simulation import Simulation

Solutions = Mapping[tuple[str, str], Solution]


class FitOutputs:
    """What a fit writes.

    Args:
      simulation: of the model that is fitted.

    Raises:
      UsageError: a name that no such file has; two outputs are one file, or one is read.
      FileError: one of them cannot be written.
    """

    def __init__(
        self, fit: FitOptions, simulation: Simulation, predictor: Predictor, parameters: Sequence[FreeParameter]
    ) -> None:
        self._fit, self._simulation, self._predictor, self._parameters = fit, simulation, predictor, parameters
        _check_names(fit, simulation)
        self._model_file = FittedModel(Path(fit.output), simulation.source) if fit.output is not None else None
        if self._model_file:
            self._model_file.check(overrides(parameters, [each.value(0.5) for each in parameters]))
        signals = [column.name for column in predictor.columns]
        self._film = FitFilm(fit, predictor.model, signals) if fit.video is not None else None

    def publish(
        self,
        result: FitResult,
        comparisons: Solutions,
        logs: Sequence[str],
        reporter: Reporter,
        *,
        model_alone: bool = False,
    ) -> FitResult:
        """Writes everything, and returns the result with what was written and changed.

        Args:
          comparisons: predictions of the parts `fitted` and `held` by the models `nominal` and `fitted`.
          logs: the tables that were measured.
          model_alone: whether the model alone is to be written.

        Raises:
          MjrunError: something cannot be written; then there is nothing new.
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
            if self._film:
                stretches = self._stretches(comparisons, logs)
                model, delays = self._predictor.model_with(values), self._delays(values)
                writers.append(stack.enter_context(self._film.writer(model, stretches, delays, reporter)))
            return replace(result, files=[str(file) for file in publish_together(writers)])

    def _stretches(self, comparisons: Solutions, logs: Sequence[str]) -> list[FilmedStretch]:
        """All stretches in the order of logs and time, as the fitted model goes through them."""
        stretches: list[FilmedStretch] = []
        for part in ("fitted", "held"):
            if solution := comparisons.get((part, "fitted")):
                values = values_at(self._parameters, solution.coordinates)
                followed = self._predictor.positions(solution.chunks, values, solution.states)
                stretches += map(FilmedStretch, solution.chunks, followed)
        return sorted(stretches, key=lambda each: (logs.index(each.chunk.segment.source), _begin(each)))

    def _delays(self, values: Sequence[float]) -> list[float]:
        names = [column.name for column in self._predictor.columns]
        delays = {name: v for p, v in zip(self._parameters, values, strict=True) for name in p.delayed}
        return [delays.get(name, 0.0) for name in names]


def _begin(stretch: FilmedStretch) -> float:
    chunk = stretch.chunk
    return float(chunk.segment.times[chunk.rows][0])


def _check_names(fit: FitOptions, simulation: Simulation) -> None:
    if fit.comparison is not None:
        output_format(fit.comparison)
    if fit.ranges is not None:
        check_ranges_name(fit.ranges)
    if fit.html is not None:
        check_page_name(fit.html)
        require_matplotlib()
    reserved = ReservedFiles()
    for log in dict.fromkeys([*fit.data, *fit.holdout_data]):
        reserved.reserve(log, "the log, which is read")
    for what, path in simulation.tables:
        reserved.reserve(path, f"the {what}, which is read")
    outputs = {"output": fit.output, "comparison": fit.comparison, "ranges": fit.ranges, "html": fit.html}
    for name, path in named_files(**outputs, video=fit.video):
        with concerning(name):
            reserved.reserve(path, f"the {name}")
            StagedFile(Path(path)).discard()  # which proves that it can be written
