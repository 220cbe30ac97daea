"""States computed from samples of positions in time: motion capture, logs, tables of any simulator.

Between samples, positions follow a straight line, and quaternions the shortest arc at constant angular velocity; or
all of them hold. At the time of a sample, the state is that sample.
"""

import mujoco
import numpy as np

from mjrun.model import state
from mjrun.physics.kinematic_samples import CompleteSamples, Interpolation, KinematicSamples, slerp
from mjrun.physics.timed_rows import SLACK
from mjrun.timeline import rational


class KinematicMotion:
    """The states of `model` at every step from the first sample, which is step 0.

    Each state is computed on request: memory holds the samples alone, whatever the number of steps.

    Args:
      start: provides the values that the samples lack.

    Attributes:
      steps: all steps.
      size: the length of a state.
      has_controls: whether the samples include controls.
      remarks: warnings for the user.
      position_remarks: those about positions.

    Raises:
      UsageError: as `CompleteSamples`.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        start: mujoco.MjData,
        samples: KinematicSamples,
        interpolation: Interpolation | None = None,
    ) -> None:
        self._interpolation = interpolation or Interpolation()
        complete = CompleteSamples(model, start, samples, self._interpolation)
        self._model, self._start = model, state.save(model, start)
        self._places = state.fields(state.sizes(model))
        self._time, self._fields = complete.time, complete.fields
        self._timestep = rational(model.opt.timestep)
        self._slack = SLACK * model.opt.timestep
        self.steps = range(int((self._time[-1] + self._slack) / model.opt.timestep) + 1)
        self.size = state.size(model)
        self.has_controls = "ctrl" in complete.fields
        self.position_remarks = complete.position_remarks
        self.remarks = [*complete.position_remarks, *complete.other_remarks]

    def state(self, index: int) -> np.ndarray:
        """Returns the integration state at step `index` as a new array `(size,)`.

        Raises:
          IndexError: the step does not exist.
        """
        return self.state_at(float(self.steps[index] * self._timestep))

    def state_at(self, time: float) -> np.ndarray:
        """Returns the integration state `time` [s] after the first sample, held before the first and after the last."""
        row, share = self._place(time)
        moving = 0.0 if self._interpolation.hold else share
        fields = self._fields
        values = {"time": np.array([time]), "qpos": self._positions(row, moving)}
        for name in ("qvel", "act", "mocap_pos"):
            if name in fields:
                values[name] = _between(fields[name], row, moving)
        if "ctrl" in fields:
            values["ctrl"] = _between(fields["ctrl"], row, 0.0 if self._interpolation.hold_controls else share)
        if "mocap_quat" in fields:
            values["mocap_quat"] = self._mocap_rotations(row, moving).ravel()
        made = self._start.copy()
        for name, numbers in values.items():
            made[self._places.get(name, slice(0))] = numbers  # a field without numbers has no place
        return made

    def _place(self, time: float) -> tuple[int, float]:
        """Returns the last row at or before `time`, and the fraction of the way to the next."""
        row = max(0, int(np.searchsorted(self._time, float(time + self._slack), side="right")) - 1)
        since = time - self._time[row]
        if since <= self._slack or row == len(self._time) - 1:
            return row, 0.0
        return row, float(since / (self._time[row + 1] - self._time[row]))

    def _positions(self, row: int, share: float) -> np.ndarray:
        positions = self._fields["qpos"]
        if not share:
            return positions[row]
        way, between = np.empty(self._model.nv), positions[row].copy()
        mujoco.mj_differentiatePos(self._model, way, 1.0, positions[row], positions[row + 1])
        mujoco.mj_integratePos(self._model, between, way, share)
        return between

    def _mocap_rotations(self, row: int, share: float) -> np.ndarray:
        rotations = self._fields["mocap_quat"].reshape(len(self._time), -1, 4)
        if not share:
            return rotations[row]
        pairs = zip(rotations[row], rotations[row + 1], strict=True)
        return np.array([slerp(first, last, share) for first, last in pairs])


def _between(values: np.ndarray, row: int, share: float) -> np.ndarray:
    """Returns the numbers at the fraction `share` of the straight way from a row of `values` to the next."""
    return values[row] + share * (values[row + 1] - values[row]) if share else values[row]
