"""A fit: parameters of a model from measurements, and an honest word on how well they are known."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mjrun.errors import (
    EndedFromOutsideError,
    UnidentifiableError,
    UnimprovedFitError,
    UsageError,
    clean,
    option,
)
from mjrun.fit.comparison import HORIZON
from mjrun.fit.fitted_inertia import fitted_inertias
from mjrun.fit.free_parameter import free_parameters, require_effect
from mjrun.fit.identifiability import Sensitivity, sensitivity
from mjrun.fit.intervals import bound_reached, intervals
from mjrun.fit.measurements import CONTROLS, read_measurements
from mjrun.fit.noise import first_noise, spread_of
from mjrun.fit.outputs import FitOutputs
from mjrun.fit.prediction import Predictor
from mjrun.fit.result import FitResult, FittedParameter, FittedSignal
from mjrun.fit.rotations import shared
from mjrun.fit.shooting import SHORTEST, Shooting
from mjrun.fit.solution import Solution, with_noise
from mjrun.fit.starting_states import StartingStates
from mjrun.job.simulation import Simulation
from mjrun.model import state
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.names import control_names
from mjrun.options.fit import EXTRAS, FitOptions
from mjrun.options.option import options
from mjrun.packages import require_all
from mjrun.reporter import Reporter, WarningReporter

FURTHER_STARTS = 12  # at least, where short chunks have led nowhere
ENOUGH = 4  # measured numbers for each unknown
# Of a signal that the model does not explain: least residual over its noise, and over its standard deviation.
MISFIT, MISFIT_SHARE = 10.0, 0.05

Solutions = Mapping[tuple[str, str], Solution]
Partial = Callable[[FitResult], None]


@options
class Fit(FitOptions):
    """Parameters of the model of `simulation` from measurements. Its options are keywords.

    Args:
      simulation: the model, and what holds it where no log says anything; its seed is that of the fit.
    """

    simulation: Simulation = field(kw_only=False)

    def run(self, reporter: Reporter | None = None, partial: Partial | None = None) -> FitResult:
        """Fits the parameters, and writes what was asked for.

        Args:
          partial: is told what there is if the fit is interrupted and `keep_partial` was asked for.

        Raises:
          UnidentifiableError: the measurements do not tell what is looked for.
          UnimprovedFitError: what was held out is predicted no better than before; nothing is written.
          MjrunError: it cannot be fitted.
          KeyboardInterrupt, TerminatedError: it was interrupted.
        """
        with collected_warnings():  # of what becomes unstable, which is told with the values
            run = _Run(self, reporter or WarningReporter())
            try:
                return run.all()
            except (KeyboardInterrupt, EndedFromOutsideError):
                if self.keep_partial and (kept := run.kept()) and partial:
                    partial(kept)
                raise


@dataclass(frozen=True, eq=False)
class _Found:
    """Where a fit has ended, or was ended.

    Attributes:
      solution: in standard deviations of its own noise.
      sensitivity: of the measurements there.
      rollouts: how many it took.
    """

    solution: Solution
    sensitivity: Sensitivity
    rollouts: int


class _Run:
    def __init__(self, fit: Fit, reporter: Reporter) -> None:
        self._fit, self._reporter, self._begin = fit, reporter, time.perf_counter()
        require_all(EXTRAS)
        simulation = fit.simulation
        if fit.velocity_limit is not None:
            raise UsageError(f"{option('velocity_limit')} is of {option('excite')}: what was measured is not limited")
        if not fit.data:
            raise UsageError(f"{option('data')}: a fit needs a table of measurements")
        model = simulation.load()
        data = simulation.start.data(model)
        self._logs = logs = [*fit.data, *fit.holdout_data]
        if twice := set(fit.data) & set(fit.holdout_data):
            raise UsageError(f"{option('holdout_data')}: {clean(min(twice))} cannot be fitted and held out")
        if twice := {log for log in logs if logs.count(log) > 1}:
            raise UsageError(f"{option('data')}: {clean(min(twice))} is given twice")
        linear = simulation.ctrl_interpolation == "linear"
        self._measurements = read_measurements(logs, model, simulation.map, data.ctrl, linear=linear)
        delayed = [*self._measurements.signals, *(f"{CONTROLS}{name}" for name in control_names(model))]
        self._parameters = free_parameters(fit.free, simulation.source, delayed)
        for each in self._parameters:
            require_effect(each, simulation.source)

        self._predictor = Predictor(simulation, self._measurements.signals, self._parameters)
        starting = StartingStates(model, self._measurements.signals, state.save(model, data))
        self._shooting = Shooting(self._predictor, self._parameters, starting, fit.loss)
        self._fitted, self._held = self._measurements, replace(self._measurements, segments=[])
        if fit.holdout_data:
            self._fitted, self._held = self._measurements.without(fit.holdout_data)
        elif fit.holdout:
            self._fitted, self._held = self._measurements.split(fit.holdout)
        if not self._fitted.segments:
            raise UsageError(f"{option('holdout')} {fit.holdout:g} leaves nothing to fit")
        self._require_enough()
        self._outputs = FitOutputs(fit, simulation, self._predictor, self._parameters)
        self._latest: Solution | None = None

    def all(self) -> FitResult:
        sharing = [each.sharing for each in self._parameters if each.sharing]
        for remark in [*self._measurements.remarks, *sharing]:
            self._reporter.note(remark)
        noise = first_noise(self._fitted.segments, self._measurements.rotations)
        starts = self._starts(self._fit.starts)
        self._look_first(starts, noise)
        stages = self._stages(starts, noise)
        last, failures = stages[-1], self._predictor.failures.sentence(self._parameters)
        hints = [*self._misfits(last, noise), *([failures] if failures else [])]
        outcome = self._found(last, sum(stage.rollouts for stage in stages))
        unidentifiable = [each.message for each in outcome.sensitivity.unidentifiable]
        if unidentifiable and not self._fit.allow_unidentifiable:
            raise UnidentifiableError(unidentifiable, hints)
        comparisons = self._compared(last.coordinates, last.noise)
        self._require_better(comparisons, hints)
        for hint in hints:
            self._reporter.warn(hint)
        return self._outputs.publish(self._result(outcome, comparisons), comparisons, self._logs, self._reporter)

    def kept(self) -> FitResult | None:
        """Writes the model as far as it was fitted; None if it was not begun."""
        if self._latest is None:
            return None
        result = self._result(self._found(self._latest, self._latest.rollouts), {}, partial=True)
        return self._outputs.publish(result, {}, self._logs, self._reporter, model_alone=True)

    def _stages(self, starts: Sequence[np.ndarray], noise: np.ndarray) -> list[Solution]:
        """Solutions of longer and longer stretches, from the best of `starts`."""
        total = len(self._shooting.stages(self._fitted.segments)) + 1
        done = {0: 0.0}  # chunks of a stage, which are fewer in each; the first are those of the starts

        def began(solution: Solution) -> None:
            if self._latest is None or solution.cost < self._latest.cost:
                self._latest = solution
            self._reporter.progress("stages of the fit", 0, total)

        def advanced(solution: Solution) -> None:
            self._latest = solution
            done[len(solution.chunks)] = solution.cost
            self._reporter.progress("stages of the fit", len(done) - 1, total)

        segments, start = self._fitted.segments, starts[0]
        if len(starts) > 1:
            start = self._shooting.best_start(segments, starts, noise, began)
        solutions = self._shooting.grown(segments, start, noise, advanced)
        further = self._starts(max(len(starts), FURTHER_STARTS))
        solutions += self._shooting.searched(solutions[-1], further, noise, advanced)
        self._reporter.progress("stages of the fit", total, total)
        return solutions

    def _found(self, solution: Solution, rollouts: int) -> _Found:
        own = with_noise(solution, shared(solution.noise_scale, self._measurements.rotations))
        return _Found(own, sensitivity([own], self._parameters), rollouts)

    def _misfits(self, last: Solution, noise: np.ndarray) -> list[str]:
        """Sentences on signals of which the model leaves far more than their noise."""
        left, (share,) = last.noise_scale, [_errors(last, self._measurements.rotations)]
        return [
            f"the fit leaves {left[i]:.3g} {column.unit}".rstrip()
            + f" of {clean(column.name)}, {left[i] / noise[i]:.0f} times its noise: the model lacks something, or the "
            f"log is in other units ({option('map')})"
            for i, column in enumerate(self._predictor.columns)
            if left[i] > MISFIT * noise[i] and share[i] > MISFIT_SHARE
        ]

    def _require_enough(self) -> None:
        numbers = sum(int(np.isfinite(segment.values).sum()) for segment in self._fitted.segments)
        unknown = len(self._parameters) + len(self._fitted.segments) * 2 * self._predictor.model.nv
        if numbers <= ENOUGH * unknown:
            raise UsageError(
                f"{numbers} measured numbers are too few for {len(self._parameters)} parameters and the states in "
                f"which {len(self._fitted.segments)} segments begin: {unknown} unknowns"
            )

    def _starts(self, count: int) -> list[np.ndarray]:
        """`count` coordinates to begin at: those of the model, and others spread evenly."""
        from scipy.stats import qmc

        first = np.array([each.first_coordinate for each in self._parameters])
        others = qmc.Sobol(len(first), rng=np.random.default_rng(self._fit.simulation.seed))
        more = others.random_base2(max(0, (count - 1).bit_length()))[: count - 1]
        return [first, *(0.1 + 0.8 * more)]

    def _look_first(self, starts: Sequence[np.ndarray], noise: np.ndarray) -> None:
        """Refuses what the measurements cannot tell at any of the starts."""
        parts = self._shooting.cut(self._fitted.segments, 4 * SHORTEST)
        looks = [self._shooting.look(parts, start, self._shooting.guessed(parts, start), noise) for start in starts]
        judged = sensitivity(looks, self._parameters)
        if judged.unidentifiable:
            if not self._fit.allow_unidentifiable:
                raise UnidentifiableError([each.message for each in judged.unidentifiable])
            for each in judged.unidentifiable:
                self._reporter.warn(each.message)

    def _compared(self, fitted: np.ndarray, noise: np.ndarray) -> Solutions:
        """Predictions of the fitted and the held-out part, with the model before and after."""
        solved: dict[tuple[str, str], Solution] = {}
        for part, measurements in (("fitted", self._fitted), ("held", self._held)):
            if not measurements.segments:
                continue
            parts = self._shooting.cut(measurements.segments, HORIZON)
            for which, coordinates in (("nominal", None), ("fitted", fitted)):
                states = self._shooting.guessed(parts, coordinates)
                solved[part, which] = self._shooting.follow(parts, coordinates, states, noise)
        return solved

    def _require_better(self, comparisons: Solutions, hints: Sequence[str]) -> None:
        if ("held", "fitted") not in comparisons:
            return
        before, after = (comparisons["held", which].cost for which in ("nominal", "fitted"))
        if after >= before:
            counted = "" if self._fit.loss == "linear" else f", as {self._fit.loss} counts them"
            lines = [
                f"what was held out is predicted no better: an error of {after:.4g} standard deviations of the noise"
                f"{counted}, {before:.4g} before the fit",
                *hints,
                f"the model lacks something that the parameters cannot make up for, or {option('free')} has the wrong "
                "ones; nothing was written",
            ]
            raise UnimprovedFitError("\n".join(lines))

    def _result(self, outcome: _Found, comparisons: Solutions, *, partial: bool = False) -> FitResult:
        fit, last = self._fit, outcome.solution
        known = intervals(last, self._parameters, fit.confidence, fit.simulation.seed)
        values = [each.value(c) for each, c in zip(self._parameters, last.coordinates, strict=True)]
        effects = outcome.sensitivity.effects
        parameters = [
            FittedParameter(p.path, p.start, value, low, high, effect, bound_reached(coordinate))
            for p, value, low, high, effect, coordinate in zip(
                self._parameters, values, known.low, known.high, effects, last.coordinates, strict=True
            )
        ]
        failures = self._predictor.failures.sentence(self._parameters)
        return FitResult(
            parameters,
            fitted_inertias(self._parameters, values, known),
            self._signals(last, comparisons),
            known.correlation.tolist(),
            fit.confidence,
            outcome.sensitivity.condition,
            self._fitted.rows,
            len(self._fitted.segments),
            outcome.rollouts,
            [],
            [*self._measurements.remarks, *([failures] if failures else [])],
            [],
            time.perf_counter() - self._begin,
            fit.loss,
            partial,
        )

    def _signals(self, last: Solution, comparisons: Solutions) -> list[FittedSignal]:
        errors = {key: _errors(solution, self._measurements.rotations) for key, solution in comparisons.items()}
        missing = np.full(len(self._measurements.signals), np.nan)
        rows = [
            errors.get(key, missing)
            for key in (("fitted", "nominal"), ("fitted", "fitted"), ("held", "nominal"), ("held", "fitted"))
        ]
        signals: list[FittedSignal] = []
        for i, (name, column) in enumerate(zip(self._measurements.signals, self._predictor.columns, strict=True)):
            shares = [None if np.isnan(each[i]) else float(each[i]) for each in rows]
            signals.append(FittedSignal(name, column.unit, float(last.noise[i]), *shares))
        return signals


def _errors(solution: Solution, rotations: Sequence[Sequence[int]]) -> np.ndarray:
    """Error of each signal over its spread, `(signals,)`; NaN without any."""
    values = np.concatenate([part.values for part in solution.chunks])
    spread = shared(spread_of(values, solution.loss), rotations)
    return shared(solution.noise_scale, rotations) / np.where(spread > 0, spread, np.nan)
