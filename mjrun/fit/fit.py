"""A fit: parameters of a model from measurements, and an honest word on how well they are known."""

import importlib.util
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mjrun.errors import MissingExtraError, UnidentifiableError, UnimprovedFitError, UsageError, clean, option
from mjrun.fit.comparison import HORIZON, comparison_rows, write_comparison
from mjrun.fit.fit_page import write_fit_page
from mjrun.fit.fitted_inertia import FittedInertia, fitted_inertias
from mjrun.fit.fitted_model import FittedModel
from mjrun.fit.free_parameter import free_parameters, overrides, require_effect
from mjrun.fit.identifiability import Sensitivity, sensitivity
from mjrun.fit.intervals import bound_reached, intervals
from mjrun.fit.measurements import CONTROLS, Measurements, read_measurements
from mjrun.fit.prediction import Predictor
from mjrun.fit.ranges import check_ranges_name, write_ranges
from mjrun.fit.shooting import SHORTEST, Shooting, Solution, first_noise, with_noise
from mjrun.fit.starting_states import StartingStates
from mjrun.formats.atomic_output import OutputWriter, publish_together
from mjrun.formats.tables import output_format
from mjrun.job.simulation import Simulation
from mjrun.model import state
from mjrun.model.names import control_names
from mjrun.options.fit import EXTRAS, FitOptions
from mjrun.options.option import options
from mjrun.plotting.figure_writer import require_matplotlib
from mjrun.plotting.page_writer import check_page_name
from mjrun.reporter import Reporter, WarningReporter

SCHEMA = "mjrun-fit-1"
((EXTRA, (LIBRARY, _)),) = EXTRAS.items()
ENOUGH = 4  # measured numbers for each unknown


@options
class Fit(FitOptions):
    """Parameters of the model of `simulation` from measurements. Its options are keywords.

    Args:
      simulation: the model, and what holds it where no log says anything; its seed is that of the fit.
    """

    simulation: Simulation = field(kw_only=False)

    def run(self, reporter: Reporter | None = None) -> "FitResult":
        """Fits the parameters, and writes what was asked for.

        Raises:
          UnidentifiableError: the measurements do not tell what is looked for.
          UnimprovedFitError: what was held out is predicted no better than before; nothing is written.
          MjrunError: it cannot be fitted.
        """
        return _Run(self, reporter or WarningReporter()).all()


@dataclass(frozen=True)
class FittedParameter:
    """A parameter.

    Attributes:
      path: in the model, or the delay of a signal.
      start: what the model had.
      value: what was found.
      low, high: ends of its confidence interval.
      effect: how many standard deviations of their noise the measurements change between its bounds.
      bound: `low` or `high` if it lies at this bound; else empty.
    """

    path: str
    start: float
    value: float
    low: float
    high: float
    effect: float
    bound: str


@dataclass(frozen=True)
class FittedSignal:
    """How well a signal is predicted, as root mean square errors over its standard deviation.

    Attributes:
      name: of the column.
      unit: of it.
      noise: standard deviation of what is left of it after the fit, in this unit.
      nominal, fitted: errors where it was fitted, before and after.
      holdout_nominal, holdout_fitted: errors on what was held out; None without.
    """

    name: str
    unit: str
    noise: float
    nominal: float
    fitted: float
    holdout_nominal: float | None
    holdout_fitted: float | None


@dataclass(frozen=True)
class FitResult:
    """What has come of a fit.

    Attributes:
      parameters: what was looked for.
      inertias: of bodies of which numbers were looked for.
      signals: what was measured.
      correlation: between the parameters, in their order.
      confidence: of the intervals.
      condition: how well they can be told apart: ratio of singular values.
      rows, segments: what was fitted.
      rollouts: how many chunks were simulated.
      changes: what was changed in the model's text, each in words.
      remarks: what to know of the measurements.
      files: what was written.
      wall: wall time [s].
      schema: of this document.
    """

    parameters: Sequence[FittedParameter]
    inertias: Sequence[FittedInertia]
    signals: Sequence[FittedSignal]
    correlation: Sequence[Sequence[float]]
    confidence: float
    condition: float
    rows: int
    segments: int
    rollouts: int
    changes: Sequence[str]
    remarks: Sequence[str]
    files: Sequence[str]
    wall: float
    schema: str = SCHEMA


class _Run:
    def __init__(self, fit: Fit, reporter: Reporter) -> None:
        self._fit, self._reporter, self._begin = fit, reporter, time.perf_counter()
        if importlib.util.find_spec(LIBRARY) is None:
            raise MissingExtraError("mjrun fit", LIBRARY, EXTRA)
        _check_names(fit)
        simulation = fit.simulation
        if fit.velocity_limit is not None:
            raise UsageError(f"{option('velocity_limit')} is of {option('excite')}: what was measured is not limited")
        if not fit.data:
            raise UsageError(f"{option('data')}: a fit needs a table of measurements")
        model = simulation.load()
        data = simulation.start.data(model)
        if twice := set(fit.data) & set(fit.holdout_data):
            raise UsageError(f"{option('holdout_data')}: {clean(min(twice))} cannot be fitted and held out")
        logs = [*fit.data, *fit.holdout_data]
        self._measurements = read_measurements(logs, model, simulation.map, data.ctrl)
        delayed = [*self._measurements.signals, *(f"{CONTROLS}{name}" for name in control_names(model))]
        self._parameters = free_parameters(fit.free, simulation.source, delayed)
        for each in self._parameters:
            require_effect(each, simulation.source)
        self._model_file = FittedModel(Path(fit.output), simulation.source) if fit.output is not None else None
        if self._model_file:
            self._model_file.check(overrides(self._parameters, [each.value(0.5) for each in self._parameters]))

        self._predictor = Predictor(simulation, self._measurements.signals, self._parameters)
        starting = StartingStates(model, self._measurements.signals, state.save(model, data))
        self._shooting = Shooting(self._predictor, self._parameters, starting, fit.loss)
        self._fitted, self._held = self._measurements, Measurements(self._measurements.signals, [])
        if fit.holdout_data:
            self._fitted, self._held = self._measurements.without(fit.holdout_data)
        elif fit.holdout:
            self._fitted, self._held = self._measurements.split(fit.holdout)
        if not self._fitted.segments:
            raise UsageError(f"{option('holdout')} {fit.holdout:g} leaves nothing to fit")
        self._require_enough()

    def all(self) -> "FitResult":
        for remark in self._measurements.remarks:
            self._reporter.note(remark)
        noise = first_noise(self._fitted.segments)
        starts = self._starts()
        self._look_first(starts, noise)
        start = self._shooting.best_start(self._fitted.segments, starts, noise) if len(starts) > 1 else starts[0]
        stages = self._shooting.grown(self._fitted.segments, start, noise)
        last = with_noise(stages[-1], stages[-1].noise_scale)
        found = sensitivity([last], self._parameters)
        if found.unidentifiable and not self._fit.allow_unidentifiable:
            raise UnidentifiableError([each.message for each in found.unidentifiable])
        comparisons = self._compared(last.coordinates, stages[-1].noise)
        self._require_better(comparisons)
        return self._published(last, found, comparisons, sum(stage.rollouts for stage in stages))

    def _require_enough(self) -> None:
        numbers = sum(int(np.isfinite(segment.values).sum()) for segment in self._fitted.segments)
        unknown = len(self._parameters) + len(self._fitted.segments) * 2 * self._predictor.model.nv
        if numbers <= ENOUGH * unknown:
            raise UsageError(
                f"{numbers} measured numbers are too few for {len(self._parameters)} parameters and the states in "
                f"which {len(self._fitted.segments)} segments begin: {unknown} unknowns"
            )

    def _starts(self) -> list[np.ndarray]:
        """Coordinates to begin at: those of the model, and others spread evenly."""
        from scipy.stats import qmc

        first = np.array([each.first_coordinate for each in self._parameters])
        others = qmc.Sobol(len(first), rng=np.random.default_rng(self._fit.simulation.seed))
        more = others.random_base2(max(0, (self._fit.starts - 1).bit_length()))[: self._fit.starts - 1]
        return [first, *(0.1 + 0.8 * more)]

    def _look_first(self, starts: Sequence[np.ndarray], noise: np.ndarray) -> None:
        """Refuses what the measurements cannot tell at any of the starts."""
        parts = self._shooting.cut(self._fitted.segments, 4 * SHORTEST)
        states = self._shooting.guessed(parts)
        looks = [self._shooting.look(parts, start, states, noise) for start in starts]
        found = sensitivity(looks, self._parameters)
        if found.unidentifiable:
            if not self._fit.allow_unidentifiable:
                raise UnidentifiableError([each.message for each in found.unidentifiable])
            for each in found.unidentifiable:
                self._reporter.warn(each.message)

    def _compared(self, fitted: np.ndarray, noise: np.ndarray) -> "dict[tuple[str, str], Solution]":
        """Predictions of the fitted and the held-out part, with the model before and after."""
        solved: dict[tuple[str, str], Solution] = {}
        for part, measurements in (("fitted", self._fitted), ("held", self._held)):
            if not measurements.segments:
                continue
            parts = self._shooting.cut(measurements.segments, HORIZON)
            states = self._shooting.guessed(parts)
            for which, coordinates in (("nominal", None), ("fitted", fitted)):
                solved[part, which] = self._shooting.follow(parts, coordinates, states, noise)
        return solved

    def _require_better(self, comparisons: "dict[tuple[str, str], Solution]") -> None:
        if ("held", "fitted") not in comparisons:
            return
        before, after = (comparisons["held", which].cost for which in ("nominal", "fitted"))
        if after >= before:
            raise UnimprovedFitError(
                f"what was held out is predicted no better: an error of {after:.4g} standard deviations of the noise, "
                f"{before:.4g} before the fit\nthe model lacks something that the parameters cannot make up for, or "
                f"{option('free')} has the wrong ones; nothing was written"
            )

    def _published(
        self,
        last: Solution,
        found: Sensitivity,
        comparisons: "dict[tuple[str, str], Solution]",
        rollouts: int,
    ) -> "FitResult":
        fit = self._fit
        known = intervals(last, self._parameters, fit.confidence, fit.simulation.seed)
        values = [each.value(c) for each, c in zip(self._parameters, last.coordinates, strict=True)]
        parameters = [
            FittedParameter(p.path, p.start, value, low, high, effect, bound_reached(coordinate))
            for p, value, low, high, effect, coordinate in zip(
                self._parameters, values, known.low, known.high, found.effects, last.coordinates, strict=True
            )
        ]
        logs = list(dict.fromkeys(each.source for each in self._measurements.segments))
        compared = comparison_rows(comparisons, logs)
        with ExitStack() as stack:
            writers: list[OutputWriter] = []
            made: list[str] = []
            if fit.comparison is not None:
                writers.append(write_comparison(stack, fit.comparison, self._predictor.columns, compared))
            if fit.ranges is not None:
                writers.append(write_ranges(stack, fit.ranges, self._parameters, parameters, fit.confidence))
            if self._model_file:
                model, changed = self._model_file.write(stack, overrides(self._parameters, values))
                made = [each.sentence for each in changed]
                writers.append(model)
            files = [str(each.destination.shown) for each in writers if each.destination.stdout is None]
            result = FitResult(
                parameters,
                fitted_inertias(self._parameters, values, known),
                self._signals(last, comparisons),
                known.correlation.tolist(),
                fit.confidence,
                found.condition,
                self._fitted.rows,
                len(self._fitted.segments),
                rollouts,
                made,
                list(self._measurements.remarks),
                [*files, *([fit.html] if fit.html is not None else [])],
                time.perf_counter() - self._begin,
            )
            if fit.html is not None:
                name = Path(fit.simulation.source.text).name
                columns = self._predictor.columns
                writers.append(write_fit_page(stack, fit.html, name, result, columns, compared, logs))
            publish_together(writers)
        return result

    def _signals(self, last: Solution, comparisons: "dict[tuple[str, str], Solution]") -> list[FittedSignal]:
        errors = {key: _errors(solution) for key, solution in comparisons.items()}
        missing = np.full(len(self._measurements.signals), np.nan)
        rows = [
            errors.get(key, missing)
            for key in (("fitted", "nominal"), ("fitted", "fitted"), ("held", "nominal"), ("held", "fitted"))
        ]
        signals: list[FittedSignal] = []
        for i, (name, column) in enumerate(zip(self._measurements.signals, self._predictor.columns, strict=True)):
            nominal, fitted, *held = (float(each[i]) for each in rows)
            held_out = [None if np.isnan(each) else each for each in held]
            signals.append(FittedSignal(name, column.unit, float(last.noise[i]), nominal, fitted, *held_out))
        return signals


def _check_names(fit: Fit) -> None:
    """Refuses names of files that could not be written, before hours of fitting."""
    if fit.comparison is not None:
        output_format(fit.comparison)
    if fit.ranges is not None:
        check_ranges_name(fit.ranges)
    if fit.html is not None:
        check_page_name(fit.html)
        require_matplotlib()


def _errors(solution: Solution) -> np.ndarray:
    """Root mean square error of each signal over its standard deviation, `(signals,)`."""
    values = np.concatenate([part.values for part in solution.chunks])
    spread = np.nanstd(values, axis=0)
    return solution.observed_noise / np.where(spread > 0, spread, np.nan)
