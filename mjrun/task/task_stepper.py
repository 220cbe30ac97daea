"""A stepper through one episode of a task, to every physics step in it."""

import mujoco
import numpy as np

from mjrun.model import state
from mjrun.options.task import LAGGED
from mjrun.physics.push_forces import PushForces
from mjrun.physics.stepper import SLEEP, PhysicsStepper
from mjrun.task.episode import Actor, ControlInstant, Ending, EpisodeNames, ask
from mjrun.task.expressions import RUNNING
from mjrun.task.single_world import SingleWorld


class TaskStepper:
    """A stepper through an episode of a task with the random seed `seed`, in which `actor` chooses the actions.

    The episode is bit for bit that of `TaskWorlds.step`. The policy is called on arrival at a control instant, so that
    the controls of the next control period are known at that instant. Beyond the end of the episode the simulation
    continues without a reset.

    Args:
      world: the world that measures the observations and rewards.
      policy: its name, for messages.
      pushes: forces on bodies in addition to those of the task.

    Attributes:
      model: a copy of that of the episode.
      step: the current one.
      names: the names of observations, actions and terms of the reward.
      control_steps: physics steps in a control period.
      periods: completed control periods, up to the end of the episode.

    Raises:
      SimulationError: the policy failed.
    """

    def __init__(
        self, world: SingleWorld, actor: Actor, seed: int, policy: str = "", pushes: PushForces | None = None
    ) -> None:
        self._world, self._actor, self._policy, self._pushes = world, actor, policy, pushes
        self.control_steps, self.step = world.control_steps, 0
        self.names = EpisodeNames(world.observation_names, world.action_names, world.reward_names)
        self.periods = 0
        self._ending: Ending | None = None

        observation = world.start(seed)
        model = world.model(0)
        self._timestep, self._controls = model.opt.timestep, state.controls(model)
        action = self._ask(observation)
        self._now = ControlInstant(observation, action, 0.0, np.zeros(len(self.names.rewards)), 0.0)
        world.hold()
        self._data = mujoco.MjData(model)
        state.restore(model, self._data, world.state(0))
        self._unpushed = self._data.xfrc_applied.copy()
        # The results of a control period belong to the forces before its end: pushes are applied here, after them.
        if pushes:
            self._data.xfrc_applied[:] = self._unpushed + pushes.on_bodies(self._data, 0)
        self._physics = PhysicsStepper(model, self._data)
        self.model = self._physics.model
        self._is_lagged = world.task.derived == LAGGED
        # A state does not include bodies that sleep, nor what contacts of flexes carry from step to step.
        self._is_parallel = bool(model.opt.enableflags & SLEEP) or model.nflex > 0
        if self._is_parallel:
            world.put(self.state())

    def advance(self, step: int) -> None:
        """Moves forward to `step`.

        Raises:
          SimulationError: the simulation became unstable, or the policy failed.
        """
        if step < self.step:
            raise ValueError(f"cannot go back from step {self.step} to step {step}")
        while self.step < step:
            until = min(step, self.step - self.step % self.control_steps + self.control_steps)
            if self._world.holds_targets:
                until = self.step + 1
            if self._pushes:
                until = min(until, self._pushes.next_change(self.step))
            self._take(until)

    def edit(self, values: np.ndarray, spec: int) -> None:
        """Changes parts of the state at this step; the policy sets the controls again at the next control instant.

        Args:
          values: the parts `(size,)` that `spec` names by `mjtState` bits.
        """
        self._physics.edit(values, spec)
        if self._is_parallel:
            self._world.put(self.state())
        if self._world.holds_targets:
            self._hold()

    def now(self) -> ControlInstant:
        return self._now

    def state(self) -> np.ndarray:
        return self._physics.state()

    def instant(self) -> mujoco.MjData:
        return self._physics.instant()

    def initial(self) -> mujoco.MjData:
        return self._physics.initial()

    def _take(self, until: int) -> None:
        """Takes steps under constant inputs, and asks the policy at the end of a control period."""
        is_last = until % self.control_steps == 0
        if self._is_parallel:
            self._world.advance(until - self.step)
        elif is_last and self._is_lagged:  # it reads what its last step computes
            self._move(until - 1)
            self._world.put(self.state())
            self._world.advance(1)
        self._move(until)
        if is_last:
            self._finish_period()
        elif self._world.holds_targets:
            self._hold()
        if self._pushes:
            state.restore(self.model, self._data, self.state())
            forces = self._unpushed + self._pushes.on_bodies(self._data, self.step)
            self.edit(forces.ravel(), state.APPLIED_FORCES)

    def _move(self, until: int) -> None:
        try:
            self._physics.advance(until)
        finally:
            self.step = self._physics.step

    def _finish_period(self) -> None:
        """Computes the control instant at the end of a period; after the end of the episode the return stays."""
        world = self._world
        if not (self._is_parallel or self._is_lagged):
            world.put(self.state())
        result = world.conclude()
        reward, total, observation = result.rewards, self._now.total, result.observations
        if self._ending is None:
            self.periods, total = self.periods + 1, total + reward
            if result.codes != RUNNING:
                self._ending = result.endings[result.codes]
        world.resume()
        action = self._ask(observation)
        self._now = ControlInstant(observation, action, reward, np.array(result.reward_terms), total, self._ending)
        world.hold()
        self._set_controls()

    def _ask(self, observation: np.ndarray) -> np.ndarray:
        """Calls the policy, and applies its action to the world."""
        time = self.step * self._timestep
        action = ask(self._actor, observation, self.names.actions, self.step, time, self._policy)
        self._world.apply(action)
        return action

    def _hold(self) -> None:
        """Sets the controls that hold targets at this step."""
        if not self._is_parallel:
            self._world.put(self.state())
        self._world.hold()
        self._set_controls()

    def _set_controls(self) -> None:
        self._physics.edit(self._world.state(0)[self._controls], state.CTRL)
