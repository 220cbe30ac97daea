"""Replays: a stepper along recorded states instead of physics."""

import copy
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import mujoco
import numpy as np

from mjrun.errors import UsageError
from mjrun.model import state
from mjrun.physics.recorded_states import RecordedStates, require_model, require_timestep
from mjrun.physics.stepper import derive, instant_of
from mjrun.timeline import rational

SLEEP = int(mujoco.mjtEnableBit.mjENBL_SLEEP)
FAR = 1000  # the most steps from a recorded state to the next that are repeated


class ReplayStepper:
    """A stepper along recorded states, with a copy of `model`.

    Every state is bit for bit the recorded one, and every instant that of the recorded simulation, if MuJoCo and the
    machine are the same. States do not include which bodies sleep: where bodies may sleep, every step is repeated from
    the recorded state to find out, and the next recorded state replaces the result. Where inputs changed between two
    recorded states, a body that slept may be awake.

    Args:
      facts: the facts of the recording, which may state the layout of its states.
      simulated: whether the states come from physics, in which bodies may sleep, or from a table.

    Raises:
      UsageError: the recording was made with another model, or of another timestep.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        states: RecordedStates,
        facts: Mapping[str, Any] = MappingProxyType({}),
        simulated: bool = True,
    ) -> None:
        require_model(model, states, facts)
        if simulated:
            require_timestep(model, states)
        self._source = "recording" if simulated else "table"
        self.model = copy.copy(model)
        self.step = 0
        self._states, self._steps = states, states.steps
        self._timestep = rational(model.opt.timestep)
        self._sleeps = simulated and bool(model.opt.enableflags & SLEEP)
        self._data = mujoco.MjData(self.model)
        self._instant = mujoco.MjData(self.model)
        self._instant_step = -1
        self._initial: mujoco.MjData | None = None
        self._put(0)

    def require(self, steps: Sequence[int]) -> None:
        """Checks that all of `steps` are recorded.

        Raises:
          UsageError: one is missing; the message names the first.
        """
        for step in steps:
            self._find(step)

    def advance(self, step: int) -> None:
        """Moves forward to `step`, which must not be before the current step.

        Raises:
          UsageError: the step is not recorded.
        """
        if step < self.step:
            raise ValueError(f"cannot go back from step {self.step} to step {step}")
        index = self._find(step)
        if self._sleeps:
            for following in range(self._index + 1, index + 1):
                self._follow(following)
        elif index != self._index:
            self._put(index)

    def state(self) -> np.ndarray:
        """Returns the recorded state at `self.step` as a new array `(nstate,)`."""
        return self._state.copy()

    def instant(self) -> mujoco.MjData:
        """Returns an MjData in which every field belongs to `self.step`; it must not be kept or changed.

        Raises:
          FailedStepError: MuJoCo raised an error.
        """
        if self._instant_step != self.step:
            derive(self.model, self._data, self._instant, self.step)
            self._instant_step = self.step
        return self._instant

    def initial(self) -> mujoco.MjData:
        """Returns an MjData in which every field belongs to step 0, at any current step; it must not be changed."""
        self._initial = self._initial or instant_of(self.model, self._states.state(0))
        return self._initial

    def _put(self, index: int) -> None:
        """Moves to a state. MuJoCo wakes bodies in it that move, or have moved since they fell asleep."""
        self._index, self.step = index, int(self._steps[index])
        self._state = self._states.state(index)
        state.restore(self.model, self._data, self._state)

    def _follow(self, index: int) -> None:
        """Moves to the next state through physics, so that bodies fall asleep and wake up as in the simulation."""
        count = int(self._steps[index]) - self.step
        try:
            mujoco.mj_step(self.model, self._data, nstep=min(count, FAR))
        except mujoco.FatalError:
            self._data = mujoco.MjData(self.model)  # the old one is in the middle of a step
        self._put(index)

    def _find(self, step: int) -> int:
        """Returns the index of the state at `step`."""
        steps = self._steps
        index = bisect_left(steps, step)
        if index == len(steps):
            last = int(steps[-1])
            raise UsageError(
                f"the {self._source} ends at {self._place(last)}, before {self._place(step)}\n"
                f"request step {last} or an earlier one"
            )
        if steps[index] != step:
            before = f"{self._place(int(steps[index - 1]))}, and "
            raise UsageError(
                f"{self._place(step)} is not in the {self._source}\n"
                f"the nearest recorded ones: {before if index else ''}{self._place(int(steps[index]))}"
            )
        return index

    def _place(self, step: int) -> str:
        return f"step {step}, time {float(step * self._timestep):.9g} s"
