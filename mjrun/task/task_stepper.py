"""A stepper through one episode of a task, to every physics step in it."""

import copy

import mujoco
import numpy as np

from mjrun.errors import FailedStepError, SimulationError, UnstableError
from mjrun.model import state
from mjrun.physics.push_forces import PushForces
from mjrun.physics.stepper import PhysicsStepper, instant_of
from mjrun.task.episode import Actor, ControlInstant, Ending, EpisodeNames, ask
from mjrun.task.worlds import TaskWorlds


class TaskStepper:
    """A stepper through an episode of a task with the random seed `seed`, in which `actor` chooses the actions.

    The episode is bit for bit that of `TaskWorlds.step`. The policy is called on arrival at a control instant, so that
    the controls of the next control period are known at that instant. Beyond the end of the episode the simulation
    continues without a reset.

    Args:
      worlds: with a single world.
      policy: its name, for messages.
      pushes: forces on bodies in addition to those of the task.

    Attributes:
      model: a copy of that of the episode.
      step: the current one.
      names: of observations, actions and terms of the reward.
      control_steps: physics steps in a control period.
      periods: completed control periods, up to the end of the episode.

    Raises:
      SimulationError: the policy failed.
    """

    def __init__(
        self, worlds: TaskWorlds, actor: Actor, seed: int, policy: str = "", pushes: PushForces | None = None
    ) -> None:
        self._worlds, self._actor, self._policy, self._pushes = worlds, actor, policy, pushes
        self.control_steps, self.step = worlds.control_steps, 0
        self.names = EpisodeNames(worlds.observation_names, worlds.action_names, worlds.reward_names)
        self.periods = 0
        self._ending: Ending | None = None

        observation = worlds.reset([seed])[0]
        self.model = copy.copy(worlds.model(0))
        self._timestep = self.model.opt.timestep
        self._data, self._instant_step = mujoco.MjData(self.model), -1
        self._applied = state.fields(state.sizes(self.model))["xfrc_applied"]
        self._unpushed = worlds.state(0)[self._applied].reshape(-1, 6)
        self._now = ControlInstant(observation, self._ask(observation), 0.0, np.zeros(len(self.names.rewards)), 0.0)
        self._arrive()
        self._start = self.state()
        self._initial: mujoco.MjData | None = None

    def advance(self, step: int) -> None:
        """Moves forward to `step`.

        Raises:
          SimulationError: the simulation became unstable, or the policy failed.
        """
        if step < self.step:
            raise ValueError(f"cannot go back from step {self.step} to step {step}")
        while self.step < step:
            until = min(step, self.step - self.step % self.control_steps + self.control_steps)
            if self._pushes:
                until = min(until, self._pushes.next_change(self.step))
            self._take(until - self.step)

    def edit(self, values: np.ndarray, spec: int) -> None:
        """Changes parts of the state at this step; the policy sets the controls again at the next control instant.

        Args:
          values: the parts `(size,)` that `spec` names by `mjtState` bits.
        """
        state.restore(self.model, self._data, self.state())
        state.restore(self.model, self._data, values, spec)
        self._worlds.put(0, state.save(self.model, self._data))
        self._instant_step = -1

    def now(self) -> ControlInstant:
        return self._now

    def state(self) -> np.ndarray:
        return self._worlds.state(0)

    def instant(self) -> mujoco.MjData:
        if self._instant_step != self.step:
            state.restore(self.model, self._data, self.state())
            try:
                mujoco.mj_forward(self.model, self._data)
            except mujoco.FatalError as error:
                raise FailedStepError(self.step, self._data.time, str(error)) from None
            self._instant_step = self.step
        return self._data

    def initial(self) -> mujoco.MjData:
        self._initial = self._initial or instant_of(self.model, self._start)
        return self._initial

    def _take(self, count: int) -> None:
        """Takes steps within a control period, and asks the policy at its end."""
        before = self.state()
        self._worlds.advance(count)
        if self._worlds.is_unstable(0):
            raise self._failure(before, count)
        self.step += count
        if self.step % self.control_steps == 0:
            self._finish_period()
        self._arrive()

    def _finish_period(self) -> None:
        """Computes the control instant at the end of a period; after the end of the episode the return stays."""
        result = self._worlds.finish()
        reward, total = float(result.rewards[0]), self._now.total
        if self._ending is None:
            self._ending, self.periods, total = result.ended[0], self.periods + 1, total + reward
        self._worlds.resume()
        observation = result.observations[0]
        action = self._ask(observation)
        self._now = ControlInstant(observation, action, reward, result.reward_terms[0], total, self._ending)

    def _ask(self, observation: np.ndarray) -> np.ndarray:
        """Calls the policy, and applies its action."""
        time = self.step * self._timestep
        action = ask(self._actor, observation, self.names.actions, self.step, time, self._policy)
        self._worlds.begin(action[None])
        return action

    def _arrive(self) -> None:
        """Applies the inputs of this step."""
        self._worlds.hold()
        self._instant_step = -1
        if self._pushes:
            state.restore(self.model, self._data, self.state())
            forces = self._unpushed + self._pushes.on_bodies(self._data, self.step)
            self.edit(forces.ravel(), state.APPLIED_FORCES)

    def _failure(self, before: np.ndarray, count: int) -> SimulationError:
        """Returns the error that occurred within `count` steps from the state `before`."""
        data = mujoco.MjData(self.model)
        state.restore(self.model, data, before)
        physics = PhysicsStepper(self.model, data)
        physics.jump(self.step, before)
        try:
            physics.advance(self.step + count)
        except SimulationError as error:
            return error
        # It occurred under controls that follow the state at every step.
        return UnstableError(self.step, self.step * self._timestep, "the position", "a joint", self._timestep)
