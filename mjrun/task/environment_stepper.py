"""Steps through an episode of an environment of Gymnasium's, and to every physics step in between."""

import mujoco
import numpy as np

from mjrun.errors import InvalidActionError, UsageError, clean
from mjrun.model import state
from mjrun.physics.stepper import PhysicsStepper
from mjrun.task.episode import Actor, ControlInstant, EpisodeOver
from mjrun.task.gymnasium import Environment, EnvironmentStep


class EnvironmentStepper:
    """The episode of `environment` that starts with `seed`; `actor` acts.

    States at control instants are those of the environment. In between they are simulated again from the state before
    its step, with the controls and other inputs that it applied, and are compared with its own at the end.

    The action of a control instant is asked for, and the environment steps, on arriving there, so that the controls
    which act from there on are known at that instant.

    Args:
      policy: its name, for messages.

    Attributes:
      model: a copy of the environment's.
      step: where it stands.
      names: of observations, actions and terms of the reward.
      control_steps: physics steps in a control period.
      periods: control periods that were completed, up to the end of the episode.

    Raises:
      UsageError: actions of the wrong size.
      SimulationError: an action is no number, or the simulation fails.
    """

    def __init__(self, environment: Environment, actor: Actor, seed: int, policy: str = "") -> None:
        self._policy = policy
        self.environment, self.control_steps = environment, environment.control_steps
        self._actor, self._begin = actor, 0  # the step of the last control instant
        self._timestep = environment.model.opt.timestep
        observation = environment.reset(seed)
        self._state = environment.state()
        self._next, action = self._ask(observation)
        self.names = environment.names(self._next)
        self._now = ControlInstant(observation, action, 0.0, np.zeros(len(self.names.rewards)), 0.0)

        start = mujoco.MjData(environment.model)
        state.restore(environment.model, start, self._driven())
        self._physics = PhysicsStepper(environment.model, start)
        self.model, self.step = self._physics.model, 0

    @property
    def periods(self) -> int:
        return self._begin // self.control_steps

    def advance(self, step: int) -> None:
        """Moves forward to `step`.

        Raises:
          EpisodeOver: the episode ends before it; the stepper stands at its end.
          SimulationError: the simulation, or the policy, failed.
          UsageError: the environment does more during a step than mjrun sees, and `step` is not at a control instant.
        """
        if step < self.step:
            raise ValueError(f"cannot go back from step {self.step} to step {step}")
        try:
            while self._now.ending is None and step >= self._begin + self.control_steps:
                self._finish_period()
            if self._now.ending is not None and step > self._begin:
                raise EpisodeOver(self._begin, self._now.ending)
            self._physics.advance(step)
        finally:
            self.step = self._physics.step  # after a failure, the last good one

    def now(self) -> ControlInstant:
        return self._now

    def state(self) -> np.ndarray:
        return self._physics.state()

    def instant(self) -> mujoco.MjData:
        return self._physics.instant()

    def initial(self) -> mujoco.MjData:
        return self._physics.initial()

    def _finish_period(self) -> None:
        """Goes to the next control instant, which the environment has reached already, and asks for its action."""
        result, end = self._next, self._begin + self.control_steps
        after = self.environment.state()
        if self.environment.is_unstable or self._physics.step > self._begin:
            self._compare(end, after)
        terms = np.array([result.reward_terms.get(name, np.nan) for name in self.names.rewards])
        total = self._now.total + result.reward
        self._begin, self._state = end, after

        action = self._now.action
        if result.ending is None:
            self._next, action = self._ask(result.observation)
        self._now = ControlInstant(result.observation, action, result.reward, terms, total, result.ending)
        self._physics.jump(end, after if result.ending else self._driven())

    def _ask(self, observation: np.ndarray) -> tuple[EnvironmentStep, np.ndarray]:
        """The action of the policy on `observation`, and what the environment makes of it."""
        action = np.asarray(self._actor.act(observation), float).ravel()
        if not np.isfinite(action).all():
            wrong = {n: v for n, v in zip(self.environment.action_names, action, strict=False) if not np.isfinite(v)}
            raise InvalidActionError(self._begin, self._begin * self._timestep, self._policy, wrong)
        return self.environment.step(action), action

    def _driven(self) -> np.ndarray:
        """The state of the last control instant with the inputs that the environment applied from there on."""
        driven, inputs = self._state.copy(), state.part(self.environment.model, state.INPUTS)
        driven[inputs] = self.environment.state()[inputs]
        return driven

    def _compare(self, end: int, after: np.ndarray) -> None:
        """Simulates the rest of the period, and raises unless that leads to `after`, as it did in the environment."""
        self._physics.advance(end)
        alike = np.delete(np.arange(after.size), state.part(self.model, state.INPUTS))
        if self.environment.is_unstable or not np.array_equal(self._physics.state()[alike], after[alike]):
            time = self._begin * self._timestep
            raise UsageError(
                f"{clean(self.environment.text)} does more in its step at {time:.9g} s than to step the physics, so "
                "that what happens between control instants is not known\n"
                f"look only every {self.control_steps} steps, {self.environment.control_steps * self._timestep:g} s"
            )
