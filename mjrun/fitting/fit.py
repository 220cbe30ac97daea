"""Fits of parameters of a model to measurements, with confidence intervals and a verdict."""

import time
from collections.abc import Callable, Sequence
from dataclasses import field, replace

import numpy as np

from mjrun.errors import (
    EndedFromOutsideError,
    UnidentifiableError,
    UnimprovedFitError,
    UsageError,
    clean,
    option,
    spelled,
)
from mjrun.fitting.comparison import HORIZON, Solutions
from mjrun.fitting.free_parameter import MARGIN, free_parameters, require_effect, values_at
from mjrun.fitting.information import Sensitivity, bound_reached, intervals, sensitivity
from mjrun.fitting.measurements import CONTROLS, read_measurements
from mjrun.fitting.outputs import FitOutputs
from mjrun.fitting.prediction import Predictor
from mjrun.fitting.result import FitResult, FittedParameter, FittedSignal, fitted_inertias
from mjrun.fitting.rotations_and_noise import first_noise, set_noise, shared, spread_of
from mjrun.fitting.shooting_fit import SHORTEST, SearchResult, Shooting
from mjrun.fitting.solution import Solution, with_noise
from mjrun.fitting.starting_states import StateGuesses
from mjrun.fitting.verdict import NoiseRatios, all_at_bounds, improvement, misfit
from mjrun.model import state
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.names import control_names
from mjrun.options.fit import EXTRAS, FitOptions
from mjrun.options.option import options
from mjrun.packages import require_all
from mjrun.reporter import Reporter, WarningReporter
from mjrun.simulation.simulation import Simulation, require_simulation, require_whole

ENOUGH = 4  # least measured numbers per unknown
TOLERANCE = 1e-3  # relative difference of costs due to rounding

Partial = Callable[[FitResult], None]


@options
class Fit(FitOptions):
    """A fit of parameters of the model of `simulation` to measurements. Its options are keywords.

    Args:
      simulation: the model, with settings for everything that no log contains; its seed is that of the fit.
    """

    simulation: Simulation = field(kw_only=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_simulation(self.simulation)
        require_whole(self.simulation, "a fit: the measurements set its length")

    def run(self, reporter: Reporter | None = None, partial: Partial | None = None) -> FitResult:
        """Fits the parameters and writes the output files.

        Args:
          partial: called with the preliminary result if the fit is interrupted and `keep_partial` is set.

        Raises:
          UnidentifiableError: the measurements do not determine the parameters.
          UnimprovedFitError: the fitted model does not predict held-out data better, or does not explain the
            measurements; nothing is written.
          MjrunError: the fit is impossible.
          KeyboardInterrupt, TerminatedError: the fit was interrupted.
        """
        copied = self.simulation.with_snapshot()  # edits during the fit have no effect
        assert copied.snapshot
        # Warnings concern unstable simulations, which are reported with their parameters.
        with copied.snapshot.original_names_in_errors(), collected_warnings():
            run = _Run(replace(self, simulation=copied), reporter or WarningReporter())
            try:
                return run.all()
            except (KeyboardInterrupt, EndedFromOutsideError):
                if self.keep_partial and (result := run.partial_result()) and partial:
                    partial(result)
                raise


class _Run:
    def __init__(self, fit: Fit, reporter: Reporter) -> None:
        self._fit, self._reporter, self._begin = fit, reporter, time.perf_counter()
        require_all(EXTRAS)
        simulation = fit.simulation
        if fit.velocity_limit is not None:
            raise UsageError(f"{option('velocity_limit')} applies only with {option('excite')}")
        if not fit.data:
            raise UsageError(f"{option('data')}: a fit needs a table of measurements")
        model = simulation.load()
        data = simulation.start.data(model)
        self._logs = logs = [*fit.data, *fit.holdout_data]
        if twice := set(fit.data) & set(fit.holdout_data):
            raise UsageError(f"{option('holdout_data')}: {clean(min(twice))} is both fitted and held out")
        if twice := {log for log in logs if logs.count(log) > 1}:
            raise UsageError(f"{option('data')}: {clean(min(twice))} is given twice")
        linear = simulation.ctrl_interpolation == "linear"
        self._measurements = read_measurements(logs, model, simulation.map, data.ctrl, linear=linear)
        delayed = [*self._measurements.signals, *(f"{CONTROLS}{name}" for name in control_names(model))]
        self._parameters = free_parameters(fit.free, simulation.source, delayed)
        for each in self._parameters:
            require_effect(each, simulation.source)

        self._fitted, self._held = self._measurements, replace(self._measurements, segments=[])
        if fit.holdout_data:
            self._fitted, self._held = self._measurements.without(fit.holdout_data)
        elif fit.holdout:
            self._fitted, self._held = self._measurements.split(fit.holdout)
        if not self._fitted.segments:
            raise UsageError(f"{option('holdout')} {fit.holdout:g} leaves nothing to fit")
        self._predictor = Predictor(simulation, self._measurements.signals, self._parameters)
        self._require_enough()
        self._noise = first_noise([each.values for each in self._fitted.segments], self._measurements.rotations)
        for place, deviation in set_noise(fit.noise, self._measurements.signals).items():
            self._noise[place] = deviation
        starting = StateGuesses(model, self._measurements.signals, state.save(model, data), self._noise)
        self._shooting = Shooting(self._predictor, self._parameters, starting, fit.loss, simulation.seed)
        self._outputs = FitOutputs(fit, simulation, self._predictor, self._parameters)
        self._latest: Solution | None = None

    def all(self) -> FitResult:
        sharing = [each.sharing for each in self._parameters if each.sharing]
        for remark in [*self._measurements.remarks, *sharing]:
            self._reporter.note(remark)
        starts = self._informative(self._starts(self._fit.starts))
        search = self._searched(starts)
        last = self._own_noise(search.best)
        known = sensitivity([last], self._parameters)
        left = misfit(search.best, self._noise, self._measurements.rotations)
        failures = self._predictor.failures.sentence(self._parameters)
        hints = [each for each in (left.warning(), failures) if each]
        reasons = [left.refusal(self._predictor.columns, self._noise)]
        reasons.append(all_at_bounds([each.path for each in self._parameters], last.coordinates))
        if why := next((each for each in reasons if each), None):
            raise UnimprovedFitError(f"{why}\nnothing was written")
        unidentifiable = [each.message for each in known.unidentifiable]
        if unidentifiable and not self._fit.allow_unidentifiable:
            raise UnidentifiableError(unidentifiable, hints)
        comparisons: dict[tuple[str, str], Solution] = {
            ("fitted", "nominal"): with_noise(search.own, last.noise),
            ("fitted", "fitted"): last,
            **self._predicted(last),
        }
        self._require_better(comparisons, hints)
        for hint in hints:
            self._reporter.warn(hint)
        result = self._result(last, known, left, comparisons, search.ways, hints)
        return self._outputs.publish(result, comparisons, self._logs, self._reporter)

    def partial_result(self) -> FitResult | None:
        """Writes the model with the best parameters so far; returns None without any."""
        if self._latest is None:
            return None
        left = misfit(self._latest, self._noise, self._measurements.rotations)
        last = self._own_noise(self._latest)
        result = self._result(last, sensitivity([last], self._parameters), left, {}, [], [], partial=True)
        return self._outputs.publish(result, {}, self._logs, self._reporter, model_alone=True)

    def _searched(self, starts: Sequence[np.ndarray]) -> SearchResult:
        """Searches for parameters that explain whole segments better than the original model."""

        def advanced(solution: Solution) -> None:
            if self._latest is None or solution.cost < self._latest.cost:
                self._latest = solution
            self._reporter.progress("stages of the fit", 0, 1)

        search = self._shooting.search(self._fitted.segments, starts, self._noise, advanced)
        if not search.best.variances:
            weighted = self._shooting.weighted(search.best)
            if weighted.cost <= with_noise(search.own, weighted.noise).cost:
                search.best = weighted
        self._reporter.progress("stages of the fit", 1, 1)
        if search.best.cost > with_noise(search.own, search.best.noise).cost * (1 + TOLERANCE):
            raise UnimprovedFitError(
                "no values explain the fitted part of the log better than those of the model\n"
                f"try narrower bounds with {option('free')}, or more {option('starts')}; nothing was written"
            )
        return search

    def _own_noise(self, solution: Solution) -> Solution:
        return with_noise(solution, shared(solution.noise_scale, self._measurements.rotations))

    def _require_enough(self) -> None:
        numbers = sum(int(np.isfinite(segment.values).sum()) for segment in self._fitted.segments)
        unknown = len(self._parameters) + len(self._fitted.segments) * 2 * self._predictor.model.nv
        if numbers <= ENOUGH * unknown:
            raise UsageError(
                f"{numbers} measured numbers are too few for {len(self._parameters)} parameters and the initial "
                f"states of {len(self._fitted.segments)} segments: {unknown} unknowns"
            )

    def _starts(self, count: int) -> list[np.ndarray]:
        """Returns `count` initial coordinates: those of the model, and others spread evenly."""
        first = np.array([each.first_coordinate for each in self._parameters])
        if count == 1:
            return [first]
        from scipy.stats import qmc

        others = qmc.Sobol(len(first), rng=np.random.default_rng(self._fit.simulation.seed))
        more = others.random_base2(max(0, (count - 1).bit_length()))[: count - 1]
        return [first, *(0.1 + 0.8 * more)]

    def _informative(self, starts: list[np.ndarray]) -> list[np.ndarray]:
        """Returns the starts, after the first another one if the measurements determine the parameters only there.

        The lower and upper ends of all ranges are such others: a box slides only with little friction.

        Raises:
          UnidentifiableError: the measurements determine the parameters nowhere.
        """
        parts = self._shooting.cut(self._fitted.segments, 4 * SHORTEST)
        looks: list[Solution] = []
        ends = [np.full(len(self._parameters), end) for end in (MARGIN, 1 - MARGIN)]
        for start in [*starts, *ends]:
            looks.append(self._shooting.look(parts, start, self._shooting.guessed(parts, start), self._noise))
            if not sensitivity(looks[-1:], self._parameters).unidentifiable:
                is_other = len(looks) > len(starts)
                return [starts[0], start, *starts[1:]] if is_other else starts
        messages = [each.message for each in sensitivity(looks, self._parameters).unidentifiable]
        if not self._fit.allow_unidentifiable:
            raise UnidentifiableError(messages)
        for message in messages:
            self._reporter.warn(message)
        return starts

    def _predicted(self, fitted: Solution) -> dict[tuple[str, str], Solution]:
        """Predicts held-out data by the original and the fitted model, each from the states that fit best."""
        if not self._held.segments:
            return {}
        parts = self._shooting.cut(self._held.segments, HORIZON)
        nominal, after = self._shooting.compared(parts, fitted.coordinates, fitted.noise)
        return {("held", "nominal"): nominal, ("held", "fitted"): after}

    def _require_better(self, comparisons: Solutions, hints: list[str]) -> None:
        """Refuses a fit that does not improve predictions by more than chance."""
        part, what = "held", "the fit does not predict the held-out data better"
        if ("held", "fitted") not in comparisons:
            return
        gained = improvement(comparisons["held", "nominal"], comparisons["held", "fitted"])
        if gained.is_silent:
            part, what = (
                "fitted",
                "the held-out data are not sensitive to the parameters, and the fit does not explain the rest better",
            )
            gained = improvement(comparisons["fitted", "nominal"], comparisons["fitted", "fitted"])
            hints.append(
                "the held-out data are not sensitive to the parameters: both models predict them to the noise, so only "
                f"the fitted part shows the improvement ({option('holdout')}, {option('holdout_data')})"
            )
        if gained.is_certain:
            return
        under_loss = "" if self._fit.loss == "linear" else f" under the loss {self._fit.loss}"
        change = f"squared errors decrease by {gained.gain:.3g}, of which {gained.uncertainty:.3g} may be chance"
        lines = [
            f"{what}: errors of {gained.after:.4g} standard deviations of the noise{under_loss}, "
            f"{gained.before:.4g} before",
            change if gained.gain > 0 else "",
            *(hints if part == "held" else []),
            "the original model is right, or it lacks something that the parameters cannot compensate for, or "
            f"{option('free')} names the wrong ones; nothing was written",
        ]
        raise UnimprovedFitError("\n".join(line for line in lines if line))

    def _result(
        self,
        last: Solution,
        sensitivities: Sensitivity,
        left: NoiseRatios,
        comparisons: Solutions,
        ways: Sequence[str],
        hints: Sequence[str],
        *,
        partial: bool = False,
    ) -> FitResult:
        fit = self._fit
        known = intervals(last, self._parameters, fit.confidence, fit.simulation.seed)
        values = values_at(self._parameters, last.coordinates)
        parameters = [
            FittedParameter(p.path, p.start, value, low, high, effect, bound_reached(coordinate))
            for p, value, low, high, effect, coordinate in zip(
                self._parameters, values, known.low, known.high, sensitivities.effects, last.coordinates, strict=True
            )
        ]
        return FitResult(
            parameters,
            fitted_inertias(self._parameters, values, known),
            self._signals(last, left, comparisons),
            left.reduced,
            known.correlation.tolist(),
            fit.confidence,
            sensitivities.condition,
            self._fitted.rows,
            len(self._fitted.segments),
            self._predictor.rollouts,
            [],
            [*self._measurements.remarks, *map(spelled, hints)],
            ways,
            [],
            time.perf_counter() - self._begin,
            fit.loss,
            partial,
        )

    def _signals(self, last: Solution, left: NoiseRatios, comparisons: Solutions) -> list[FittedSignal]:
        errors = {key: _errors(solution, self._measurements.rotations) for key, solution in comparisons.items()}
        missing = np.full(len(self._measurements.signals), np.nan)
        rows = [
            errors.get(key, missing)
            for key in (("fitted", "nominal"), ("fitted", "fitted"), ("held", "nominal"), ("held", "fitted"))
        ]
        signals: list[FittedSignal] = []
        for i, (name, column) in enumerate(zip(self._measurements.signals, self._predictor.columns, strict=True)):
            shares = [None if np.isnan(each[i]) else float(each[i]) for each in rows]
            signals.append(FittedSignal(name, column.unit, float(last.noise[i]), float(left.ratios[i]), *shares))
        return signals


def _errors(solution: Solution, rotations: Sequence[Sequence[int]]) -> np.ndarray:
    """Returns the error of each signal over its spread, `(signals,)`; NaN without spread."""
    values = np.concatenate([part.values for part in solution.chunks])
    spread = shared(spread_of(values, solution.loss), rotations)
    return shared(solution.noise_scale, rotations) / np.where(spread > 0, spread, np.nan)
