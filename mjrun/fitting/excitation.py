"""Inputs that make parameters identifiable: of many chirps within limits, the most informative one."""

import itertools
import math
import time
from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UnidentifiableError, UsageError, clean, listing, option
from mjrun.fitting.fit import Fit
from mjrun.fitting.free_parameter import free_parameters, require_effect
from mjrun.fitting.information import all_information, sensitivity
from mjrun.fitting.measurements import CONTROLS, Floats, LogSegment, commands
from mjrun.fitting.outputs import TIME
from mjrun.fitting.prediction import Chunk, ChunkRolloutInputs, Predictor
from mjrun.fitting.shooting_fit import ShootingFit
from mjrun.fitting.shooting_problem import Solution
from mjrun.fitting.starting_states import StateGuesses
from mjrun.formats.table_writer import TableWriter
from mjrun.formats.tables import output_format
from mjrun.model import state
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.names import SCALAR_JOINTS, control_names, names
from mjrun.model.table_column import Column, with_unit
from mjrun.options.fit import EXTRAS
from mjrun.options.option import given_values
from mjrun.packages import require_all
from mjrun.probe.fields import field_probe
from mjrun.reporter import PythonApiReporter, Reporter
from mjrun.simulation.simulation import require_without

FREQUENCIES = (0.1, 10.0)  # [Hz]
SWEEP = 3.0  # least ratio of the two frequencies of a chirp
WEAKEST = 0.3  # least amplitude of a chirp, as a share of its range
TAPER = 0.2  # share of the time in which chirps swell and fade
SCHEMA = "mjrun-excite-1"
DURATION = 10.0  # default [s]
PERIOD = 0.01  # between commands [s]
CANDIDATES = 16
CORNERS = 8  # limit of corners of the bounds of the parameters
RIVALS = 4  # number of inputs that are weakened if none is within limits at the corners
WEAKER = 0.7  # factor by which chirps are weakened until the motion is within limits
TRIES = 12
SLACK = 0.01  # margin at both ends of a range, as a share of it
OF_FITS = (  # options that concern measurements
    *("data", "holdout_data", "holdout", "noise", "loss", "starts", "keep_partial"),
    *("output", "comparison", "ranges", "html", "video"),
)
FIELDS = ("qpos", "qvel", "actuator_force", "qfrc_actuator")


def chirps(times: Floats, middle: Floats, reach: Floats, generator: np.random.Generator) -> Floats:
    """Draws a chirp for each actuator: controls at `times`, `(n, nu)`, within `middle` ± `reach`.

    They begin and end at `middle`. Frequencies grow or fall exponentially between two random ones.
    """
    from scipy.signal import windows

    envelope = windows.tukey(len(times), TAPER)[:, None]
    waves = np.column_stack([_wave(times - times[0], generator) for _ in middle])
    amplitudes = generator.uniform(WEAKEST, 1.0, len(middle)) * reach
    return np.asarray(middle + envelope * amplitudes * waves, np.float64)


def _wave(times: Floats, generator: np.random.Generator) -> Floats:
    least, most = (float(np.log(each)) for each in FREQUENCIES)
    low = generator.uniform(least, most - math.log(SWEEP))
    high = generator.uniform(low + math.log(SWEEP), most)
    first, last = np.exp([low, high] if generator.random() < 0.5 else [high, low])
    rate = math.log(last / first) / times[-1]
    return np.sin(2 * math.pi * first * np.expm1(rate * times) / rate)


def control_room(model: mujoco.MjModel, controls: Floats) -> tuple[Floats, Floats]:
    """Returns the centre of each control's chirp and the largest amplitude, `(nu,)` each.

    Chirps are centred on `controls` where these are within the control range, otherwise on its middle. A position servo
    without a control range has the range of its joint.

    Raises:
      UsageError: a control has no limits.
    """
    middle, reach = np.zeros(model.nu), np.zeros(model.nu)
    names = control_names(model)
    for index in range(model.nu):
        bounds = _range(model, index)
        if bounds is None:
            raise UsageError(
                f"{option('excite')}: ctrl/{clean(str(names[index]))} has no limits\n"
                f"give it a range: {option('set')} actuator/{clean(str(names[index]))}.ctrlrange=-1,1"
            )
        low, high = bounds
        center = float(controls[index]) if low < controls[index] < high else (low + high) / 2
        middle[index], reach[index] = center, min(center - low, high - center)
    return middle, reach


def _range(model: mujoco.MjModel, control: int) -> tuple[float, float] | None:
    if model.actuator_ctrllimited[control]:
        low, high = model.actuator_ctrlrange[control].tolist()
        return low, high
    index = int(np.searchsorted(model.actuator_ctrladr, control, side="right")) - 1  # of the actuator
    joint = int(model.actuator_trnid[index, 0])
    is_of_joint = model.actuator_trntype[index] == mujoco.mjtTrn.mjTRN_JOINT
    is_servo = model.actuator_biasprm[index, 1] == -model.actuator_gainprm[index, 0] != 0
    if not (is_of_joint and is_servo and model.jnt_limited[joint]):
        return None
    low, high = sorted((model.jnt_range[joint] * model.actuator_gear[model.actuator_outadr[index], 0]).tolist())
    return low, high


class MotionLimits:
    """Limits of the hinges, slides and actuators of a model.

    Args:
      speed: maximum speed of every hinge [rad/s] and slide [m/s]; None if unlimited.

    Attributes:
      columns: limited positions, velocities and forces.
      low, high: limits of each column, infinite without one.
      positions: slice of `columns` with the positions of hinges and slides.
    """

    def __init__(self, model: mujoco.MjModel, speed: float | None) -> None:
        ranges = {field: np.tile([-np.inf, np.inf], (len(field_probe(model, field).columns), 1)) for field in FIELDS}
        limits = {field: np.zeros(len(values), bool) for field, values in ranges.items()}
        for joint in np.flatnonzero(np.isin(model.jnt_type, SCALAR_JOINTS)):
            position, velocity = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
            limits["qpos"][position] = limits["qvel"][velocity] = True
            if model.jnt_limited[joint]:
                ranges["qpos"][position] = model.jnt_range[joint]
            if speed is not None:
                ranges["qvel"][velocity] = -speed, speed
            if model.jnt_actfrclimited[joint]:
                limits["qfrc_actuator"][velocity] = True
                ranges["qfrc_actuator"][velocity] = model.jnt_actfrcrange[joint]
        limited = model.actuator_forcelimited.astype(bool)
        limits["actuator_force"] |= limited
        ranges["actuator_force"][limited] = model.actuator_forcerange[limited]

        self.columns: list[Column] = []
        for field in FIELDS:
            self.columns += [
                c for c, keep in zip(field_probe(model, field).columns, limits[field], strict=True) if keep
            ]
        self.low, self.high = np.concatenate([ranges[field][limits[field]] for field in FIELDS]).T
        self.positions = slice(0, int(limits["qpos"].sum()))

    def violation(self, rows: Floats) -> str | None:
        """Describes the worst violation of a limit in rows of `columns`, `(n, columns)`, or None."""
        if not np.isfinite(rows).all():
            return "the simulation becomes unstable"
        slack = np.where(np.isfinite(self.high - self.low), SLACK * (self.high - self.low), 0.0)
        over = np.maximum(self.low + slack - rows, rows - (self.high - slack))
        if (over <= 0).all():
            return None
        row, index = np.unravel_index(np.argmax(over / np.where(slack > 0, slack, 1.0)), over.shape)
        column, value = self.columns[int(index)], rows[row, index]
        limits = f"{self.low[index]:g} … {self.high[index]:g} {column.unit}".rstrip()
        return f"{clean(column.name)} reaches {value:.4g}, beyond its range {limits}"


@dataclass(frozen=True)
class ExpectedParameterInterval:
    """A parameter with its expected confidence interval.

    Attributes:
      path: path in the model, or the delay of a signal.
      start: value in the model.
      low, high: ends of the confidence interval to expect if this value is true.
      effect: change of the measurements between its bounds, in standard deviations of their noise.
      unit: unit of the values; empty if they have none, or if it is unknown.
    """

    path: str
    start: float
    low: float
    high: float
    effect: float
    unit: str = ""

    @property
    def label(self) -> str:
        """The path with its unit: `joint/hinge.damping [N·m·s/rad]`."""
        return with_unit(self.path, self.unit)


@dataclass(frozen=True)
class MotionExtent:
    """The range of a position, velocity or force while the model is excited.

    Attributes:
      name: name of the column.
      unit: its unit.
      low, high: least and largest value.
      least, most: limits, or None.
    """

    name: str
    unit: str
    low: float
    high: float
    least: float | None
    most: float | None


@dataclass(frozen=True)
class ExcitationResult:
    """An input, and the expected results of a fit of its measurements.

    Attributes:
      parameters: free parameters.
      motion: ranges of positions, velocities and forces.
      confidence: confidence level of the intervals.
      noise: assumed standard deviation of the measured positions [rad, m].
      condition: ratio of singular values; large if parameters are hard to distinguish.
      duration: length of the input [s].
      candidates: number of compared inputs within limits.
      corners: number of corners of the bounds of the parameters at which it was simulated.
      contacts: contacts that begin, in words.
      files: written files.
      wall: wall time [s].
      schema: schema of this document.
    """

    parameters: Sequence[ExpectedParameterInterval]
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
    """Finds and writes an input for the free parameters of `fit`, before anything is measured.

    Random chirps of all actuators are weakened until the model moves within the ranges of its joints and forces and the
    speed limit. The chosen one has the information matrix with the largest determinant (D-optimality), among those with
    which the model also stays within limits at corners of the bounds of the parameters.

    Raises:
      UnidentifiableError: even the best input does not determine the parameters; nothing is written.
      MjrunError: no input is possible.
    """
    copied = fit.simulation.with_snapshot()  # edits in the meantime have no effect
    assert copied.snapshot
    # Warnings concern unstable simulations, which are reported with their parameters.
    with copied.snapshot.original_names_in_errors(), collected_warnings():
        return _Excitation(replace(fit, simulation=copied), reporter or PythonApiReporter()).best()


class _Excitation:
    def __init__(self, fit: Fit, reporter: Reporter) -> None:
        self._fit, self._reporter, self._begin = fit, reporter, time.perf_counter()
        require_all(EXTRAS)
        if fit.excite is None:
            raise UsageError(f"{option('excite')} is missing: it names the table to write")
        given = given_values(fit)
        if name := next((each for each in OF_FITS if each in given), None):
            what = "the tables" if name == "data" else option(name)
            raise UsageError(f"{option('excite')} precedes measurements: leave {what} out", (name,))
        simulation = fit.simulation
        require_without(simulation, ("map",), f"{option('excite')}, which precedes measurements")
        self._model = model = simulation.load()
        data = simulation.start.data(model)
        if not model.nu:
            raise UsageError(f"{option('excite')}: this model has no actuators")
        self._start = state.save(model, data)
        self._middle, self._reach = control_room(model, data.ctrl)
        self._limits = MotionLimits(model, fit.velocity_limit)
        signals = [column.name for column in self._limits.columns[self._limits.positions]]
        if not signals:
            raise UsageError(f"{option('excite')}: this model has no hinges or slides whose positions are measured")
        delayed = [*signals, *(f"{CONTROLS}{name}" for name in control_names(model))]
        self._parameters = free_parameters(fit.free, simulation.source, delayed)
        for each in self._parameters:
            require_effect(each, simulation.source)
        self._coordinates = np.array([each.first_coordinate for each in self._parameters])
        self._judge = Predictor(simulation, [column.name for column in self._limits.columns], self._parameters)
        predictor = Predictor(simulation, signals, self._parameters)
        self._shooting = ShootingFit(predictor, self._parameters, StateGuesses(model, signals, self._start))
        self._signals = signals

    def best(self) -> ExcitationResult:
        candidates = self._within_limits()
        looks = [self._look(segment) for segment, _ in candidates]
        scores = [np.linalg.slogdet(all_information(look, self._parameters))[1] for look in looks]
        order: list[int] = np.argsort(scores)[::-1].tolist()
        self._require_identifiable(looks[order[0]])
        corners = self._corners()
        segment, motion = self._within_limits_at(corners, [candidates[index] for index in order])
        look = self._look(segment)
        self._require_identifiable(look)
        return self._published(segment, motion, look, len(candidates), corners)

    def _corners(self) -> list[Floats]:
        """Returns coordinates at the bounds, all or an even selection; warns of those that cannot be simulated."""
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
                self._reporter.warn(f"limits are not checked with {self._values(corner)}, where the simulation fails")
        return able

    def _values(self, coordinates: Floats) -> str:
        pairs = zip(self._parameters, coordinates, strict=True)
        return listing([f"{p.path}={p.value(c):.4g}" for p, c in pairs])

    def _within_limits_at(
        self, corners: Sequence[Floats], inputs: Sequence[tuple[LogSegment, Floats]]
    ) -> tuple[LogSegment, Floats]:
        """Returns the best of the sorted inputs that stays within limits at the corners, weakened if necessary."""
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
            f"{option('excite')}: with parameters at their bounds, even the weakest chirp exceeds a limit: {reason}\n"
            f"give narrower bounds with {option('free')}"
        )

    def _violation_at(self, corners: Sequence[Floats], segment: LogSegment) -> str | None:
        for corner in corners:
            if why := self._limits.violation(self._motions([segment], corner)[0]):
                return f"{why}, with {self._values(corner)}"
        return None

    def _contacts(self, segment: LogSegment, corners: Sequence[Floats]) -> list[str]:
        """Describes the contacts that begin in the model, and at the corners."""
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

    def _within_limits(self) -> list[tuple[LogSegment, Floats]]:
        """Returns inputs that move the model within its limits, with the motion, `(steps, columns)`."""
        generator = np.random.default_rng(self._fit.simulation.seed)
        timestep = float(self._model.opt.timestep)
        period = max(round(PERIOD / timestep), 1) * timestep
        times = np.arange(0.0, self._duration(timestep) + period / 2, period)
        zero, reach = np.zeros(self._model.nu), self._reach
        left = [chirps(times, zero, reach, generator) for _ in range(CANDIDATES)]
        candidates: list[tuple[LogSegment, Floats]] = []
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
            raise UsageError(f"{option('excite')}: even the weakest chirp exceeds a limit: {reason}")
        return candidates

    def _duration(self, timestep: float) -> float:
        simulation = self._fit.simulation
        if simulation.steps is not None:
            return simulation.steps * timestep
        return DURATION if simulation.duration is None else float(simulation.duration)

    def _segment(self, times: Floats, controls: Floats) -> LogSegment:
        return LogSegment("", times, np.zeros((len(times), len(self._signals))), controls)

    def _motions(self, inputs: Sequence[LogSegment], coordinates: Floats | None = None) -> list[Floats]:
        """Simulates the limited columns at every step, with the parameters of the model or others."""
        coordinates = self._coordinates if coordinates is None else coordinates
        values = tuple(p.value(c) for p, c in zip(self._parameters, coordinates, strict=True))
        steps = np.arange(round(float(inputs[0].times[-1]) / self._judge.timestep) + 1)
        chunks = [Chunk(each, slice(None), 0, steps) for each in inputs]
        return self._judge.predict([ChunkRolloutInputs(chunk, values, self._start) for chunk in chunks])

    def _look(self, segment: LogSegment) -> Solution:
        parts = self._shooting.cut([segment])
        noise = np.full(len(self._signals), self._fit.excite_noise)
        return self._shooting.look(parts, self._coordinates, self._start[None], noise)

    def _require_identifiable(self, look: Solution) -> None:
        messages = [each.message for each in sensitivity([look], self._parameters).unidentifiable]
        if messages and not self._fit.allow_unidentifiable:
            raise UnidentifiableError(messages)
        for message in messages:
            self._reporter.warn(message)

    def _published(
        self, segment: LogSegment, motion: Floats, look: Solution, candidates: int, corners: Sequence[Floats]
    ) -> ExcitationResult:
        fit, limits = self._fit, self._limits
        if contacts := self._contacts(segment, corners):
            self._reporter.warn(f"contacts begin, which a fit assumes to be as in the model: {listing(contacts)}")
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

    def _expected(self, look: Solution, effects: Sequence[float]) -> list[ExpectedParameterInterval]:
        """Returns the intervals of a fit with white noise, by the Cramér-Rao bound."""
        from scipy import special

        spread = np.sqrt(np.diag(np.linalg.pinv(all_information(look, self._parameters), hermitian=True)))
        reach = float(special.ndtri((1 + self._fit.confidence) / 2)) * spread
        low, high = np.clip(self._coordinates - reach, 0, 1), np.clip(self._coordinates + reach, 0, 1)
        rows = zip(self._parameters, self._coordinates, low, high, effects, strict=True)
        return [
            ExpectedParameterInterval(p.path, p.value(c), p.value(a), p.value(b), effect, p.unit(self._model))
            for p, c, a, b, effect in rows
        ]


def _touching(model: mujoco.MjModel, data: mujoco.MjData) -> set[tuple[str, str]]:
    """Returns the names of pairs of geoms in contact."""
    geoms = names(model, "geom")
    contacts: list[list[int]] = data.contact.geom[: data.ncon].tolist()
    pairs = [sorted(clean(geoms[i]) for i in pair) for pair in contacts if min(pair) >= 0]
    return {(one, other) for one, other in pairs}


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
