"""An input that makes parameters identifiable: of many chirps that stay within limits, the one that tells most."""

import itertools
import time
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjrun.errors import UnidentifiableError, UsageError, clean, listing, option
from mjrun.fit.chirp import chirps, control_room
from mjrun.fit.comparison import TIME
from mjrun.fit.fit import Fit
from mjrun.fit.free_parameter import free_parameters, require_effect
from mjrun.fit.identifiability import sensitivity
from mjrun.fit.measurements import CONTROLS, Segment, commands
from mjrun.fit.motion_limits import MotionLimits
from mjrun.fit.prediction import Chunk, Predictor, Rollout
from mjrun.fit.projection import all_information
from mjrun.fit.shooting import Shooting
from mjrun.fit.solution import Solution
from mjrun.fit.starting_states import StartingStates
from mjrun.formats.table_writer import TableWriter
from mjrun.formats.tables import output_format
from mjrun.model import state
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.names import control_names, names
from mjrun.options.fit import EXTRAS
from mjrun.packages import require_all
from mjrun.probe.fields import field_probe
from mjrun.reporter import Reporter, WarningReporter

SCHEMA = "mjrun-excite-1"
DURATION = 10.0  # [s], where nothing else is said
PERIOD = 0.01  # between commands [s]
CANDIDATES = 16
CORNERS = 8  # at most, of the bounds of the parameters
RIVALS = 4  # inputs that are made weaker when none is within limits at the corners
WEAKER = 0.7  # by which chirps become weaker, until the motion is within limits
TRIES = 12

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ExpectedParameter:
    """A parameter, and how well it will be known.

    Attributes:
      path: in the model, or the delay of a signal.
      start: what the model has.
      low, high: ends of the confidence interval to expect if this is the truth.
      effect: how many standard deviations of their noise the measurements change between its bounds.
    """

    path: str
    start: float
    low: float
    high: float
    effect: float


@dataclass(frozen=True)
class MotionExtent:
    """How far something goes while the model is excited.

    Attributes:
      name: of a column: a position, a velocity or a force.
      unit: of it.
      low, high: its least and its largest value.
      least, most: its limits; None without.
    """

    name: str
    unit: str
    low: float
    high: float
    least: float | None
    most: float | None


@dataclass(frozen=True)
class ExcitationResult:
    """An input, and what is to be expected of a fit of what it makes.

    Attributes:
      parameters: what is looked for.
      motion: how far the model moves.
      confidence: of the intervals.
      noise: standard deviation of the measured positions that was assumed [rad, m].
      condition: how well the parameters can be told apart: ratio of singular values.
      duration: of the input [s].
      candidates: how many inputs were within limits, and compared.
      corners: with how many sets of values at the bounds of the parameters it was simulated too.
      contacts: of what begins to touch on the way, in words.
      files: what was written.
      wall: wall time [s].
      schema: of this document.
    """

    parameters: Sequence[ExpectedParameter]
    motion: Sequence[MotionExtent]
    confidence: float
    noise: float
    condition: float
    duration: float
    candidates: int
    corners: int
    contacts: Sequence[str]
    files: Sequence[str]
    wall: float
    schema: str = SCHEMA


def excite(fit: Fit, reporter: Reporter | None = None) -> ExcitationResult:
    """Finds and writes an input for the parameters that `fit` looks for; its `data` are not there yet.

    Chirps of all actuators, drawn by the seed, are made weaker until the model as it is moves within the ranges of its
    joints and forces, and its speed limit. That whose information matrix has the largest determinant is chosen
    (D-optimality), if the model stays within limits at corners of the bounds of the parameters too; else the next one.

    Raises:
      UnidentifiableError: the best input does not tell what is looked for either; nothing is written.
      MjrunError: there is no such input.
    """
    with collected_warnings():  # of what becomes unstable, which is told with the values
        return _Excitation(fit, reporter or WarningReporter()).best()


class _Excitation:
    def __init__(self, fit: Fit, reporter: Reporter) -> None:
        self._fit, self._reporter, self._begin = fit, reporter, time.perf_counter()
        require_all(EXTRAS)
        assert fit.excite is not None
        of_fits = {
            "data": fit.data,
            "output": fit.output,
            "comparison": fit.comparison,
            "ranges": fit.ranges,
            "html": fit.html,
        }
        for name, given in of_fits.items():
            if given:
                raise UsageError(f"{option('excite')} comes before anything is measured: leave {option(name)} out")
        simulation = fit.simulation
        self._model = model = simulation.load()
        data = simulation.start.data(model)
        if not model.nu:
            raise UsageError(f"{option('excite')}: this model has no actuators")
        self._start = state.save(model, data)
        self._middle, self._reach = control_room(model, data.ctrl)
        self._limits = MotionLimits(model, fit.velocity_limit)
        signals = [column.name for column in self._limits.columns[self._limits.positions]]
        if not signals:
            raise UsageError(f"{option('excite')}: this model has no hinges and slides whose positions are measured")
        delayed = [*signals, *(f"{CONTROLS}{name}" for name in control_names(model))]
        self._parameters = free_parameters(fit.free, simulation.source, delayed)
        for each in self._parameters:
            require_effect(each, simulation.source)
        self._coordinates = np.array([each.first_coordinate for each in self._parameters])
        self._judge = Predictor(simulation, [column.name for column in self._limits.columns], self._parameters)
        predictor = Predictor(simulation, signals, self._parameters)
        self._shooting = Shooting(predictor, self._parameters, StartingStates(model, signals, self._start))
        self._signals = signals

    def best(self) -> ExcitationResult:
        candidates = self._within_limits()
        looks = [self._look(segment) for segment, _ in candidates]
        scores = [np.linalg.slogdet(all_information(look, self._parameters))[1] for look in looks]
        order = np.argsort(scores)[::-1].tolist()
        self._require_told(looks[order[0]])
        corners = self._corners()
        segment, motion = self._within_limits_at(corners, [candidates[index] for index in order])
        look = self._look(segment)
        self._require_told(look)
        return self._published(segment, motion, look, len(candidates), corners)

    def _corners(self) -> list[Floats]:
        """Coordinates at the bounds, all of them or some spread evenly; those that cannot be simulated are told."""
        from scipy.stats import qmc

        count = len(self._parameters)
        if 2**count <= CORNERS:
            corners = [np.array(each, float) for each in itertools.product((0, 1), repeat=count)]
        else:
            sobol = qmc.Sobol(count, rng=np.random.default_rng(self._fit.simulation.seed))
            corners = list(np.unique(np.round(sobol.random(CORNERS)), axis=0))
        timestep = float(self._model.opt.timestep)
        still = self._segment(np.array([0.0, self._duration(timestep)]), np.tile(self._middle, (2, 1)))
        able: list[Floats] = []
        for corner in corners:
            if np.isfinite(self._motions([still], corner)[0]).all():
                able.append(corner)
            else:
                self._reporter.warn(f"with {self._values(corner)}, nothing can be simulated, nor limits be checked")
        return able

    def _values(self, coordinates: Floats) -> str:
        pairs = zip(self._parameters, coordinates, strict=True)
        return listing([f"{p.path}={p.value(c):.4g}" for p, c in pairs])

    def _within_limits_at(
        self, corners: Sequence[Floats], inputs: Sequence[tuple[Segment, Floats]]
    ) -> tuple[Segment, Floats]:
        """The first of the inputs, best first, that stays within limits at the corners, weaker if need be."""
        reason = ""
        for trial in range(TRIES):
            for segment, motion in inputs if trial == 0 else inputs[:RIVALS]:
                if trial:
                    controls = self._middle + WEAKER**trial * (segment.controls - self._middle)
                    segment = self._segment(segment.times, controls)
                    (motion,) = self._motions([segment])
                why = self._limits.violation(motion) or self._violation_at(corners, segment)
                if why is None:
                    return segment, motion
                reason = reason or why
        raise UsageError(
            f"{option('excite')}: with parameters at their bounds even the weakest chirp is beyond a limit: {reason}\n"
            f"narrower bounds in {option('free')} say what the parameters can be"
        )

    def _violation_at(self, corners: Sequence[Floats], segment: Segment) -> str | None:
        for corner in corners:
            if why := self._limits.violation(self._motions([segment], corner)[0]):
                return f"{why}, with {self._values(corner)}"
        return None

    def _contacts(self, segment: Segment, corners: Sequence[Floats]) -> list[str]:
        """What begins to touch with the model as it is, and with others, and when, by a bare loop."""
        touching: dict[tuple[str, str], str] = {}
        steps = round(segment.times[-1] / self._judge.timestep)
        controls = commands(segment, 0, steps, self._judge.timestep, False, {})
        for coordinates in [self._coordinates, *corners]:
            values = [p.value(c) for p, c in zip(self._parameters, coordinates, strict=True)]
            model = self._judge.model_with(values)
            data = mujoco.MjData(model)
            state.restore(model, data, self._start)
            mujoco.mj_forward(model, data)
            known = _touching(model, data)
            for step, control in enumerate(controls):
                data.ctrl[:] = control
                mujoco.mj_step(model, data)
                if data.ncon:
                    for pair in _touching(model, data) - known:
                        touching.setdefault(
                            pair, f"{pair[0]} and {pair[1]} touch from {step * self._judge.timestep:.2f} s on"
                        )
                        known.add(pair)
        return list(touching.values())

    def _within_limits(self) -> list[tuple[Segment, Floats]]:
        """Inputs that move the model within its limits, and the motion, `(steps, columns)` of the limits."""
        generator = np.random.default_rng(self._fit.simulation.seed)
        timestep = float(self._model.opt.timestep)
        period = max(round(PERIOD / timestep), 1) * timestep
        times = np.arange(0.0, self._duration(timestep) + period / 2, period)
        zero, reach = np.zeros(self._model.nu), self._reach
        left = [chirps(times, zero, reach, generator) for _ in range(CANDIDATES)]
        candidates: list[tuple[Segment, Floats]] = []
        reason = ""
        for trial in range(TRIES):
            inputs = [self._segment(times, self._middle + WEAKER**trial * each) for each in left]
            motions = self._motions(inputs)
            reasons = [self._limits.violation(motion) for motion in motions]
            candidates += [(i, m) for i, m, why in zip(inputs, motions, reasons, strict=True) if why is None]
            left = [each for each, why in zip(left, reasons, strict=True) if why is not None]
            if not left:
                return candidates
            reason = next(why for why in reasons if why is not None)
        if not candidates:
            raise UsageError(f"{option('excite')}: even the weakest chirp is beyond a limit: {reason}")
        return candidates

    def _duration(self, timestep: float) -> float:
        simulation = self._fit.simulation
        if simulation.steps is not None:
            return simulation.steps * timestep
        return DURATION if simulation.duration is None else float(simulation.duration)

    def _segment(self, times: Floats, controls: Floats) -> Segment:
        return Segment("", times, np.zeros((len(times), len(self._signals))), controls)

    def _motions(self, inputs: Sequence[Segment], coordinates: Floats | None = None) -> list[Floats]:
        """What the model does at every step, as it is or with other parameters."""
        coordinates = self._coordinates if coordinates is None else coordinates
        values = tuple(p.value(c) for p, c in zip(self._parameters, coordinates, strict=True))
        steps = np.arange(round(inputs[0].times[-1] / self._judge.timestep) + 1)
        chunks = [Chunk(each, slice(None), 0, steps) for each in inputs]
        return self._judge.predict([Rollout(chunk, values, self._start) for chunk in chunks])

    def _look(self, segment: Segment) -> Solution:
        parts = self._shooting.cut([segment])
        noise = np.full(len(self._signals), self._fit.excite_noise)
        return self._shooting.look(parts, self._coordinates, self._start[None], noise)

    def _require_told(self, look: Solution) -> None:
        messages = [each.message for each in sensitivity([look], self._parameters).unidentifiable]
        if messages and not self._fit.allow_unidentifiable:
            raise UnidentifiableError(messages)
        for message in messages:
            self._reporter.warn(message)

    def _published(
        self, segment: Segment, motion: Floats, look: Solution, candidates: int, corners: Sequence[Floats]
    ) -> ExcitationResult:
        fit, limits = self._fit, self._limits
        if contacts := self._contacts(segment, corners):
            self._reporter.warn(f"contacts begin, and a fit takes them as the model has them: {listing(contacts)}")
        known = sensitivity([look], self._parameters)
        assert fit.excite is not None
        columns = [TIME, *field_probe(self._model, "ctrl").columns]
        with TableWriter(fit.excite, output_format(fit.excite).name, columns) as writer:
            writer.write(np.column_stack([segment.times, segment.controls]))
            files = [str(file) for file in writer.publish()]
        return ExcitationResult(
            self._expected(look, known.effects),
            [
                MotionExtent(c.name, c.unit, float(values.min()), float(values.max()), _finite(low), _finite(high))
                for c, values, low, high in zip(limits.columns, motion.T, limits.low, limits.high, strict=True)
            ],
            fit.confidence,
            fit.excite_noise,
            known.condition,
            float(segment.times[-1]),
            candidates,
            len(corners),
            contacts,
            files,
            time.perf_counter() - self._begin,
        )

    def _expected(self, look: Solution, effects: Sequence[float]) -> list[ExpectedParameter]:
        """The intervals of a fit that has white noise alone to do with, by the Cramér-Rao bound."""
        from scipy import special

        spread = np.sqrt(np.diag(np.linalg.pinv(all_information(look, self._parameters), hermitian=True)))
        reach = float(special.ndtri((1 + self._fit.confidence) / 2)) * spread
        low, high = np.clip(self._coordinates - reach, 0, 1), np.clip(self._coordinates + reach, 0, 1)
        rows = zip(self._parameters, self._coordinates, low, high, effects, strict=True)
        return [ExpectedParameter(p.path, p.value(c), p.value(a), p.value(b), effect) for p, c, a, b, effect in rows]


def _touching(model: mujoco.MjModel, data: mujoco.MjData) -> set[tuple[str, str]]:
    """Names of the geoms that touch."""
    geoms = names(model, "geom")
    pairs = [
        sorted(clean(geoms[i]) for i in pair) for pair in data.contact.geom[: data.ncon].tolist() if min(pair) >= 0
    ]
    return {(one, other) for one, other in pairs}


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
