"""Gymnasium's MuJoCo environments as tasks: they reset, step and compute rewards themselves."""

import copy
import sys
from collections.abc import Generator, Mapping
from contextlib import contextmanager, redirect_stdout
from functools import partial
from typing import Any

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import ControllerError, FailedStepError, MjrunError, UsageError, clean, option
from mjrun.model import state
from mjrun.model.names import control_names
from mjrun.model.sources.gym import GymSource, control_steps, make_environment, mujoco_environment
from mjrun.physics.stepper import BAD, PhysicsStepper
from mjrun.probe.fields import extents, field_probe
from mjrun.task.episode import Actor, ControlInstant, Ending, EpisodeColumnNames, EpisodeOver, ask
from mjrun.task.task import TIMED_OUT
from mjrun.timeline import rational, unrounded

REWARD = "reward_"  # the prefix of terms of the reward in the info of a step
TERMINATED = "terminated"  # the name of any ending other than the time limit
SUCCESS = ("is_success", "success")  # the names of a success in the info of a step
NO_AUTORESET = int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)


@dataclass(frozen=True)
class EnvironmentStep:
    """A step of an environment: the result of an action.

    Attributes:
      observation: `(nobs,)` float64, flattened in Gymnasium's order.
      reward: the reward of this step.
      reward_terms: reported by the environment, by name without `reward_`; their sum may differ from the reward.
      ending: the end of the episode, if it ended here.
    """

    observation: np.ndarray
    reward: float
    reward_terms: Mapping[str, float]
    ending: Ending | None


class ExternalEnvironment:
    """A registered Gymnasium environment with a MuJoCo simulation.

    Automatic resets of unstable simulations are off.

    Args:
      source: the source; with overrides, its model replaces that of the environment, with the same control period.

    Attributes:
      model, data: the model and the data of the environment.
      control_steps: physics steps per action.
      control_dt: the control period [s].
      action_low, action_high: `(nact,)`, the bounds of an action; may be infinite.
      observation_size: the number of values in an observation.
      observation_names, action_names: the name of each value.
      observation_units: the SI unit of each value; empty if unknown.

    Raises:
      ModelNotFoundError, BrokenModelError, MissingExtraError: the environment does not exist or cannot be created.
      UsageError: its actions or observations are not numbers, or the overridden model does not fit it.
    """

    def __init__(self, source: GymSource) -> None:
        self.text = source.text
        self._environment = make_environment(source.name)
        from gymnasium import spaces

        self._mujoco = mujoco_environment(self._environment, source.name)
        action, observation = self._environment.action_space, self._environment.observation_space
        if not isinstance(action, spaces.Box):
            raise UsageError(f"{clean(self.text)} has the action space {action}; only vectors of numbers are supported")
        if not observation.is_np_flattenable:
            raise UsageError(f"{clean(self.text)} has the observation space {observation}, which is not a vector")
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
        nact = int(np.prod(action.shape))
        self.action_names = control_names(self.model) if nact == self.model.nu else [str(i) for i in range(nact)]
        observed = self._observed()
        self.observation_names, self.observation_units = ([each[i] for each in observed] for i in range(2))

    @property
    def episode_steps(self) -> int | None:
        """The maximum number of actions in an episode, as registered; None if unlimited."""
        spec = self._environment.spec
        return spec.max_episode_steps if spec else None

    @property
    def specification(self) -> str:
        """The environment as Gymnasium specifies it, in JSON; empty if that is not possible."""
        try:
            return self._environment.spec.to_json() if self._environment.spec else ""
        except (TypeError, ValueError):  # of arguments that JSON does not have
            return ""

    def compiled_model(self) -> mujoco.MjModel:
        """Returns a copy of its model as compiled, with its own setting of automatic resets."""
        model = copy.copy(self.model)
        model.opt.disableflags = self._own_flags
        return model

    def reset(self, seed: int) -> np.ndarray:
        """Begins the episode of this seed; returns its first observation `(nobs,)`."""
        with self._errors_of("reset"):
            observation, _ = self._environment.reset(seed=seed)
        return _one_vector(self._flatten(observation))

    def step(self, action: np.ndarray) -> EnvironmentStep:
        """Applies an action `(nact,)` for one control period, converted to the type of the action space.

        Raises:
          UsageError: the action has the wrong size.
        """
        if action.size != len(self.action_names):
            message = f"{clean(self.text)} takes actions of {len(self.action_names)} numbers, not of {action.size}"
            raise UsageError(f"{option('policy')}: {message}")
        with self._errors_of("step"):
            converted = action.reshape(self._action_shape).astype(self._action_type)
            result, reward, terminated, truncated, info = self._environment.step(converted)
            reward = float(reward)
        observation = _one_vector(self._flatten(result))
        reported = {key.removeprefix(REWARD): value for key, value in info.items() if key.startswith(REWARD)}
        terms = {name: float(value) for name, value in reported.items() if _is_number(value)}
        ending = TIMED_OUT if truncated else None
        if terminated:
            ending = Ending(TERMINATED, "success" if any(np.any(info.get(name)) for name in SUCCESS) else "failure")
        return EnvironmentStep(observation, reward, terms, ending)

    def state(self) -> np.ndarray:
        """Returns the integration state `(nstate,)` of its simulation."""
        return state.save(self.model, self.data)

    @property
    def is_unstable(self) -> bool:
        """True where MuJoCo reported an instability, or a number exceeds MuJoCo's limit."""
        moving = np.concatenate([self.data.qpos, self.data.qvel])
        return any(self.data.warning[kind].number for kind in BAD) or not (abs(moving) <= mujoco.mjMAXVAL).all()

    def names(self, first: EnvironmentStep) -> EpisodeColumnNames:
        """Returns the names of all numbers of an episode; those of rewards are known after the `first` step only."""
        return EpisodeColumnNames(self.observation_names, self.action_names, [*first.reward_terms])

    def close(self) -> None:
        """Closes the environment."""
        self._environment.close()

    def _observed(self) -> list[tuple[str, str]]:
        """Returns the columns of an observation and their units, as the environment describes them; else numbers.

        Version 5 of Gymnasium's own environments list the fields of MjData in order, each with the number of its values
        in the observation. These are the last of its columns; the omitted ones (root position, world) come first.
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
        """Replaces the environment's model by the one with overrides; the control period stays."""
        model, own = source.load(), self._mujoco.model
        steps = unrounded(self.control_dt / rational(model.opt.timestep))
        if state.sizes(model) != state.sizes(own):
            raise UsageError(f"{clean(source.text)}: the overridden model has other sizes than its environment's")
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
    def _errors_of(self, what: str) -> Generator[None]:
        """Converts errors of the environment, and of MuJoCo in it, to those of mjrun."""
        try:
            with redirect_stdout(sys.stderr):  # standard output carries the payload alone
                yield
        except MjrunError:
            raise
        except mujoco.FatalError as error:
            step = round(self.data.time / self.model.opt.timestep)
            raise FailedStepError(step, self.data.time, str(error)) from None
        except Exception as error:
            raise ControllerError.of(f"{what} of {clean(self.text)}", error) from error


class EnvironmentStepper:
    """A stepper through an episode of `environment` with the random seed `seed`, in which `actor` chooses the actions.

    States at control instants are those of the environment. States in between are simulated again from the last control
    instant, with the controls and other inputs of the environment; at the end of the period they are compared with its.

    On arrival at a control instant, the policy is called and the environment steps, so that the controls of the next
    control period are known at that instant.

    Args:
      policy: its name, for messages.

    Attributes:
      model: a copy of the environment's.
      step: the current one.
      names: the names of observations, actions and terms of the reward.
      control_steps: physics steps in a control period.
      periods: completed control periods, up to the end of the episode.

    Raises:
      UsageError: an action has the wrong size.
      SimulationError: an action is not finite, or the simulation fails.
    """

    def __init__(self, environment: ExternalEnvironment, actor: Actor, seed: int, policy: str = "") -> None:
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
          EpisodeOver: the episode ends before it; the stepper is at the end.
          SimulationError: the simulation, or the policy, failed.
          UsageError: `step` is within a control period in which the environment does more than step the physics.
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
            self.step = self._physics.step  # the last good one after a failure

    def now(self) -> ControlInstant:
        return self._now

    def state(self) -> np.ndarray:
        return self._physics.state()

    def instant(self) -> mujoco.MjData:
        return self._physics.instant()

    def initial(self) -> mujoco.MjData:
        return self._physics.initial()

    def _finish_period(self) -> None:
        """Moves to the next control instant, where the environment already is, and asks for its action."""
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
        """Returns the action of the policy on `observation`, and the environment's step under it."""
        names, time = self.environment.action_names, self._begin * self._timestep
        action = ask(self._actor, observation, names, self._begin, time, self._policy)
        return self.environment.step(action), action

    def _driven(self) -> np.ndarray:
        """Returns the state of the last control instant with the inputs that the environment applied from there on."""
        driven, inputs = self._state.copy(), state.part(self.environment.model, state.INPUTS)
        driven[inputs] = self.environment.state()[inputs]
        return driven

    def _compare(self, end: int, after: np.ndarray) -> None:
        """Simulates the rest of the period, and raises unless it ends in `after`, the state of the environment."""
        self._physics.advance(end)
        alike = np.delete(np.arange(after.size), state.part(self.model, state.INPUTS))
        if self.environment.is_unstable or not np.array_equal(self._physics.state()[alike], after[alike]):
            time = self._begin * self._timestep
            raise UsageError(
                f"{clean(self.environment.text)} does more in its step at {time:.9g} s than step the physics, so the "
                "states between control instants are unknown\n"
                f"request only every {self.control_steps} steps, {self.environment.control_steps * self._timestep:g} s"
            )


def _numbered(space: Any, prefix: str = "") -> list[str]:
    """Returns names for the values of a flattened space: indices, within the keys of a dictionary."""
    from gymnasium import spaces

    if isinstance(space, spaces.Dict):
        return [name for key, part in space.spaces.items() for name in _numbered(part, f"{prefix}{key}/")]
    return [f"{prefix}{i}" for i in range(int(spaces.flatdim(space)))]


def _is_number(value: Any) -> bool:
    """Returns whether a value of the info of a step is one number, and not a mapping, a text or a vector."""
    return np.ndim(value) == 0 and np.asarray(value).dtype.kind in "biuf"


def _one_vector(values: Any) -> np.ndarray:
    return np.array(values, float).ravel()
