"""A stepper through one episode of a task, to every physics step in it."""

from collections.abc import Callable, Iterator
from functools import partial
from itertools import count
from typing import Any

import mujoco
import numpy as np

from mjrun.model import state
from mjrun.options.task import LAGGED
from mjrun.physics.control import ControlSources
from mjrun.physics.stepper import SLEEP, STATE, PhysicsStepper
from mjrun.task.batch_columns import ACCELERATION, NONE
from mjrun.task.episode import Actor, ControlInstant, Ending, EpisodeColumnNames, ask
from mjrun.task.expressions import RUNNING
from mjrun.task.single_world import SingleWorld
from mjrun.timeline import rational


class TaskStepper(PhysicsStepper):
    """A stepper through an episode of a task with the random seed `seed`, in which `actor` chooses the actions.

    The episode is bit for bit that of `TaskWorlds.step`. The policy is called on arrival at a control instant, so that
    the controls of the next control period are known at that instant. Beyond the end of the episode the simulation
    continues without a reset.

    Args:
      world: the world that measures the observations and rewards.
      policy: its name, for messages.

    Attributes:
      model: a copy of that of the episode.
      step: the current one.
      names: the names of observations, actions and terms of the reward.
      control_steps: physics steps in a control period.
      periods: completed control periods, up to the end of the episode.

    Raises:
      SimulationError: the policy failed.
    """

    def __init__(self, world: SingleWorld, actor: Actor, seed: int, policy: str = "") -> None:
        self._world, self._actor, self._policy = world, actor, policy
        self.control_steps, self.step = world.control_steps, 0
        self.names = EpisodeColumnNames(world.observation_names, world.action_names, world.reward_names)
        self.periods = 0
        self._ending: Ending | None = None

        observation = world.start(seed)
        model = world.model(0)
        self._timestep = model.opt.timestep
        action = self._ask(observation, 0)
        self._instant = (observation, action, 0.0, [0.0] * len(self.names.rewards), 0.0)
        self._now: ControlInstant | None = None  # made on demand
        # What the last step of a period computes is measured in the world, which takes that step in addition. A state
        # does not include bodies that sleep, nor what contacts of flexes carry from step to step: it then takes all.
        self._is_lagged = world.task.derived == LAGGED
        self._is_parallel = self._is_lagged and (bool(model.opt.enableflags & SLEEP) or model.nflex > 0)
        self._world_step = 0
        data = mujoco.MjData(model)
        state.restore(model, data, world.state(0))
        world.hold(data.qpos, data.qvel)
        data.ctrl[:] = world.controls
        noise, pushes = world.disturbances.noise(0), world.disturbances.pushes(0)
        control = ControlSources(rational(model.opt.timestep), world.controls, noise=noise)
        super().__init__(model, data, control, pushes)

    def steps_alike(self) -> int:
        if self._world.holds_targets or (self._is_parallel and self.control.noise):
            return 1
        left = self.control_steps - self.step % self.control_steps
        return min(super().steps_alike(), left - 1 if self._is_lagged and left > 1 else left)

    @property
    def _calls_within(self) -> bool:
        """True if the policy is the only source of inputs, and its observations need only positions and velocities."""
        return not (self._sources or self.control.varies or self._is_lagged) and self._is_measured_in_place

    @property
    def _is_measured_in_place(self) -> bool:
        return self._integrate is not None and self._world.stage < ACCELERATION

    def edit(self, values: np.ndarray, spec: int) -> None:
        """Changes parts of the state at this step; the policy sets the controls again at the next control instant.

        Args:
          values: the parts `(size,)` that `spec` names by `mjtState` bits.
        """
        super().edit(values, spec)
        if self._world.holds_targets:
            self._world.hold(self._data.qpos, self._data.qvel)
            self._data.ctrl[:] = self.control.rows(self.step, 1)[0]
        self._lead()

    def now(self) -> ControlInstant:
        if self._now is None:
            observation, action, reward, terms, total = self._instant
            self._now = ControlInstant(observation, action, reward, np.array(terms), total, self._ending)
        return self._now

    def _apply_inputs(self) -> None:
        """Applies the inputs of this step; measurements at the end of a period belong to the forces before it."""
        if self._is_parallel and self.step:
            self._world.advance(self.step - self._world_step)
            self._world_step = self.step
        if self.step and self.step % self._call_steps == 0 and not self._repeats():
            self._act(self.step)
        super()._apply_inputs()
        self._lead()

    @property
    def _call_steps(self) -> int:
        """The number of steps from a change of the controls to the next."""
        return 1 if self._world.holds_targets else self.control_steps

    def _calls_after(self, step: int) -> Iterator[int]:
        period = self._call_steps
        return count(step - step % period + period, period)

    def _caller(self) -> Callable[[int], bool | None]:
        return partial(self._act, is_computed=True)

    def _copier(self) -> Callable[[], Any]:
        controls = self._world.controls
        return lambda: (controls.copy(), self._instant, self.periods, self._ending)

    def _put_back(self, copied: Any) -> None:
        controls, self._instant, self.periods, self._ending = copied
        self._world.controls[:] = self._data.ctrl[:] = controls
        self._now = None

    def _act(self, step: int, is_computed: bool = False) -> None:
        """Sets the controls of a step: those of a new action, or those that hold the targets of the last one.

        Args:
          is_computed: whether positions and velocities are computed in the data of the step.
        """
        if step % self.control_steps == 0:
            self._finish_period(step, is_computed)
        if self._world.holds_targets:
            self._world.hold(self._data.qpos, self._data.qvel)
        self._data.ctrl[:] = self._world.controls

    def _lead(self) -> None:
        """Prepares the world for the next step, once all inputs of this one are known."""
        if self._is_parallel:
            self._put()
        elif self._is_lagged and (self.step + 1) % self.control_steps == 0:
            self._put()
            self._world.advance(1)

    def _put(self) -> None:
        mujoco.mj_getState(self.model, self._data, self._world.whole_state, state.STATE)

    def _finish_period(self, step: int, is_computed: bool) -> None:
        """Computes the control instant at the end of a period; after the end of the episode the return stays."""
        world = self._world
        if self._is_lagged:
            result = world.conclude()
        else:
            result = world.conclude_in(self.model, self._data if is_computed else self._measured())
        reward, total = result.rewards, self._instant[-1]
        if self._ending is None:
            self.periods, total = self.periods + 1, total + reward
            if result.codes != RUNNING:
                self._ending = result.endings[result.codes]
        world.resume()
        action = self._ask(result.observations, step)
        self._instant, self._now = (result.observations, action, reward, result.reward_terms, total), None

    def _measured(self) -> mujoco.MjData:
        """Returns an MjData in which all fields that the world measures belong to this step."""
        if self._world.stage == NONE:
            return self._data
        if self._is_measured_in_place:
            self._derive_motion()
            return self._data
        instant = self._copied_instant()
        self._computed = STATE  # as the controls change
        return instant

    def _ask(self, observation: np.ndarray, step: int) -> np.ndarray:
        """Calls the policy, and applies its action to the world."""
        action = ask(self._actor, observation, self.names.actions, step, step * self._timestep, self._policy)
        self._world.apply(action)
        return action
