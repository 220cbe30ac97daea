"""First guesses of the initial states of chunks, from measurements and, for what is not measured, from a simulation."""

import math
from collections.abc import Sequence

import mujoco
import numpy as np

from mjrun.fitting.measurements import LogSegment
from mjrun.fitting.prediction import Chunk, ChunkRolloutInputs, Predictor
from mjrun.model import state
from mjrun.model.names import BALL, FREE
from mjrun.probe.fields import field_probe

JOINTPOS, JOINTVEL = int(mujoco.mjtSensor.mjSENS_JOINTPOS), int(mujoco.mjtSensor.mjSENS_JOINTVEL)
RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)
QUATERNION_PLACES = {FREE: 3, BALL: 0}  # of quaternions and angular velocities within the numbers of a joint
WINDOW = 9  # rows to which a parabola is fitted
WINDOWS = (72, 36, 18, WINDOW)  # numbers of rows that are preferred if a parabola fits them
SAME_STEP = 1e-6  # distance of a row from a timestep at which it shows the state of this step [timesteps]
FITTING = 1.35  # largest residuals of such a parabola, in standard deviations of the noise


class StateGuesses:
    """Guesses of states from measured columns of `qpos` and `qvel`; everything else is taken from a given state.

    Args:
      start: integration state for everything that is not measured, `(nstate,)`.
      noise: standard deviation of each signal, `(signals,)`; 0 where unknown.

    Attributes:
      start: the argument.
      of_states: indices of the signals that measure positions and velocities.
      all_measured: whether measurements determine all positions and velocities, and the model has no activations.
    """

    def __init__(
        self, model: mujoco.MjModel, signals: Sequence[str], start: np.ndarray, noise: np.ndarray | None = None
    ) -> None:
        self._model, self._data, self.start = model, mujoco.MjData(model), start
        self._noise = np.zeros(len(signals)) if noise is None else noise
        self._qpos = measured_positions(model, signals)
        self._qvel = _places(model, "qvel", signals, JOINTVEL)
        self.of_states = sorted({*self._qpos.values(), *self._qvel.values()})
        self._rates = self._rates_of_positions()
        self._turning = self._measured_rotations()
        velocities = {*self._rates, *self._qvel, *(first + k for first in self._turning.values() for k in range(3))}
        self.all_measured = len(self._qpos) == model.nq and len(velocities) == model.nv and not model.na

    def guess(self, chunk: Chunk, timestep: float, start: np.ndarray | None = None) -> np.ndarray:
        """Guesses the integration state `(nstate,)` at the first step of `chunk`.

        Args:
          start: state for everything that is not measured; None for `self.start`.
        """
        data = self._data
        state.restore(self._model, data, self.start if start is None else start)
        self.place(data, chunk, timestep)
        return state.save(self._model, data)

    def sampled(self, chunk: Chunk, timestep: float) -> np.ndarray | None:
        """Returns the integration state `(nstate,)` that the first row of `chunk` shows, if it is at its first step.

        All positions must be measured. Velocities that are not follow from the row before, if this is one step before:
        all integrators but Runge-Kutta move the positions of a step by the velocities after it.
        """
        model, segment, row = self._model, chunk.segment, chunk.rows.start
        is_measured = len(self._qvel) == model.nv
        if len(self._qpos) < model.nq or model.na or abs(chunk.positions[0]) > SAME_STEP:
            return None
        data = self._data
        state.restore(model, data, self.start)
        data.qpos[:] = qpos = segment.values[row, [self._qpos[i] for i in range(model.nq)]]
        if is_measured:
            data.qvel[:] = segment.values[row, [self._qvel[i] for i in range(model.nv)]]
        elif row and model.opt.integrator != RK4:
            before = segment.values[row - 1, [self._qpos[i] for i in range(model.nq)]]
            steps = float(segment.times[row] - segment.times[row - 1]) / timestep
            if abs(steps - 1) > SAME_STEP:
                return None
            mujoco.mj_differentiatePos(model, data.qvel, timestep, before, qpos)
        else:
            return None
        is_known = bool(np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all())
        return state.save(model, data) if is_known else None

    def step_tolerances(self, timestep: float) -> np.ndarray:
        """Returns how exactly each signal must follow from a `sampled` state if the log is exact, in its rounding.

        Where velocities are differences of positions, a force that the model lacks moves the next positions only by
        the square of the timestep.

        Returns:
          Factors of the rounding of each signal, `(signals,)`.
        """
        tolerances = np.ones(len(self._noise))
        if len(self._qvel) < self._model.nv:
            tolerances[[*self._qpos.values()]] = timestep
        return tolerances

    def place(self, data: mujoco.MjData, chunk: Chunk, timestep: float) -> None:
        """Sets the measured positions and velocities of `data` to those at the beginning of `chunk`."""
        rows, seconds, noise = chunk.values[: WINDOWS[0]], chunk.positions[: WINDOWS[0]] * timestep, self._noise
        for index, signal in self._qpos.items():
            data.qpos[index] = _at_start(seconds, rows[:, signal], data.qpos[index], noise[signal])[0]
        for position, velocity in self._turning.items():
            quaternions = rows[:, [self._qpos[position + k] for k in range(4)]]
            if np.isfinite(quaternions).all(axis=1).any():
                quaternion, turning = _rotation_at_start(seconds, quaternions, 2 * noise[self._qpos[position]])
                data.qpos[position : position + 4], data.qvel[velocity : velocity + 3] = quaternion, turning
        for index, signal in self._rates.items():
            data.qvel[index] = _at_start(seconds, rows[:, signal], 0.0, noise[signal])[1]
        for index, signal in self._qvel.items():
            data.qvel[index] = _at_start(seconds, rows[:, signal], data.qvel[index], noise[signal])[0]

    def _rates_of_positions(self) -> dict[int, int]:
        """Maps velocities to the signals whose rates they are, of all joints except rotations about three axes."""
        model, rates = self._model, dict[int, int]()
        for joint in range(model.njnt):
            first, speed = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
            count = QUATERNION_PLACES.get(int(model.jnt_type[joint]), 1)
            rates |= {speed + k: self._qpos[first + k] for k in range(count) if first + k in self._qpos}
        return rates

    def _measured_rotations(self) -> dict[int, int]:
        """Maps indices of measured quaternions in `qpos` to those of their angular velocities in `qvel`."""
        model, speeds = self._model, dict[int, int]()
        for joint in range(model.njnt):
            first, speed = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
            offset = QUATERNION_PLACES.get(int(model.jnt_type[joint]))
            if offset is not None and first + offset in self._qpos:
                speeds[first + offset] = speed + offset
        return speeds


def _rotation_at_start(seconds: np.ndarray, quaternions: np.ndarray, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns quaternion and angular velocity at 0 s, by parabolas of the rotation since the first sample."""
    known = np.isfinite(quaternions).all(axis=1)
    first = quaternions[known][0].copy()
    turns = np.empty((int(known.sum()), 3))
    for turn, quaternion in zip(turns, quaternions[known], strict=True):
        mujoco.mju_subQuat(turn, quaternion, first)
    at_start = [_at_start(seconds[known], angles, 0.0, noise) for angles in turns.T]
    mujoco.mju_quatIntegrate(first, np.array([angle for angle, _ in at_start]), 1.0)
    return first, np.array([rate for _, rate in at_start])


def measured_positions(model: mujoco.MjModel, signals: Sequence[str]) -> dict[int, int]:
    """Maps indices of `qpos` to the signals that measure them, as columns or as sensors of joints."""
    return _places(model, "qpos", signals, JOINTPOS)


def _places(model: mujoco.MjModel, field: str, signals: Sequence[str], sensor: int) -> dict[int, int]:
    """Maps indices of a field to the signals that measure them.

    Args:
      sensor: type of joint sensors that measure the field too.
    """
    names = [column.name for column in field_probe(model, field).columns]
    places = {"qpos": model.jnt_qposadr, "qvel": model.jnt_dofadr}[field]
    sensed = {
        int(places[model.sensor_objid[column.id]]): signals.index(column.name)
        for column in (field_probe(model, "sensordata").columns if model.nsensor else ())
        if column.name in signals and model.sensor_type[column.id] == sensor
    }
    return sensed | {i: signals.index(name) for i, name in enumerate(names) if name in signals}


def _at_start(seconds: np.ndarray, values: np.ndarray, otherwise: float, noise: float) -> tuple[float, float]:
    """Returns value and rate at 0 s of a parabola through the first samples; `otherwise` and 0 without any.

    It uses as many samples as one parabola explains to the noise, since more samples reduce the effect of noise. Of
    each `WINDOW` of them, one may be an outlier. If none explains them, as at an impact, the first sample is better.
    """
    for window in WINDOWS:
        known = np.flatnonzero(np.isfinite(values[:window]))
        if not noise or len(values) < window or len(known) <= window / 2:
            continue
        for _ in range(1 + window // WINDOW):
            powers = np.vander(seconds[known], 3, increasing=True)
            basis, triangle = np.linalg.qr(powers)
            left = values[known] - basis @ (basis.T @ values[known])
            if float(left @ left) < (FITTING * noise) ** 2 * (len(known) - 3):
                factors = np.linalg.solve(triangle, basis.T @ values[known])
                return float(factors[0]), float(factors[1])
            known = np.delete(known, np.argmax(left**2 / (1 - (basis**2).sum(axis=1))))  # the one that explains most
    known = np.flatnonzero(np.isfinite(values[:WINDOW]))
    if not len(known):
        return otherwise, 0.0
    factors = np.polynomial.polynomial.polyfit(seconds[known], values[known], min(2, len(known) - 1))
    rate = float(factors[1]) if len(factors) > 1 else 0.0
    if not noise or len(values) < WINDOW:
        return float(factors[0]), rate
    return float(values[known[0]] - rate * seconds[known[0]]), rate


def simulated_starts(
    predictor: Predictor, starting: StateGuesses, parts: Sequence[Chunk], values: tuple[float, ...] | None
) -> np.ndarray:
    """Simulates states at the beginning of each chunk, `(chunks, nstate)`.

    Every segment is simulated with its commands, and at each of its rows measured positions and velocities are set to
    their measured values. The rest follows from the model: a car of which only the wheels are measured moves as they
    roll.

    Args:
      values: values of the parameters; None for the original model.
    """
    starts = np.empty((len(parts), len(starting.start)))
    for segment in {id(part.segment): part.segment for part in parts}.values():
        places = [i for i, part in enumerate(parts) if part.segment is segment]
        wanted = [parts[i].first_step for i in places]
        states = _simulated(predictor, starting, segment, values, wanted)
        for i in places:
            starts[i] = starting.guess(parts[i], predictor.timestep, states[parts[i].first_step])
    return starts


def _simulated(
    predictor: Predictor,
    starting: StateGuesses,
    segment: LogSegment,
    values: tuple[float, ...] | None,
    wanted: Sequence[int],
) -> dict[int, np.ndarray]:
    """Returns states of the simulation at the steps `wanted`; the start state where nothing can be simulated."""
    states = dict.fromkeys(wanted, starting.start)
    model = predictor.compiled(values)
    if model is None:
        return states
    data = mujoco.MjData(model)
    state.restore(model, data, starting.start)
    rows = _rows_by_step(segment, predictor.timestep)
    last = max(wanted)
    whole = Chunk(segment, slice(None), 0, segment.steps(predictor.timestep))
    controls = predictor.controls(ChunkRolloutInputs(whole, values, starting.start), last + 1)

    for step in range(last + 1):
        if step in rows:
            starting.place(data, rows[step], predictor.timestep)
        if not (np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()):
            break
        if step in states:
            states[step] = state.save(model, data)
        data.ctrl[:] = controls[step]
        mujoco.mj_step(model, data)
    return states


def _rows_by_step(segment: LogSegment, timestep: float) -> dict[int, Chunk]:
    """Returns a few rows from each row on, by the step before it."""
    steps = segment.steps(timestep)
    rows: dict[int, Chunk] = {}
    for row in range(len(steps)):
        first = math.floor(steps[row] + 1e-9)
        near = slice(row, row + WINDOW)
        rows.setdefault(first, Chunk(segment, near, first, steps[near] - first))
    return rows
