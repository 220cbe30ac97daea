"""The inputs of recorded states, to run the physics under them once more."""

from bisect import bisect_right
from fractions import Fraction

import mujoco
import numpy as np

from mjrun.model import state
from mjrun.physics.replay import RecordedStates

AHEAD = 50  # steps that are looked through for a change of inputs


class RecordedInputs:
    """All that acted on a simulation: controls, applied forces, mocap poses. The last ones hold to the end."""

    def __init__(self, model: mujoco.MjModel, states: RecordedStates) -> None:
        self._states, self._nu = states, model.nu
        start = state.controls(model).start
        self._part = slice(start, start + state.size(model, state.INPUTS))  # controls come first
        self._recent: dict[int, np.ndarray] = {}

    def apply(self, ctrl: np.ndarray, first: int, timestep: Fraction) -> None:
        """Puts the controls of the steps from `first` on into `ctrl` `(n, nu)`."""
        for index in range(len(ctrl)):
            ctrl[index] = self.at(first + index)[: self._nu]

    def at(self, step: int) -> np.ndarray:
        """The inputs at `step`, as `state.INPUTS` has them."""
        if step not in self._recent:
            if len(self._recent) > 2 * AHEAD:
                self._recent.clear()
            index = bisect_right(self._states.steps, step) - 1
            self._recent[step] = self._states.state(index)[self._part]
        return self._recent[step]

    def next_change(self, step: int) -> int:
        """A step after `step` up to which all inputs but the controls stay as they are."""
        others = self.at(step)[self._nu :]
        for following in range(step + 1, step + AHEAD):
            if not np.array_equal(self.at(following)[self._nu :], others):
                return following
        return step + AHEAD
