"""Episodes of a policy: their task, length, ending and result."""

import copy
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import field
from fractions import Fraction
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Self

import mujoco

from mjrun.dataclass import dataclass
from mjrun.errors import SimulationError, UsageError, clean, option
from mjrun.formats.input_file import is_file
from mjrun.model.source import ModelSource
from mjrun.options.policy import NONE, is_code, is_policy_file
from mjrun.options.simulation import NO_DISTURBANCES, Disturbances
from mjrun.probe.episode_columns import EpisodeColumns
from mjrun.task.episode import Actor, EpisodeStepper, recorded
from mjrun.timeline import Timeline, rational

if TYPE_CHECKING:
    from mjrun.model.sources.gym import GymSource
    from mjrun.policy.policy import ActionSpace, Policy
    from mjrun.task.episode_start import EpisodeModels
    from mjrun.task.external_environment import ExternalEnvironment
    from mjrun.task.single_world import SingleWorld
    from mjrun.task.task import Task

CACHED_POLICIES = 8
UNLIMITED = 5  # [s] simulated time of an episode that nothing ends


@dataclass(frozen=True)
class EpisodeResult:
    """The result of an episode, as far as it was simulated.

    Attributes:
      policy: name of the policy.
      seed: seed of the episode.
      periods: number of completed control periods up to the end.
      time: time of the end, or of the last step [s].
      simulated: time of the last step, which may be after the end [s].
      total: sum of all rewards; the return if the episode has ended.
      ending: name of the termination; None if the episode has not ended.
      kind: `success`, `failure` or `timeout`; None if the episode has not ended.
    """

    policy: str
    seed: int
    periods: int
    time: float
    simulated: float
    total: float
    ending: str | None
    kind: str | None

    @property
    def sentence(self) -> str:
        """A sentence that describes the result."""
        reached = f"return {self.total:.6g}"
        if self.ending is None:
            return f"the episode of seed {self.seed} has not ended after {self.time:g} s: {reached} so far"
        how = self.ending if self.ending == self.kind else f"{clean(self.ending)} ({self.kind})"
        sentence = f"the episode of seed {self.seed} ended after {self.time:g} s: {how}, {reached}"
        if self.simulated <= self.time:
            return sentence
        return f"{sentence}; the simulation continued without a reset up to {self.simulated:g} s"


class Episode(ABC):
    """The episode of a seed.

    Attributes:
      can_continue: whether the simulation can continue without a reset after the end of the episode.
    """

    can_continue = True

    def __init__(self, policy: "Policy", seed: int) -> None:
        self.policy, self.seed = policy, seed
        self._repeating: Actor | None = None  # of the next stepper

    @abstractmethod
    def model(self) -> mujoco.MjModel:
        """Returns the model of this episode, which may vary with the seed."""

    def timeline(self, timestep: Fraction, requested: Timeline | None) -> Timeline:
        """Returns the timeline of the simulation, which ends with the episode if no length is requested.

        Args:
          timestep: timestep [s].
          requested: timeline that the user requests.
        """
        if requested is not None and (self.can_continue or requested.steps <= self.length):
            return requested
        return Timeline.of_steps(timestep, self.length)

    def remarks(self, requested: Timeline | None) -> list[str]:
        """Returns remarks for the user before the episode is simulated; see `timeline`."""
        if requested is None or self.can_continue or requested.steps <= self.length:
            return []
        end = float(requested.time(self.length))
        return [f"the episode ends at {end:g} s, and the simulation with it: an environment needs a reset to continue"]

    def result(self, stepper: EpisodeStepper) -> EpisodeResult:
        """Returns the result of the episode that `stepper` has simulated."""
        now, timestep = stepper.now(), rational(stepper.model.opt.timestep)
        return EpisodeResult(
            policy=self.policy.name,
            seed=self.seed,
            periods=stepper.periods,
            time=float((stepper.step if now.ending is None else stepper.periods * stepper.control_steps) * timestep),
            simulated=float(stepper.step * timestep),
            total=now.total,
            ending=now.ending.name if now.ending else None,
            kind=now.ending.kind if now.ending else None,
        )

    def stepper(self, enable_flags: int = 0) -> EpisodeStepper:
        """Starts the episode.

        Args:
          enable_flags: MuJoCo's flags for measured quantities, which must not change the motion.
        """
        actor, self._repeating = self._repeating or self._actor(), None
        stepper = self._start(actor)
        stepper.model.opt.enableflags |= enable_flags
        return stepper

    def of_seed(self, seed: int) -> Self:
        """Returns the episode of another seed, which shares everything that is costly to make.

        All steppers of these episodes share one world: creating a stepper invalidates earlier ones.
        """
        other = copy.copy(self)
        for name in ("_first", "length"):
            vars(other).pop(name, None)
        other.seed, other._repeating = seed, None
        return other

    def _actor(self) -> Actor:
        """Returns the policy at the start of the episode."""
        return self.policy.episode(self.seed, self.actions)

    @abstractmethod
    def _start(self, actor: Actor) -> EpisodeStepper:
        """Starts the episode under the actions of `actor`, without additional flags."""

    @property
    @abstractmethod
    def longest(self) -> int:
        """Most physics steps of an episode that are simulated."""

    @property
    def specification(self) -> str:
        """The environment as Gymnasium specifies it, in JSON; empty if Gymnasium cannot create it."""
        return ""

    @property
    @abstractmethod
    def control_dt(self) -> Fraction:
        """The control period [s]."""

    @property
    @abstractmethod
    def actions(self) -> "ActionSpace":
        """The numbers of an action and their bounds."""

    @cached_property
    def _first(self) -> EpisodeStepper:
        """A stepper for facts that are needed before the simulation, which repeats its actions.

        A policy is thus called once for each control period, which matters to functions with a memory.
        """
        recording, self._repeating = recorded(self._actor())
        return self._start(recording)

    @cached_property
    def columns(self) -> EpisodeColumns:
        """Columns in addition to those of the model."""
        names = self._first.names
        return EpisodeColumns(dict.fromkeys(names.observations, ""), names.actions, names.rewards)

    @cached_property
    def length(self) -> int:
        """Physics steps up to its end, found by simulating it; `longest` if it does not end or fails."""
        stepper = self._first
        try:
            while stepper.now().ending is None and stepper.step < self.longest:
                stepper.advance(stepper.step + stepper.control_steps)
        except SimulationError:  # raised again when it is simulated again
            return self.longest
        return stepper.step


class TaskEpisode(Episode):
    """An episode of a task. All its steppers share one world: creating a stepper invalidates earlier ones."""

    def __init__(self, task: "Task", policy: "Policy", seed: int) -> None:
        super().__init__(policy, seed)
        from mjrun.policy.task_facts import check_agreement

        check_agreement(task, policy)
        self._task = task

    @cached_property
    def _world(self) -> "SingleWorld":
        from mjrun.task.single_world import SingleWorld

        return SingleWorld(self._task)

    @cached_property
    def _models(self) -> "EpisodeModels":
        from mjrun.model.variants import VariantLoader
        from mjrun.task.episode_start import EpisodeModels

        return EpisodeModels(self._task.model_source, self._task.reset.vary, VariantLoader())

    def model(self) -> mujoco.MjModel:
        with self._task.located():
            return self._models.model(self.seed)

    def of_seed(self, seed: int) -> Self:
        _ = self._world, self._models  # which both share
        return super().of_seed(seed)

    @cached_property
    def columns(self) -> EpisodeColumns:
        world = self._world
        units = {number.name: number.unit if number.scale == 1 else "" for number in world.observed}
        return EpisodeColumns(units, world.action_names, world.reward_names)

    @property
    def control_dt(self) -> Fraction:
        return self._task.control_dt

    @property
    def actions(self) -> "ActionSpace":
        from mjrun.policy.policy import ActionSpace

        world = self._world
        return ActionSpace(world.action_names, world.actions.low, world.actions.high)

    def _start(self, actor: Actor) -> EpisodeStepper:
        from mjrun.task.single_world import TaskStepper

        return TaskStepper(self._world, actor, self.seed, self.policy.name)

    @property
    def longest(self) -> int:
        return self._task.periods * self._world.control_steps


class EnvironmentEpisode(Episode):
    """An episode of a Gymnasium environment, which resets, steps and rewards itself."""

    can_continue = False

    def __init__(self, source: "GymSource", policy: "Policy", seed: int) -> None:
        super().__init__(policy, seed)
        self._source, self._environment = source, _environment(source)
        self._played: ExternalEnvironment | None = None  # by episodes that share it

    def model(self) -> mujoco.MjModel:
        return self._environment.compiled_model()

    @property
    def specification(self) -> str:
        return "" if self._source.overrides else self._environment.specification

    def of_seed(self, seed: int) -> Self:
        other = super().of_seed(seed)
        self._played = other._played = self._played or _environment(self._source)
        return other

    @property
    def control_dt(self) -> Fraction:
        return self._environment.control_dt

    @property
    def actions(self) -> "ActionSpace":
        from mjrun.policy.policy import ActionSpace

        environment = self._environment
        return ActionSpace(environment.action_names, environment.action_low, environment.action_high)

    @cached_property
    def columns(self) -> EpisodeColumns:
        environment = self._environment
        units = dict(zip(environment.observation_names, environment.observation_units, strict=True))
        names = self._first.names
        return EpisodeColumns({name: units.get(name, "") for name in names.observations}, names.actions, names.rewards)

    def _start(self, actor: Actor) -> EpisodeStepper:
        from mjrun.task.external_environment import EnvironmentStepper

        environment = self._played or _environment(self._source)  # which nothing else may reset
        return EnvironmentStepper(environment, actor, self.seed, self.policy.name)

    @property
    def longest(self) -> int:
        environment = self._environment
        actions = environment.episode_steps or math.ceil(UNLIMITED / environment.control_dt)
        return actions * environment.control_steps


def _environment(source: "GymSource") -> "ExternalEnvironment":
    from mjrun.task.external_environment import ExternalEnvironment

    return ExternalEnvironment(source)


def episode_of(
    source: ModelSource,
    policy: "Policy",
    seed: int,
    disturbances: Disturbances = NO_DISTURBANCES,
    control_dt: Fraction | None = None,
    duration: Fraction | None = None,
) -> Episode:
    """Returns the episode of `seed` of an environment, a task, or a model for which the policy specifies the task.

    Args:
      disturbances: noise instead of that of the task, and additional pushes.
      control_dt, duration: control period and length [s] of a model without a task.

    Raises:
      UsageError: the policy does not fit, or does not specify enough.
    """
    from mjrun.model.sources.gym import GymSource
    from mjrun.task.task import Task

    if control_dt is not None and isinstance(source, Task | GymSource):
        raise UsageError(f"{option('control_dt')}: {clean(source.text)} specifies the control period")
    if isinstance(source, Task):
        return TaskEpisode(source.with_disturbances(disturbances), policy, seed)
    if isinstance(source, GymSource):
        require_undisturbed(disturbances)
        return EnvironmentEpisode(source, policy, seed)
    from mjrun.policy.task_facts import inferred_task

    task = inferred_task(policy, source, control_dt, duration)
    return TaskEpisode(task.with_disturbances(disturbances), policy, seed)


def require_undisturbed(disturbances: Disturbances) -> None:
    """Requires that there are no disturbances, which external environments do not accept.

    Raises:
      UsageError: there are some.
    """
    for name, value in vars(disturbances).items():
        if value:
            raise UsageError(f"{option(name)}: an environment steps itself, which nothing can disturb", (name,))


def cached_policy(
    policy: object, trust: bool, normalize: str | None, place: Callable[[str | Path], Path] = Path
) -> "Policy":
    """Loads a policy; one that is read from files is cached until its files change.

    Args:
      place: function that returns the path where a file is read.
    """
    from mjrun.policy import load

    if not isinstance(policy, str) or is_code(policy):
        return load.load_policy(policy, trust=trust, normalize=normalize, place=place)
    files = [stored for file in policy_files(policy, normalize) if is_file(stored := place(file))]
    files = _Files([place], tuple((str(file.resolve()), load.digests.of(str(file))) for file in files))
    try:
        return _read_policy(policy, trust, normalize, files)
    finally:
        files.places.clear()  # the cache would keep it, and with it the copies of all files of a simulation


@dataclass(frozen=True)
class _Files:
    """Paths and hashes of the files of a policy, which identify it in the cache.

    Attributes:
      places: the function that returns where a file is read, until the policy has been read.
    """

    places: list[Callable[[str | Path], Path]] = field(compare=False)
    digests: tuple[tuple[str, str], ...]


@lru_cache(maxsize=CACHED_POLICIES)
def _read_policy(policy: str, trust: bool, normalize: str | None, files: _Files) -> "Policy":
    from mjrun.policy import load

    return load.load_policy(policy, trust=trust, normalize=normalize, place=files.places[0])


def policy_packages(policy: object) -> Sequence[str]:
    """Returns the packages that compute the actions of a policy in a file."""
    if not isinstance(policy, str) or not is_policy_file(policy):
        return ()
    from mjrun.policy.loaders import format_of

    loader = format_of(Path(policy))
    return loader.packages if loader else ()


def policy_files(policy: object, normalize: str | None = None) -> list[Path]:
    """Returns the files that a policy is read from, including those that its files name."""
    files = list[Path]()
    if isinstance(policy, str) and is_policy_file(policy):
        from mjrun.policy.load import files_of

        files += files_of(Path(policy))
    elif isinstance(policy, str) and is_code(policy) and (code := Path(policy.rpartition(":")[0])).suffix == ".py":
        files.append(code)
    if normalize not in (None, NONE):
        files.append(Path(normalize))
    return files
