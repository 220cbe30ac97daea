"""First guesses of the states in which chunks begin, from what was measured there."""

from collections.abc import Sequence

import mujoco
import numpy as np

from mjrun.fit.prediction import Chunk
from mjrun.model import state
from mjrun.probe.fields import field_probe

WINDOW = 9  # rows to which a parabola is fitted


class StartingStates:
    """Guesses states from measured columns of `qpos` and `qvel`; what is not measured is as at the start.

    Args:
      start: an integration state, `(nstate,)`.
    """

    def __init__(self, model: mujoco.MjModel, signals: Sequence[str], start: np.ndarray) -> None:
        self._model, self._start = model, start
        self._qpos = _places(model, "qpos", signals)
        self._qvel = _places(model, "qvel", signals)
        self._rates = self._rates_of_positions()

    def guess(self, chunk: Chunk, timestep: float) -> np.ndarray:
        """The integration state `(nstate,)` at the first step of `chunk`."""
        data = mujoco.MjData(self._model)
        state.restore(self._model, data, self._start)
        rows, seconds = chunk.values[:WINDOW], chunk.positions[:WINDOW] * timestep
        for index, signal in self._qpos.items():
            data.qpos[index] = _at_start(seconds, rows[:, signal], data.qpos[index])[0]
        mujoco.mj_normalizeQuat(self._model, data.qpos)
        for index, signal in self._rates.items():
            data.qvel[index] = _at_start(seconds, rows[:, signal], 0.0)[1]
        for index, signal in self._qvel.items():
            data.qvel[index] = _at_start(seconds, rows[:, signal], data.qvel[index])[0]
        return state.save(self._model, data)

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


def _places(model: mujoco.MjModel, field: str, signals: Sequence[str]) -> dict[int, int]:
    """Which number of a field each signal measures: signals by number."""
    names = [column.name for column in field_probe(model, field).columns]
    return {i: signals.index(name) for i, name in enumerate(names) if name in signals}


def _at_start(seconds: np.ndarray, values: np.ndarray, otherwise: float) -> tuple[float, float]:
    """Value and rate at 0 s of a parabola through the first samples; `otherwise` and 0 without any."""
    known = np.isfinite(values)
    count = int(known.sum())
    if not count:
        return otherwise, 0.0
    factors = np.polynomial.polynomial.polyfit(seconds[known], values[known], min(2, count - 1))
    return float(factors[0]), float(factors[1]) if len(factors) > 1 else 0.0
