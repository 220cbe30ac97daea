"""Gymnasium's environments on MuJoCo as tasks: they reset, step and reward themselves."""

import copy
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from functools import partial
from typing import Any

import mujoco
import numpy as np

from mjrun.errors import ControllerError, FailedStepError, MjrunError, UsageError, clean, option
from mjrun.model import state
from mjrun.model.names import control_names
from mjrun.model.sources.gym import GymSource, control_steps, make_environment, mujoco_environment
from mjrun.physics.stepper import BAD, PhysicsStepper
from mjrun.probe.fields import extents, field_probe
from mjrun.task.episode import Actor, ControlInstant, Ending, EpisodeNames, EpisodeOver, ask
from mjrun.task.terms import TIMED_OUT
from mjrun.timeline import rational

REWARD = "reward_"  # how the terms of the reward begin in what an environment tells of a step
TERMINATED = "terminated"  # what an environment ends by itself
SUCCESS = ("is_success", "success")  # what environments of others call it
NO_AUTORESET = int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)


@dataclass(frozen=True)
class EnvironmentStep:
    """What an environment made of an action.

    Attributes:
      observation: `(nobs,)` float64, flattened as Gymnasium does.
      reward: of this step.
      reward_terms: what the environment tells of it, by name without `reward_`; they need not sum up to it.
      ending: how the episode ended here, if it did.
    """

    observation: np.ndarray
    reward: float
    reward_terms: Mapping[str, float]
    ending: Ending | None


class Environment:
    """An environment of Gymnasium's, or of anyone's that registers it there, whose simulation is MuJoCo's.

    Automatic resets of unstable simulations are off.

    Args:
      source: with overrides, its model takes the place of the environment's own; the control period stays.

    Attributes:
      model, data: those that the environment steps.
      control_steps: physics steps per action.
      control_dt: the control period [s].
      action_low, action_high: `(nact,)`, the bounds of an action; infinite where there are none.
      observation_size: numbers in an observation.
      observation_names, action_names: of each number.
      observation_units: of each number, SI; empty where nothing is known of it.

    Raises:
      ModelNotFoundError, BrokenModelError, MissingExtraError: there is no such environment, or it cannot be made.
      UsageError: its actions are no vectors of numbers, or the overridden model does not fit it.
    """

    def __init__(self, source: GymSource) -> None:
        self.text = source.text
        self._environment = make_environment(source.name)
        from gymnasium import spaces

        self._mujoco = mujoco_environment(self._environment, source.name)
        action, observation = self._environment.action_space, self._environment.observation_space
        if not isinstance(action, spaces.Box):
            raise UsageError(f"{clean(self.text)} takes actions of the kind {action}; policies give vectors of numbers")
        if not observation.is_np_flattenable:
            raise UsageError(f"{clean(self.text)} gives observations of the kind {observation}, which are no vector")
        self._flatten = _one_vector if isinstance(observation, spaces.Box) else partial(spaces.flatten, observation)
        self._action_shape, self._action_type = action.shape, action.dtype

        self.control_steps = control_steps(self._mujoco)
        self.control_dt = self.control_steps * rational(self._mujoco.model.opt.timestep)
        if source.overrides:
            self._replace_model(source)
        self.model, self.data = self._mujoco.model, self._mujoco.data
        self._own_flags = self.model.opt.disableflags
        self.model.opt.disableflags |= NO_AUTORESET

        self.action_low, self.action_high = (bound.astype(float).ravel() for bound in (action.low, action.high))
        self.observation_size = int(spaces.flatdim(observation))
        self.action_names = self._action_names()
        observed = self._observed()
        self.observation_names, self.observation_units = ([each[i] for each in observed] for i in range(2))

    @property
    def episode_steps(self) -> int | None:
        """How many actions an episode has at most, if its registration limits them."""
        spec = self._environment.spec
        return spec.max_episode_steps if spec else None

    def compiled_model(self) -> mujoco.MjModel:
        """A copy of its model as it is compiled, with automatic resets if it has them."""
        model = copy.copy(self.model)
        model.opt.disableflags = self._own_flags
        return model

    def reset(self, seed: int) -> np.ndarray:
        """The observation `(nobs,)` at the start of the episode of this seed."""
        with self._watched("reset"):
            observation, _ = self._environment.reset(seed=seed)
        return _one_vector(self._flatten(observation))

    def step(self, action: np.ndarray) -> EnvironmentStep:
        """Applies an action `(nact,)` for one control period, as the type of number that the environment asks for.

        Raises:
          UsageError: the action has another size.
        """
        if action.size != len(self.action_names):
            message = f"{clean(self.text)} takes actions of {len(self.action_names)} numbers, not of {action.size}"
            raise UsageError(f"{option('policy')}: {message}")
        with self._watched("step"):
            given = action.reshape(self._action_shape).astype(self._action_type)
            observation, reward, terminated, truncated, told = self._environment.step(given)
        seen = _one_vector(self._flatten(observation))
        terms = {key.removeprefix(REWARD): float(value) for key, value in told.items() if key.startswith(REWARD)}
        return EnvironmentStep(seen, float(reward), terms, _ending(terminated, truncated, told))

    def state(self) -> np.ndarray:
        """The integration state `(nstate,)` of its simulation."""
        return state.save(self.model, self.data)

    @property
    def is_unstable(self) -> bool:
        """Whether its simulation has gone beyond all numbers."""
        moving = np.concatenate([self.data.qpos, self.data.qvel])
        return any(self.data.warning[kind].number for kind in BAD) or not (abs(moving) <= mujoco.mjMAXVAL).all()

    def names(self, first: EnvironmentStep) -> EpisodeNames:
        """The names of all numbers of an episode; those of rewards are known after the `first` step only."""
        return EpisodeNames(self.observation_names, self.action_names, [*first.reward_terms])

    def close(self) -> None:
        """Ends it."""
        self._environment.close()

    def _action_names(self) -> list[str]:
        """Those of the controls, if the action has as many numbers; else numbers."""
        size = int(np.prod(self._action_shape))
        return control_names(self.model) if size == self.model.nu else [str(i) for i in range(size)]

    def _observed(self) -> list[tuple[str, str]]:
        """The columns, with their units, that the environment says its observation consists of; else numbers.

        Version 5 of Gymnasium's own tell the fields of MjData in order, and how many numbers each has: the last of
        its columns, since what they leave out comes first: the place of the root, or the world.
        """
        structure = vars(self._environment.unwrapped).get("observation_structure")
        observed: list[tuple[str, str]] = []
        for part, size in structure.items() if isinstance(structure, dict) else ():
            if part.startswith("skipped") or not size:
                continue
            columns = field_probe(self.model, part).columns if part in extents() else ()
            known = [(column.name, column.unit) for column in columns[-size:]]
            observed += known if len(known) == size else [(f"{part}/{i}", "") for i in range(size)]
        if len(observed) != self.observation_size:
            return [(name, "") for name in _numbered(self._environment.observation_space)]
        return observed

    def _replace_model(self, source: GymSource) -> None:
        """Puts the model with its overrides in the place of the environment's own; the control period stays."""
        model, own = source.load(), self._mujoco.model
        steps = self.control_dt / rational(model.opt.timestep)
        if state.sizes(model) != state.sizes(own):
            raise UsageError(f"{clean(source.text)}: its environment is made for a model of other sizes")
        if steps.denominator != 1:
            message = f"acts every {float(self.control_dt):g} s, which must be a whole number of timesteps"
            raise UsageError(f"{option('timestep')} {model.opt.timestep:g}: {clean(source.text)} {message}")

        environment = vars(self._mujoco)
        for name in ("frame_skip", "n_substeps"):
            if name in environment:
                environment[name] = int(steps)
        if np.array_equal(environment.get("init_qpos", ()), own.qpos0):
            environment["init_qpos"] = model.qpos0.copy()
        environment["model"], environment["data"] = model, mujoco.MjData(model)
        self.control_steps = int(steps)

    @contextmanager
    def _watched(self, what: str) -> Iterator[None]:
        """Tells what the environment raises as what it is: its own, or MuJoCo giving up."""
        try:
            with redirect_stdout(sys.stderr):  # what it prints is no payload
                yield
        except MjrunError:
            raise
        except mujoco.FatalError as error:
            step = round(self.data.time / self.model.opt.timestep)
            raise FailedStepError(step, self.data.time, str(error)) from None
        except Exception as error:
            raise ControllerError.of(f"{what} of {clean(self.text)}", error) from error


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
        names, time = self.environment.action_names, self._begin * self._timestep
        action = ask(self._actor, observation, names, self._begin, time, self._policy)
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


def _numbered(space: Any, prefix: str = "") -> list[str]:
    """Names for the numbers of a flattened space: their places, in the parts of a dictionary."""
    from gymnasium import spaces

    if isinstance(space, spaces.Dict):
        return [name for key, part in space.spaces.items() for name in _numbered(part, f"{prefix}{key}/")]
    return [f"{prefix}{i}" for i in range(int(spaces.flatdim(space)))]


def _one_vector(values: Any) -> np.ndarray:
    return np.array(values, float).ravel()


def _ending(terminated: bool, truncated: bool, told: Mapping[str, Any]) -> Ending | None:
    """How an episode ended, which an environment says in two truths, and whether it was a success in a third."""
    if terminated:
        return Ending(TERMINATED, "success" if any(told.get(name) for name in SUCCESS) else "failure")
    return TIMED_OUT if truncated else None
