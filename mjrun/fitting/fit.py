"""Fits of parameters of a model to measurements, with confidence intervals and a verdict: residuals are compared with
the noise, and predictions with those of the original model.
"""

import time
import warnings
from collections.abc import Callable, Collection, Sequence
from dataclasses import field, replace

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import (
    EndRequestedError,
    UnidentifiableError,
    UnimprovedFitError,
    UsageError,
    clean,
    listing,
    option,
    spelled,
)
from mjrun.fitting.correlated_noise import correlations as noise_correlations
from mjrun.fitting.correlated_noise import visible_noise, visible_share
from mjrun.fitting.free_parameter import MARGIN, free_parameters, require_effect, values_at
from mjrun.fitting.information import Sensitivity, bound_reached, intervals, sensitivity
from mjrun.fitting.measurements import (
    CONTROLS,
    Measurements,
    first_noise,
    least_noise,
    read_measurements,
    rounding,
    set_noise,
    shared,
    spread_of,
)
from mjrun.fitting.outputs import HORIZON, FitOutputs, Solutions
from mjrun.fitting.prediction import Predictor
from mjrun.fitting.result import FitResult, FittedParameter, FittedSignal, fitted_inertias
from mjrun.fitting.shooting_fit import SHORTEST, OriginalAndBestSolutions, ShootingFit
from mjrun.fitting.shooting_problem import LOSSES, Floats, RoughMotionEstimate, Solution, with_noise
from mjrun.fitting.starting_states import StateGuesses
from mjrun.model import state
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.names import control_names, control_slices
from mjrun.model.table_column import Column
from mjrun.options.fit import EXTRAS, FitOptions
from mjrun.options.option import options
from mjrun.packages import require_all
from mjrun.reporter import PythonApiReporter, Reporter
from mjrun.simulation.simulation import Simulation, require_simulation, require_without

MISFIT = 1.4  # reduced χ² below which the user is never warned
CHANCE, CHANCE_OF_MEDIANS = 5.0, 7.0  # log χ² of n numbers that noise alone hardly ever exceeds, in √(2 / n)
HOPELESS, HOPELESS_SHARE = 10.0, 0.1  # residual over noise, and over the spread of a signal, above which a fit fails
LEAST = 1e-5  # least noise of a signal that counts, as a share of its standard deviation
BLOCKS = 20  # blocks of held-out data whose errors are assumed to be independent
CERTAIN = 2.0  # standard deviations that a gain must exceed
BOUND = 4  # upper bound that is advised for what a model lacks, over its estimate
ENOUGH = 4  # least measured numbers per unknown
DRIVING = (  # options which a log replaces
    "controller",
    "control_dt",
    "ctrl_from",
    "policy",
    "push",
    "ctrl_noise",
    "ctrl_noise_time",
    "replay",
    "replay_mode",
    "perturb",
)
LENGTH = ("duration", "steps")  # of an excitation
READING = ("quat", "replay_rate", "replay_interpolation", "replay_unwrap")  # of tables that are replayed
TOLERANCE = 1e-3  # difference of costs due to rounding: relative, and in standard deviations of the noise

Partial = Callable[[FitResult], None]


@dataclass(frozen=True, eq=False)
class GoodnessOfFit:
    """Residuals of a fit compared with the noise of the log.

    Attributes:
      residuals: residual of each signal in its unit, `(signals,)`.
      noise: noise of each signal in its unit, `(signals,)`.
      ratios: residual over noise of each signal, `(signals,)`.
      shares: residual over spread of each signal, `(signals,)`.
      reduced: reduced χ², about 1 if the model explains all but noise.
      limit: reduced χ² that noise alone hardly ever exceeds.
      loss: loss function of the residuals.
      estimate: parameters and their errors if contacts make the motion rough.
      correlation: largest correlation of the noise of consecutive samples of a signal.
      is_smooth: whether residuals beyond an estimated noise have far smaller high frequencies than white noise.
    """

    residuals: Floats
    noise: Floats
    ratios: Floats
    shares: Floats
    reduced: float
    limit: float
    loss: str
    estimate: RoughMotionEstimate | None
    correlation: float = 0.0
    is_smooth: bool = False

    @property
    def is_beyond_noise(self) -> bool:
        """True if residuals are larger than noise alone explains."""
        return self.reduced >= self.limit

    def warning(self) -> str | None:
        """Returns a sentence on a misfit, or None."""
        lack = self.estimate.lack if self.estimate else None
        if not lack and (not self.is_beyond_noise or self.remark()):
            return None
        reason = "the model lacks something"
        size = f"if the noise is larger than the high frequencies of the log suggest, set {option('noise')}"
        if self.is_smooth:
            reason = "the model lacks something, or the log has slow noise (of filters, interpolation or hum)"
            size = f"if the log has slow noise, set {option('noise')} to its size"
        if lack:
            reason = (
                f"contacts make the motion rough, but the log is {lack.deviations:.2g} standard deviations from "
                f"simulations in the direction in which {lack.path}={lack.value:.2g} moves them, so the model lacks "
                "something"
            )
        elif self.estimate:
            reason = (
                "contacts make the motion rough, but the log differs from simulations in ways in which these do not "
                "differ from each other, so the model lacks something"
            )
        missing = f"{lack.path}=0..{BOUND * lack.value:.2g}" if lack else "joint/*.damping"
        steps = [f"add what may be missing to {option('free')}, such as {missing}", size]
        if self.loss == "linear":
            steps.append(f"if it has outliers, set {option('loss')} huber")
        return (
            f"the fit leaves residuals beyond the noise of the log (reduced χ² {self.reduced:.3g}): {reason}, and the "
            f"intervals, which cover only scatter, may exclude the true values\n{'; '.join(steps)}"
        )

    def remark(self) -> str | None:
        """Returns a sentence on residuals beyond the noise that contacts alone may cause, or None."""
        if not self.is_beyond_noise or not (self.estimate and self.estimate.is_likely) or self.estimate.lack:
            return None
        return (
            f"contacts make the motion rough: simulations of it differ from each other as much as from the log, so a "
            f"reduced χ² of {self.reduced:.3g} may come from contacts alone"
        )

    def remarks(self) -> list[str]:
        """Returns sentences on the noise and on residuals beyond it that need no warning."""
        of_noise = (
            f"the noise of the log is correlated, by {self.correlation:.2g} from one sample to the next, and larger "
            "than its high frequencies suggest"
        )
        return [each for each in (of_noise if self.correlation else None, self.remark()) if each]

    def refusal(self, columns: Sequence[Column]) -> str | None:
        """Returns the reason why nothing is written; None if the residuals are acceptable."""
        bad = np.flatnonzero((self.ratios > HOPELESS) & (self.shares > HOPELESS_SHARE)).tolist()
        if not bad or (self.estimate and self.estimate.is_likely):
            return None
        worst = [
            f"{clean(columns[i].name)} by {self.residuals[i]:.3g} {columns[i].unit}".rstrip()
            + f", {self.residuals[i] / self.noise[i]:.3g} times its noise"
            for i in bad
        ]
        return (
            f"the best fit misses {listing(worst)}\nthe model lacks something, or the log has other units, signs or "
            f"clocks than the model ({option('map')}; {option('free')} delay:ctrl/* finds a delay)"
        )


def misfit(
    solution: Solution, noise: Floats, rotations: Sequence[Sequence[int]], set_by_user: Collection[int] = ()
) -> GoodnessOfFit:
    """Compares the residuals of a solution with the noise of the log.

    High frequencies of a log also contain those of the motion, under random controls or at impacts, so the noise is not
    larger than high frequencies of the residuals show. These show only a share of noise that is correlated from sample
    to sample, so that it is larger.

    The fewer numbers are measured, the more χ² varies by chance, also because the noise is estimated from them; more so
    with robust losses, which use medians. All signals count alike in it, so those with few samples decide.

    Args:
      noise: standard deviation of the noise of each signal, `(signals,)`, as that of white noise.
      set_by_user: indices of the signals whose noise the user has set.
    """
    values = np.concatenate([part.values for part in solution.chunks])
    visible = shared(visible_noise(solution.residuals) * solution.noise, rotations)
    least = rounding(values, rotations)
    left = shared(solution.noise_scale, rotations)
    correlations, is_estimated = _correlations(solution), np.ones(len(noise), bool)
    is_estimated[[*set_by_user]] = False
    correlations[~is_estimated | (left < least)] = 0.0  # residuals of an exact log are the rounding of simulations
    noise = np.where(is_estimated, np.minimum(noise, np.maximum(visible, least)), noise)
    noise = noise / shared(np.sqrt(visible_share(correlations)), rotations)
    spread = shared(spread_of(values, solution.loss), rotations)
    ratios = left / np.maximum(noise, LEAST * spread)
    counts = np.sum([np.isfinite(each).sum(axis=0) for each in solution.residuals], axis=0)
    lost = counts.sum() / max(counts.sum() - solution.unknowns, 1)
    reduced = float((ratios**2).mean() * lost)
    scatter = np.sqrt(2 * lost * (1 / np.maximum(counts, 1)).mean() / len(counts))
    chance = CHANCE if solution.loss == "linear" else CHANCE_OF_MEDIANS
    limit = max(MISFIT, float(np.exp(chance * scatter)))
    shares = left / np.where(spread > 0, spread, np.nan)
    correlation = float(correlations.max())
    beyond = is_estimated & (ratios**2 >= limit)
    is_smooth = bool((beyond & (left**2 >= limit * visible**2)).any())
    return GoodnessOfFit(
        left, noise, ratios, shares, reduced, limit, solution.loss, solution.estimate, correlation, is_smooth
    )


def _correlations(solution: Solution) -> Floats:
    """Returns the correlation of the noise of consecutive samples of each signal, `(signals,)`; 0 if it is white."""
    if solution.loss != "linear":
        return np.zeros(len(solution.noise))
    if solution.estimate:
        found = solution.estimate.correlations
        return np.zeros(len(solution.noise)) if found is None else found.copy()
    return noise_correlations(solution.residuals)


def all_at_bounds(paths: Sequence[str], coordinates: Floats) -> str | None:
    """Returns a sentence if all parameters have ended at a bound; None otherwise."""
    bounds = [bound_reached(each) for each in coordinates]
    if not all(bounds):
        return None
    places = listing([f"{clean(path)} at its {bound} bound" for path, bound in zip(paths, bounds, strict=True)])
    return (
        f"no values within the bounds of {option('free')} explain the measurements: {places}\nsigns, units or bounds "
        f"may be wrong; set a known value with {option('set')} instead"
    )


@dataclass(frozen=True)
class PredictionImprovement:
    """Improvement of the predictions by a fitted model over the original one.

    Attributes:
      before, after: errors in standard deviations of the noise.
      gain: decrease of the sum of squared errors under the loss.
      uncertainty: gain that chance alone may cause.
      difference: root mean square difference of the predictions, in the unit of the errors.
    """

    before: float
    after: float
    gain: float
    uncertainty: float
    difference: float

    @property
    def is_silent(self) -> bool:
        """True if both models predict the same within the noise, so the measurements cannot distinguish them."""
        return abs(self.gain) <= self.uncertainty and self.difference < max(self.after, 1.0)

    @property
    def is_certain(self) -> bool:
        """True if the gain exceeds its uncertainty."""
        return self.gain > self.uncertainty


def improvement(before: Solution, after: Solution) -> PredictionImprovement:
    """Compares two models by the same measurements.

    If the second is right, its residuals r are noise, and those of the first are r + δ: the gain is Σ δ² + 2 Σ δ·r,
    whose second part is chance. Under a robust loss, weights limit what a residual can change. The standard deviation
    is the larger of two estimates: from sums over blocks of time, within which r may be correlated, and from white
    noise, which is no smaller than assumed: bodies at rest may leave less by chance.
    """
    loss = LOSSES[after.loss]
    scale = max(after.cost, 1.0)
    gain, squares, numbers, sums = 0.0, 0.0, 0, list[float]()
    for r, other, v, w in zip(after.residuals, before.residuals, after.weights, before.weights, strict=True):
        gain += float(np.nansum(loss(other**2) - loss(r**2)))
        numbers += int(np.isfinite(r).sum())
        change = np.nan_to_num(w * other - v * r)
        squares += float((change**2).sum())
        products = (change * np.nan_to_num(r)).sum(axis=1)
        blocks = max(BLOCKS // len(after.residuals), 1)
        sums += [float(block.sum()) for block in np.array_split(products, min(blocks, len(products)))]
    deviation = 2 * max(float(np.sqrt(np.sum(np.square(sums)))), scale * float(np.sqrt(squares)))
    difference = float(np.sqrt(squares / max(numbers, 1)))
    return PredictionImprovement(before.cost, after.cost, gain, CERTAIN * deviation, difference)


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
        require_without(self.simulation, DRIVING, "a fit: the motion and the controls are those of the measurements")
        require_without(self.simulation, READING, "the table of a fit")
        require_without(self.simulation, ("until",), "a fit: the measurements set its length")

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
        if self.excite is not None:
            raise UsageError(f"{option('excite')} designs an input instead: mjrun.excite(fit)", ("excite",))
        copied = self.simulation.with_snapshot()  # edits during the fit have no effect
        assert copied.snapshot
        # Warnings concern unstable simulations, which are reported with their parameters.
        with copied.snapshot.original_names_in_errors(), collected_warnings():
            run = _Run(replace(self, simulation=copied), reporter or PythonApiReporter())
            try:
                return run.all()
            except (KeyboardInterrupt, EndRequestedError):
                if self.keep_partial and (result := run.partial_result()) and partial:
                    partial(result)
                raise


class _Run:
    def __init__(self, fit: Fit, reporter: Reporter) -> None:
        self._fit, self._reporter, self._begin = fit, reporter, time.perf_counter()
        require_all(EXTRAS)
        simulation = fit.simulation
        require_without(simulation, LENGTH, f"a fit: the measurements set its length, except with {option('excite')}")
        if not fit.data:
            raise UsageError(f"{option('data')}: a fit needs a table of measurements")
        model = simulation.load()
        data = simulation.start.data(model)
        self._logs = logs = [*fit.data, *fit.holdout_data]
        if twice := set(fit.data) & set(fit.holdout_data):
            raise UsageError(f"{option('holdout_data')}: {clean(min(twice))} is both fitted and held out")
        if twice := {log for log in logs if logs.count(log) > 1}:
            raise UsageError(f"{clean(min(twice))} is given twice", ("data",))
        linear = simulation.ctrl_interpolation == "linear"
        inputs = (logs, model, simulation.map, data.ctrl)
        self._measurements = read_measurements(*inputs, lambda whole: self._parts(whole)[0], linear=linear)
        self._fitted, self._held = self._parts(self._measurements)
        if fit.holdout_data and not self._held.segments:
            raise UsageError(
                f"{option('holdout_data')} measures nothing that is fitted: {listing(self._measurements.signals)}"
            )
        delayed = [*self._measurements.signals, *(f"{CONTROLS}{name}" for name in control_names(model))]
        self._parameters = free_parameters(fit.free, simulation.source, delayed)
        for each in self._parameters:
            require_effect(each, simulation.source)
        self._predictor = Predictor(simulation, self._measurements.signals, self._parameters)
        self._require_enough()
        self._noise = first_noise([each.values for each in self._fitted.segments], self._measurements.rotations)
        self._set_noise = set_noise(fit.noise, self._measurements.signals)
        for place, deviation in self._set_noise.items():
            self._noise[place] = deviation
        starting = StateGuesses(model, self._measurements.signals, state.save(model, data), self._noise)
        self._shooting = ShootingFit(self._predictor, self._parameters, starting, fit.loss, simulation.seed)
        self._outputs = FitOutputs(fit, simulation, self._predictor, self._parameters)
        idle = self._without_effect(model, starting)
        self._remarks = [*self._measurements.remarks, *idle, *self._outputs.remarks]
        self._latest: Solution | None = None

    def all(self) -> FitResult:
        sharing = [each.sharing for each in self._parameters if each.sharing]
        for remark in [*self._remarks, *sharing]:
            self._reporter.note(remark)
        starts = self._informative(self._starts(self._fit.starts))
        search = self._searched(starts)
        last = self._own_noise(search.best)
        known = sensitivity([last], self._parameters)
        left = misfit(search.best, self._noise, self._measurements.rotations, self._set_noise)
        for remark in left.remarks():
            self._reporter.note(remark)
        failures = self._predictor.failures.sentence(self._parameters)
        hints = [each for each in (left.warning(), failures) if each]
        reasons = [left.refusal(self._predictor.columns)]
        if left.is_beyond_noise:
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
        left = misfit(self._latest, self._noise, self._measurements.rotations, self._set_noise)
        last = self._own_noise(self._latest)
        result = self._result(last, sensitivity([last], self._parameters), left, {}, [], [], partial=True)
        return self._outputs.publish(result, {}, self._logs, self._reporter, model_alone=True)

    def _searched(self, starts: Sequence[np.ndarray]) -> OriginalAndBestSolutions:
        """Searches for parameters that explain whole segments better than the original model."""

        def advanced(solution: Solution) -> None:
            if self._latest is None or solution.cost < self._latest.cost:
                self._latest = solution
            self._reporter.progress("stages of the fit", 0, 1)

        search = self._shooting.search(self._fitted.segments, starts, self._noise, advanced)
        if not search.best.estimate:
            weighted = self._shooting.weighted(search.best)
            if weighted.cost <= with_noise(search.own, weighted.noise).cost:
                search.best = weighted
        self._reporter.progress("stages of the fit", 1, 1)
        own = with_noise(search.own, search.best.noise)
        if search.best.cost > max(own.cost, TOLERANCE) * (1 + TOLERANCE):
            raise UnimprovedFitError(
                "no values explain the fitted part of the log better than those of the model\n"
                f"try narrower bounds with {option('free')}, or more {option('starts')}; nothing was written"
            )
        return search

    def _parts(self, whole: Measurements) -> tuple[Measurements, Measurements]:
        """Separates the measurements to fit from those that are held out."""
        if self._fit.holdout_data:
            return whole.without(self._fit.holdout_data)
        fitted, held = whole.split(self._fit.holdout) if self._fit.holdout else (whole, replace(whole, segments=[]))
        if not fitted.segments:
            raise UsageError(f"{option('holdout')} {self._fit.holdout:g} leaves nothing to fit")
        return fitted, held

    def _without_effect(self, model: mujoco.MjModel, starting: StateGuesses) -> list[str]:
        """Returns remarks on initial positions and velocities, and on controls, that the measurements replace."""
        simulation, timestep, idle = self._fit.simulation, self._predictor.timestep, list[tuple[str, str]]()
        parts = self._shooting.cut(self._measurements.segments)
        guesses = [starting.guess(part, timestep) for part in parts]
        for name, key, without in simulation.start.without_each(model):
            if np.array_equal(guesses, [starting.guess(part, timestep, without) for part in parts]):
                idle.append((name, key))
        controls = control_names(model)
        for key in simulation.ctrl:
            names = {name for part in control_slices(model, key) for name in controls[part]}
            if names <= self._measurements.commands:
                idle.append(("ctrl", key))
        return [f"{option(name)} {clean(key)} does nothing: the measurements set it" for name, key in idle]

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
        values = np.concatenate([segment.values for segment in self._fitted.segments])
        least = least_noise(values, self._measurements.rotations)  # improvements within this rounding are no evidence
        comparisons = {key: with_noise(each, np.maximum(each.noise, least)) for key, each in comparisons.items()}
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
        left: GoodnessOfFit,
        comparisons: Solutions,
        ways: Sequence[str],
        hints: Sequence[str],
        *,
        partial: bool = False,
    ) -> FitResult:
        fit = self._fit
        known = intervals(last, self._parameters, fit.confidence, fit.simulation.seed)
        values, model = values_at(self._parameters, last.coordinates), self._predictor.model
        parameters = [
            FittedParameter(p.path, p.start, value, low, high, effect, bound_reached(coordinate), p.unit(model))
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
            [*map(spelled, [*self._remarks, *left.remarks(), *hints])],
            ways,
            [],
            time.perf_counter() - self._begin,
            fit.loss,
            partial,
        )

    def _signals(self, last: Solution, left: GoodnessOfFit, comparisons: Solutions) -> list[FittedSignal]:
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
    with warnings.catch_warnings(action="ignore", category=RuntimeWarning):  # NaN where held-out data lack a signal
        spread = shared(spread_of(values, solution.loss), rotations)
        return shared(solution.noise_scale, rotations) / np.where(spread > 0, spread, np.nan)
