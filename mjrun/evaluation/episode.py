"""Episodes: specifications, players and records. A policy acts on a task in many worlds side by side, or in an external
environment.
"""

import dataclasses
import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, replace
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import InvalidActionError, MjrunError, SimulationError, flag
from mjrun.experiment.design import SHORT_PATHS
from mjrun.experiment.results_table import column_units, metric_columns, metric_units, parse_metrics
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.source import ModelSource
from mjrun.model.sources.gym import GymSource
from mjrun.model.units import setting_unit
from mjrun.model.variants import BYTES
from mjrun.options.policy import is_code
from mjrun.options.simulation import NO_DISTURBANCES, Disturbances
from mjrun.outputs.trace_rows import ProbeSampler
from mjrun.policy.load import load_policy
from mjrun.policy.policy import ActionSpace, Actor, Policy
from mjrun.policy.task_facts import check_agreement
from mjrun.probe.metric import MetricEvaluator
from mjrun.simulation.input_snapshot import InputSnapshot
from mjrun.simulation.policy_episode import UNLIMITED, require_undisturbed
from mjrun.simulation.simulation import Simulation
from mjrun.study.spec import PointResult, Status
from mjrun.task.batch_columns import ALL, Rows
from mjrun.task.episode import Ending, EpisodeStepper
from mjrun.task.external_environment import ExternalEnvironment
from mjrun.task.task import TIMED_OUT, Task
from mjrun.task.worlds import TaskWorlds
from mjrun.timeline import Timeline, rational

FAILURE = "failure"
OUTCOMES = ("success", FAILURE, "timeout")
TERMINATED = "terminated"  # the only termination that external environments report
SIDE_BY_SIDE = 128  # most worlds, unless fewer take `BYTES` of memory


@dataclass(frozen=True)
class PolicyChoice:
    """A policy as the user names it.

    Attributes:
      policy: text of the policy or, in Python, the policy.
      normalize: statistics that normalize its observations.
      trust: whether its file may execute code.
      snapshot: copies of its files, which are read instead.
    """

    policy: object
    normalize: str | None = None
    trust: bool = False
    snapshot: InputSnapshot | None = field(default=None, compare=False, repr=False)

    def load(self) -> Policy:
        """Loads the policy.

        Raises:
          UsageError: it is not a policy, or is not trusted.
          FileError: its files cannot be read.
        """
        place = self.snapshot.place if self.snapshot else Path
        return load_policy(self.policy, trust=self.trust, normalize=self.normalize, place=place)

    @property
    def is_code(self) -> bool:
        """True for code that the user has written and other processes can load."""
        return isinstance(self.policy, str) and is_code(self.policy)

    @property
    def name(self) -> str:
        """Name of the policy in tables."""
        return self.policy if isinstance(self.policy, str) else type(self.policy).__name__


@dataclass(frozen=True)
class EpisodeGroupSpec:
    """The specification of a group of episodes: everything that they share, that is, all but their seeds.

    Attributes:
      task: task to play.
      chosen: policy that plays.
      metrics: name and text of each metric.
      disturbances: noise instead of that of the task, and additional pushes.
    """

    task: ModelSource
    chosen: PolicyChoice
    metrics: tuple[tuple[str, str], ...] = ()
    disturbances: Disturbances = NO_DISTURBANCES

    @property
    def source(self) -> ModelSource:
        """The task, read from copies of its files if there are any."""
        snapshot = self.chosen.snapshot
        return self.task.stored_at(snapshot.place) if snapshot else self.task

    def simulation(self, seed: int = 0) -> Simulation:
        """Returns the simulation of the episode of a seed."""
        chosen = self.chosen
        return Simulation(
            self.task,
            policy=chosen.policy,
            normalize=chosen.normalize,
            trust=chosen.trust,
            **vars(self.disturbances),
            seed=seed,
            snapshot=chosen.snapshot,
        )

    def stored_at(self, root: Path) -> "EpisodeGroupSpec":
        """Returns the same specification, whose files are in the folder `root`."""
        chosen = self.chosen
        snapshot = chosen.snapshot and replace(chosen.snapshot, root=root)
        return replace(self, chosen=replace(chosen, snapshot=snapshot))


@dataclasses.dataclass(frozen=True, slots=True)  # since there may be a million of them
class EpisodeRecord:
    """The record of an episode that was played, or failed.

    Attributes:
      seed: seed of everything that is random in the episode.
      total: return: sum of all rewards.
      steps: number of control periods.
      length: simulated time [s].
      ending: name of the termination.
      outcome: kind of the termination: `success`, `failure` or `timeout`.
      terms: names of the terms of the reward; episodes share this object.
      sums: sum of each term.
      metrics: metrics in the order of the specification; NaN where undefined.
      status: `ok`, or how the episode failed; then its numbers are NaN, and it has no ending.
      message: reason of the failure.
      exit_code: exit code of the failure.
    """

    seed: int
    total: float
    steps: int
    length: float
    ending: str
    outcome: str
    terms: Sequence[str]
    sums: Sequence[float]
    metrics: Sequence[float] = ()
    status: Status = "ok"
    message: str = ""
    exit_code: int = 0

    @classmethod
    def failed(cls, seed: int, result: PointResult, terms: Sequence[str], metrics: int) -> "EpisodeRecord":
        """Returns the record of an episode that failed with this result.

        Args:
          terms: names of the terms of the reward.
          metrics: number of metrics.
        """
        return cls(
            seed=seed,
            total=math.nan,
            steps=result.steps,
            length=math.nan,
            ending="",
            outcome="",
            terms=terms,
            sums=(math.nan,) * len(terms),
            metrics=(math.nan,) * metrics,
            status=result.status,
            message=result.message,
            exit_code=result.exit_code,
        )

    @property
    def rewards(self) -> Mapping[str, float]:
        """Sum of each term of the reward, by name."""
        return dict(zip(self.terms, self.sums, strict=True))


@dataclass(frozen=True)
class PlayedEpisodes:
    """The episodes of one policy at one point.

    Attributes:
      policy: name of the policy.
      point: number of the point.
      episodes: records in the order of the seeds, also of episodes that failed.
    """

    policy: str
    point: int
    episodes: Sequence[EpisodeRecord]

    @property
    def is_completed(self) -> np.ndarray:
        """Episodes that did not fail, bool `(n,)`."""
        return np.array([episode.status == "ok" for episode in self.episodes])

    @property
    def returns(self) -> np.ndarray:
        """Return of each episode `(n,)`; NaN where it failed."""
        return np.array([episode.total for episode in self.episodes])

    @property
    def successes(self) -> np.ndarray:
        """Success of each episode, bool `(n,)`."""
        return np.array([episode.outcome == OUTCOMES[0] for episode in self.episodes])


class EpisodePlayer(ABC):
    """A player of episodes of one task under one policy.

    Attributes:
      rewards: names of the terms of the reward.
      endings: names of the ways in which an episode can end.
      can_succeed: whether one of them is a success.
    """

    rewards: Sequence[str]
    endings: Sequence[str]
    can_succeed: bool

    def metric_units(self) -> Mapping[str, str]:
        """Returns the units of metrics that follow from those of columns, by name; empty where unknown."""
        return {}

    def parameter_units(self, names: Sequence[str]) -> Mapping[str, str]:
        """Returns the units of parameters that are settings of a model, by name; empty where unknown."""
        return {}

    @abstractmethod
    def first_action(self, seed: int) -> np.ndarray:
        """Returns the action at the start of the episode of `seed`, `(nact,)`."""

    @abstractmethod
    def play(self, seeds: Sequence[int]) -> list[EpisodeRecord]:
        """Plays the episodes of `seeds`, and returns their records in order.

        An episode has failed if its policy failed, returned an action that is not finite, or if the simulation of its
        environment failed; the other episodes are not affected.
        """


def player_of(spec: EpisodeGroupSpec) -> EpisodePlayer:
    """Creates the player of the episodes of `spec`: loads the policy, and checks that it fits the task.

    Raises:
      UsageError: the source is not a task, or the policy does not fit it.
      FileError: the policy cannot be read.
      ModelError: the model cannot be loaded.
    """
    policy, task = spec.chosen.load(), spec.source
    player: EpisodePlayer
    if isinstance(task, GymSource):
        require_undisturbed(spec.disturbances)
        player = _EnvironmentPlayer(task, policy)
    elif isinstance(task, Task):
        player = TaskPlayer(task.with_disturbances(spec.disturbances), policy)
    else:
        from mjrun.policy.task_facts import inferred_task

        player = TaskPlayer(inferred_task(policy, task).with_disturbances(spec.disturbances), policy)
    return _MeasuringPlayer(player, spec, policy) if spec.metrics else player


class _Tallies:
    """Rewards of the episodes that are being played in `count` worlds.

    Attributes:
      steps: number of control periods of each `(count,)`.
    """

    def __init__(self, count: int, names: Sequence[str], control_dt: Fraction) -> None:
        self.steps = np.zeros(count, int)
        self._totals, self._terms = np.zeros(count), np.zeros((count, len(names)))
        self._names, self._control_dt = names, control_dt

    def begin(self, world: int) -> None:
        """Begins an episode."""
        self.steps[world] = self._totals[world] = self._terms[world] = 0

    def add(self, worlds: Rows | int, rewards: np.ndarray | float, terms: np.ndarray) -> None:
        """Adds the rewards `(k,)` and their terms `(k, nterms)` of a control period in some worlds, or in one."""
        self._totals[worlds] += rewards
        self._terms[worlds] += terms
        self.steps[worlds] += 1

    def ended(self, world: int, seed: int, ending: Ending) -> EpisodeRecord:
        """Returns the record of the episode of `seed`, which has ended in a world."""
        steps, sums = int(self.steps[world]), tuple(self._terms[world].tolist())
        length, total = float(steps * self._control_dt), float(self._totals[world])
        return EpisodeRecord(seed, total, steps, length, ending.name, ending.kind, self._names, sums)


class _Running(NamedTuple):
    """An episode that a policy is playing."""

    seed: int
    actor: Actor


def failed(error: MjrunError, seed: int, steps: int, rewards: Sequence[str], metrics: int = 0) -> EpisodeRecord:
    """Returns the record of an episode that failed with an error after a number of control periods."""
    result = PointResult(-1, "failed", (), steps, error.exit_code, error.spelled(flag))
    return EpisodeRecord.failed(seed, result, rewards, metrics)


class TaskPlayer(EpisodePlayer):
    """A player of a task in worlds side by side; when an episode ends, its world starts the next."""

    def __init__(self, task: Task, policy: Policy) -> None:
        self._task, self._policy = task, policy
        with task.located():
            check_agreement(task, policy)
            self._worlds = TaskWorlds(task, 1, threads=1)
        self._actions = ActionSpace(self._worlds.action_names, self._worlds.actions.low, self._worlds.actions.high)
        self._fitting = max(1, BYTES // max(1, self._worlds.world_bytes))
        self.rewards = tuple(self._worlds.reward_names)
        self.endings = list(dict.fromkeys(ending.name for ending in self._worlds.endings))
        self.can_succeed = any(ending.kind == "success" for ending in self._worlds.endings)

    def parameter_units(self, names: Sequence[str]) -> Mapping[str, str]:
        model = self._worlds.nominal_model
        return {name: setting_unit(model, SHORT_PATHS.get(name, name)) for name in names}

    def first_action(self, seed: int) -> np.ndarray:
        with self._task.located():
            return self._policy.episode(seed, self._actions)(self._worlds.reset([seed], [0])[0])

    def play(self, seeds: Sequence[int]) -> list[EpisodeRecord]:
        count = min(len(seeds), SIDE_BY_SIDE, self._fitting)
        if self._worlds.count < count:
            self._worlds = TaskWorlds(self._task, count, threads=1)
        with self._task.located():
            episodes = {episode.seed: episode for episode in self._played(seeds, count)}
        return [episodes[seed] for seed in seeds]

    def _played(self, seeds: Sequence[int], count: int) -> Iterator[EpisodeRecord]:
        """Yields the episodes as they end or fail, in `count` worlds."""
        worlds, waiting, running = self._worlds, deque(seeds), dict[int, _Running]()
        tallies = _Tallies(worlds.count, self.rewards, self._task.control_dt)
        observations = np.empty((worlds.count, len(worlds.observed)))
        actions = np.zeros((worlds.count, len(self._actions.names)))
        for world in range(count):
            yield from self._begun(world, waiting, running, observations)
        while running:
            failures = self._act(running, observations, actions, tallies)
            acting = sorted({*running} - {*failures})
            for world, error in failures.items():
                yield failed(error, running.pop(world).seed, int(tallies.steps[world]), self.rewards)
                tallies.begin(world)
                yield from self._begun(world, waiting, running, observations)
            if not acting:
                continue
            ids = None if len(acting) == worlds.count else np.array(acting)
            rows = ALL if ids is None else ids
            step = worlds.step(actions[rows], ids)
            observations[rows] = step.observations
            tallies.add(rows, step.rewards, step.reward_terms)
            for index in np.flatnonzero(step.over).tolist():
                world = index if ids is None else int(ids[index])
                yield tallies.ended(world, running.pop(world).seed, step.endings[int(step.codes[index])])
                tallies.begin(world)
                yield from self._begun(world, waiting, running, observations)

    def _begun(
        self, world: int, waiting: deque[int], running: dict[int, _Running], observations: np.ndarray
    ) -> Iterator[EpisodeRecord]:
        """Begins the next episode in a world, if one waits; yields those that fail at their beginning."""
        while waiting:
            seed = waiting.popleft()
            try:
                actor = self._policy.episode(seed, self._actions)
                observations[world] = self._worlds.reset([seed], [world])[0]
            except MjrunError as error:
                yield failed(error, seed, 0, self.rewards)
            else:
                running[world] = _Running(seed, actor)
                return

    def _act(
        self, running: Mapping[int, _Running], observations: np.ndarray, actions: np.ndarray, tallies: _Tallies
    ) -> dict[int, MjrunError]:
        """Writes the action of each episode into the row of its world; returns the errors of those that fail."""
        failures = dict[int, MjrunError]()
        for world, episode in running.items():
            try:
                actions[world] = episode.actor(observations[world])
            except MjrunError as error:
                failures[world] = error
        if np.isfinite(actions).all():
            return failures
        for world in running.keys() - failures.keys():
            action = actions[world]
            if not np.isfinite(action).all():
                periods = int(tallies.steps[world])
                step, time = periods * self._worlds.control_steps, periods * self._task.control_dt
                failures[world] = _invalid(self._policy, self._actions, action, step, float(time))
                action[:] = 0  # the row of a world without an episode stays finite
        return failures


class _EnvironmentPlayer(EpisodePlayer):
    """A player of a Gymnasium environment, which resets, steps and rewards itself, one episode after the other.

    An episode that never ends is cut at the length of its video.
    """

    def __init__(self, source: GymSource, policy: Policy) -> None:
        self._policy, self._environment = policy, ExternalEnvironment(source)
        environment = self._environment
        self._actions = ActionSpace(environment.action_names, environment.action_low, environment.action_high)
        self._periods = environment.episode_steps or math.ceil(UNLIMITED / environment.control_dt)
        environment.reset(0)
        first = environment.step(np.zeros(len(self._actions.names)))
        self.rewards = tuple(environment.names(first).rewards)
        self.endings = [TERMINATED, TIMED_OUT.name]
        self.can_succeed = False  # it does not announce successes

    def first_action(self, seed: int) -> np.ndarray:
        return self._policy.episode(seed, self._actions)(self._environment.reset(seed))

    def play(self, seeds: Sequence[int]) -> list[EpisodeRecord]:
        return [self._played(seed) for seed in seeds]

    def _played(self, seed: int) -> EpisodeRecord:
        tally = _Tallies(1, self.rewards, self._environment.control_dt)
        try:
            return self._ended(seed, tally)
        except MjrunError as error:
            return failed(error, seed, int(tally.steps[0]), self.rewards)

    def _ended(self, seed: int, tally: _Tallies) -> EpisodeRecord:
        """Plays an episode up to its end, and adds its rewards to `tally`.

        Raises:
          MjrunError: the policy or the environment failed.
        """
        environment = self._environment
        actor, periods = self._policy.episode(seed, self._actions), 0
        observation = environment.reset(seed)
        while True:
            action = actor(observation)
            if not np.isfinite(action).all():
                step, time = periods * environment.control_steps, float(periods * environment.control_dt)
                raise _invalid(self._policy, self._actions, action, step, time)
            result = environment.step(action)
            terms = [result.reward_terms.get(name, np.nan) for name in self.rewards]
            tally.add(0, result.reward, np.array(terms))
            periods += 1
            ending = result.ending or (TIMED_OUT if periods == self._periods else None)
            if ending:
                return tally.ended(0, seed, ending)
            observation = result.observation


class _MeasuringPlayer(EpisodePlayer):
    """A player that measures episodes one after the other, step by step, bit for bit as `player` plays them.

    Raises:
      UsageError: a metric is malformed, or contains an unknown name.
    """

    def __init__(self, player: EpisodePlayer, spec: EpisodeGroupSpec, policy: Policy) -> None:
        self._player, self._policy = player, policy
        self.rewards, self.endings, self.can_succeed = player.rewards, player.endings, player.can_succeed
        self._task, self._disturbances = spec.source, spec.disturbances
        simulation = self._simulation(0)
        assert simulation.episode
        model = simulation.load()
        self._named_metrics, self._model, self._episode_columns = spec.metrics, model, simulation.episode.columns
        self._metrics = parse_metrics(spec.metrics, model, simulation.episode.columns)
        self._columns = metric_columns(self._metrics)

    def metric_units(self) -> Mapping[str, str]:
        columns = column_units(self._model, metric_columns(self._metrics), self._episode_columns)
        return metric_units(self._named_metrics, self._metrics, columns)

    def parameter_units(self, names: Sequence[str]) -> Mapping[str, str]:
        return self._player.parameter_units(names)

    def first_action(self, seed: int) -> np.ndarray:
        return self._player.first_action(seed)

    def play(self, seeds: Sequence[int]) -> list[EpisodeRecord]:
        return [self._played(seed) for seed in seeds]

    def _simulation(self, seed: int) -> Simulation:
        return Simulation(self._task, policy=self._policy, seed=seed, **vars(self._disturbances))

    def _played(self, seed: int) -> EpisodeRecord:
        """Plays an episode, and measures its metrics over the rows at every control instant, including the end."""
        simulation = self._simulation(seed)
        assert simulation.episode
        model = simulation.load()
        timeline = Timeline.of_steps(rational(model.opt.timestep), simulation.episode.longest)
        sampler = ProbeSampler(model, self._columns, timeline, simulation.episode.columns)
        evaluation = MetricEvaluator(self._metrics, [column.name for column in sampler.columns])
        try:
            with collected_warnings():  # which plain episodes do not report either
                episode = self._stepped(simulation, model, sampler, evaluation)
            return replace(episode, metrics=evaluation.values())
        except MjrunError as error:
            failure = error
        # An unstable simulation has no last instant. Any other error is that of the plain episode, if it has one.
        (episode,) = self._player.play([seed])
        if episode.status != "ok":
            return replace(episode, metrics=(math.nan,) * len(self._metrics))
        if not isinstance(failure, SimulationError):
            return failed(failure, seed, episode.steps, self.rewards, len(self._metrics))
        return replace(episode, metrics=evaluation.values())

    def _stepped(
        self, simulation: Simulation, model: mujoco.MjModel, sampler: ProbeSampler, evaluation: MetricEvaluator
    ) -> EpisodeRecord:
        """Plays an episode and feeds its rows to `evaluation`; returns its record without the metrics."""
        stepper = simulation.stepper(model)
        assert isinstance(stepper, EpisodeStepper)
        assert simulation.episode
        period, longest = stepper.control_steps, simulation.episode.longest
        tally, ending = _Tallies(1, self.rewards, simulation.episode.control_dt), None
        evaluation.feed(_row(sampler, stepper))
        while ending is None:
            stepper.advance(stepper.step + period)
            tally.add(0, stepper.now().reward, self._terms(stepper))
            evaluation.feed(_row(sampler, stepper))
            ending = stepper.now().ending or (TIMED_OUT if stepper.step >= longest else None)
        return tally.ended(0, simulation.seed, ending)

    def _terms(self, stepper: EpisodeStepper) -> np.ndarray:
        """Returns the terms of the reward of the last control period, in the order of `rewards`."""
        terms = dict(zip(stepper.names.rewards, stepper.now().reward_terms, strict=True))
        return np.array([terms.get(name, np.nan) for name in self.rewards])


def _row(sampler: ProbeSampler, stepper: EpisodeStepper) -> np.ndarray:
    return sampler.stack([stepper.step], sampler.read(stepper)).values


def _invalid(policy: Policy, actions: ActionSpace, action: np.ndarray, step: int, time: float) -> InvalidActionError:
    values = {name: float(value) for name, value in zip(actions.names, action, strict=True) if not np.isfinite(value)}
    return InvalidActionError(step, time, policy.name, values)
