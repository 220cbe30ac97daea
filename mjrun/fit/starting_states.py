"""First guesses of the states in which chunks begin, from what was measured there."""

from collections.abc import Sequence

import mujoco
import numpy as np

from mjrun.fit.prediction import Chunk
from mjrun.model import state
from mjrun.probe.fields import field_probe

JOINTPOS, JOINTVEL = int(mujoco.mjtSensor.mjSENS_JOINTPOS), int(mujoco.mjtSensor.mjSENS_JOINTVEL)
WINDOW = 9  # rows to which a parabola is fitted
LONGER = (72, 36, 18)  # rows that take its place, the most that a parabola fits
FITTING = 1.35  # residuals of such a parabola, in standard deviations of the noise, at most


class StartingStates:
    """Guesses states from measured columns of `qpos` and `qvel`; what is not measured is as at the start.

    Args:
      start: an integration state, `(nstate,)`.
      noise: standard deviation of each signal, `(signals,)`; 0 where it is not known.

    Attributes:
      start: the same.
      all_measured: whether measurements tell all positions and velocities, and there are no activations.
    """

    def __init__(
        self, model: mujoco.MjModel, signals: Sequence[str], start: np.ndarray, noise: np.ndarray | None = None
    ) -> None:
        self._model, self.start = model, start
        self._noise = np.zeros(len(signals)) if noise is None else noise
        self._qpos = measured_positions(model, signals)
        self._qvel = _places(model, "qvel", signals, JOINTVEL)
        self._rates = self._rates_of_positions()
        self._turning = self._measured_rotations()
        velocities = {*self._rates, *self._qvel, *(first + k for first in self._turning.values() for k in range(3))}
        self.all_measured = len(self._qpos) == model.nq and len(velocities) == model.nv and not model.na

    def guess(self, chunk: Chunk, timestep: float, start: np.ndarray | None = None) -> np.ndarray:
        """The integration state `(nstate,)` at the first step of `chunk`.

        Args:
          start: the state that says what is not measured, if another than that of the start.
        """
        data = mujoco.MjData(self._model)
        state.restore(self._model, data, self.start if start is None else start)
        self.place(data, chunk, timestep)
        return state.save(self._model, data)

    def place(self, data: mujoco.MjData, chunk: Chunk, timestep: float) -> None:
        """Puts `data` where `chunk` begins, as far as that is measured."""
        rows, seconds, noise = chunk.values[: LONGER[0]], chunk.positions[: LONGER[0]] * timestep, self._noise
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
        """Velocities that are the rates of measured positions: of all joints but for rotations of three axes."""
        model, rates = self._model, dict[int, int]()
        for joint in range(model.njnt):
            first, speed = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
            count = {int(mujoco.mjtJoint.mjJNT_FREE): 3, int(mujoco.mjtJoint.mjJNT_BALL): 0}.get(
                int(model.jnt_type[joint]), 1
            )
            rates |= {speed + k: self._qpos[first + k] for k in range(count) if first + k in self._qpos}
        return rates

    def _measured_rotations(self) -> dict[int, int]:
        """Where the quaternions of measured rotations are in `qpos`, and their angular velocities in `qvel`."""
        model, speeds = self._model, dict[int, int]()
        for joint in range(model.njnt):
            first, speed = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
            offset = {int(mujoco.mjtJoint.mjJNT_FREE): 3, int(mujoco.mjtJoint.mjJNT_BALL): 0}.get(
                int(model.jnt_type[joint])
            )
            if offset is not None and first + offset in self._qpos:
                speeds[first + offset] = speed + offset
        return speeds


def _rotation_at_start(seconds: np.ndarray, quaternions: np.ndarray, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """Quaternion and angular velocity in its frame at 0 s, by parabolas of the rotation since the first sample."""
    known = np.isfinite(quaternions).all(axis=1)
    first = quaternions[known][0].copy()
    turns = np.empty((int(known.sum()), 3))
    for turn, quaternion in zip(turns, quaternions[known], strict=True):
        mujoco.mju_subQuat(turn, quaternion, first)
    at_start = [_at_start(seconds[known], angles, 0.0, noise) for angles in turns.T]
    mujoco.mju_quatIntegrate(first, np.array([angle for angle, _ in at_start]), 1.0)
    return first, np.array([rate for _, rate in at_start])


def measured_positions(model: mujoco.MjModel, signals: Sequence[str]) -> dict[int, int]:
    """Which number of `qpos` each signal measures, by itself or as the sensor of a joint: signals by number."""
    return _places(model, "qpos", signals, JOINTPOS)


def _places(model: mujoco.MjModel, field: str, signals: Sequence[str], sensor: int) -> dict[int, int]:
    """Which number of a field each signal measures: signals by number.

    Args:
      sensor: the type of sensors of a joint that measure it too.
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
    """Value and rate at 0 s of a parabola through the first samples; `otherwise` and 0 without any.

    It goes through as many samples as one explains to the noise: the more there are, the less their noise counts.
    """
    for window in LONGER:
        known = np.isfinite(values[:window])
        if noise and len(values) >= window and known.sum() > window / 2:
            factors, left, *_ = np.polynomial.polynomial.polyfit(
                seconds[:window][known], values[:window][known], 2, full=True
            )
            if float(np.sum(left[0])) < (FITTING * noise) ** 2 * (int(known.sum()) - 3):
                return float(factors[0]), float(factors[1])
    known = np.isfinite(values[:WINDOW])
    count = int(known.sum())
    if not count:
        return otherwise, 0.0
    factors = np.polynomial.polynomial.polyfit(seconds[:WINDOW][known], values[:WINDOW][known], min(2, count - 1))
    return float(factors[0]), float(factors[1]) if len(factors) > 1 else 0.0
