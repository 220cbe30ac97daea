"""Plays episodes: a policy on a task in many worlds side by side, or in an environment of somebody else's."""

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import cast

import mujoco
import numpy as np

from mjrun.errors import InvalidActionError, MjrunError, SimulationError, concerning, option
from mjrun.evaluation.episode import Episode, EpisodeSpec
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.source import Source
from mjrun.model.sources.gym import GymSource
from mjrun.model.variants import BYTES
from mjrun.outputs.trace_rows import ProbeSampler
from mjrun.policy.agreement import check_agreement
from mjrun.policy.policy import ActionSpace, Actor, Policy
from mjrun.probe.available import AvailableProbes
from mjrun.probe.episode import EpisodeColumns
from mjrun.probe.metric import Metric, MetricEvaluation, parse_metric
from mjrun.simulation.episode import UNLIMITED
from mjrun.simulation.simulation import Simulation
from mjrun.task.episode import Ending, EpisodeStepper
from mjrun.task.gymnasium import Environment
from mjrun.task.task import TIMED_OUT, Task
from mjrun.task.worlds import TaskWorlds
from mjrun.timeline import Timeline, rational

TERMINATED = "terminated"  # which is all that environments of others say
SIDE_BY_SIDE = 32  # worlds, at most, unless fewer take `BYTES` of memory


class EpisodePlayer(ABC):
    """Plays episodes of one task under one policy.

    Attributes:
      rewards: names of the terms of the reward.
      endings: names of the ways in which an episode can end.
      can_succeed: whether one of them is a success.
    """

    rewards: Sequence[str]
    endings: Sequence[str]
    can_succeed: bool

    @abstractmethod
    def play(self, seeds: Sequence[int]) -> list[Episode]:
        """The episodes of `seeds`, in their order.

        Raises:
          InvalidActionError: the policy answers what is not a number.
          SimulationError: the simulation of an environment failed.
          MjrunError: the policy fails. In any case it is the error of the first of the episodes that fail.
        """


def player_of(spec: EpisodeSpec) -> EpisodePlayer:
    """What plays the episodes of `spec`, with its policy loaded, and all that must fit checked.

    Raises:
      UsageError: what is to be played is no task, or the policy does not fit it.
      FileError: the policy cannot be read.
      ModelError: the model cannot be had.
    """
    policy = spec.chosen.load()
    player = _plain_player(spec.task, policy)
    if not spec.metrics:
        return player
    return MeasuringPlayer(player, spec, policy)


def _plain_player(task: Source, policy: Policy) -> EpisodePlayer:
    if isinstance(task, GymSource):
        return EnvironmentPlayer(task, policy)
    if isinstance(task, Task):
        return TaskPlayer(task, policy)
    from mjrun.policy.inferred_task import inferred_task

    return TaskPlayer(inferred_task(policy, task), policy)


class _Tally:
    """What has come of an episode so far.

    Attributes:
      seed: of the episode.
      steps: control periods.
    """

    def __init__(self, seed: int, terms: int) -> None:
        self.seed, self.steps = seed, 0
        self._total, self._terms = 0.0, np.zeros(terms)

    def add(self, reward: float, terms: np.ndarray) -> None:
        """Takes the reward of a control period."""
        self._total += reward
        self._terms += terms
        self.steps += 1

    def ended(self, ending: Ending, names: Sequence[str], control_dt: float) -> Episode:
        """The episode, which has ended."""
        length, sums = self.steps * control_dt, tuple(self._terms.tolist())
        return Episode(self.seed, self._total, self.steps, length, ending.name, ending.kind, names, sums)


class _Running(_Tally):
    """An episode that is being played.

    Attributes:
      place: among those that are played in one go.
      action: the last answer of the policy.
    """

    action: np.ndarray

    def __init__(self, place: int, seed: int, actor: Actor, terms: int) -> None:
        super().__init__(seed, terms)
        self.place, self.actor = place, actor


class _FirstFailure:
    """The error of the first episode that fails, whichever fails first in time: later ones need not be played.

    Attributes:
      place: of that episode; infinite while none has failed.
    """

    def __init__(self) -> None:
        self.place, self._error = math.inf, cast("MjrunError | None", None)

    def note(self, place: int, seed: int, error: MjrunError) -> None:
        """Takes the error of an episode."""
        if place < self.place:
            error.add_note(f"in the episode of seed {seed}")
            self.place, self._error = place, error

    def throw(self) -> None:
        """Raises the error, if there is one."""
        if self._error:
            raise self._error


class TaskPlayer(EpisodePlayer):
    """Plays a task in worlds side by side: as soon as an episode ends, its world starts the next."""

    def __init__(self, task: Task, policy: Policy) -> None:
        self._task, self._policy = task, policy
        with task.located():
            check_agreement(task, policy)
            self._worlds = TaskWorlds(task, 1, threads=1)
        self._actions = ActionSpace(self._worlds.action_names, self._worlds.actions.low, self._worlds.actions.high)
        self._fitting = max(1, BYTES // max(1, self._worlds.world_bytes))
        self.rewards = self._worlds.reward_names
        self.endings = list(dict.fromkeys(ending.name for ending in self._worlds.endings))
        self.can_succeed = any(ending.kind == "success" for ending in self._worlds.endings)

    def play(self, seeds: Sequence[int]) -> list[Episode]:
        count = min(len(seeds), SIDE_BY_SIDE, self._fitting)
        if self._worlds.count < count:
            self._worlds = TaskWorlds(self._task, count, threads=1)
        with self._task.located():
            episodes = {episode.seed: episode for episode in self._played(seeds, count)}
        return [episodes[seed] for seed in seeds]

    def _played(self, seeds: Sequence[int], count: int) -> Iterator[Episode]:
        """The episodes, as they end, in `count` worlds.

        Raises:
          MjrunError: that of the first episode that fails, in the order of `seeds`.
        """
        worlds, control_dt = self._worlds, float(self._task.control_dt)
        waiting, failure = deque(range(len(seeds))), _FirstFailure()
        running: dict[int, _Running] = {}
        observations = np.empty((count, len(worlds.observed)))
        for world in range(count):
            self._begin_next(world, seeds, waiting, running, observations, failure)
        while running:
            self._act(running, observations, failure)
            for world in [world for world, episode in running.items() if episode.place >= failure.place]:
                del running[world]
            if not running:
                break
            ids = list(running)
            step = worlds.step(np.stack([running[world].action for world in ids]), ids)
            observations[ids] = step.observations
            for index, world in enumerate(ids):
                running[world].add(float(step.rewards[index]), step.reward_terms[index])
            for index in np.flatnonzero(step.over).tolist():
                world = ids[index]
                yield running.pop(world).ended(step.endings[step.codes[index]], self.rewards, control_dt)
                self._begin_next(world, seeds, waiting, running, observations, failure)
        failure.throw()

    def _begin_next(
        self,
        world: int,
        seeds: Sequence[int],
        waiting: deque[int],
        running: dict[int, _Running],
        observations: np.ndarray,
        failure: _FirstFailure,
    ) -> None:
        """Begins the next episode in a world, if one is waiting that counts."""
        while waiting and waiting[0] < failure.place:
            place = waiting.popleft()
            try:
                actor = self._policy.episode(seeds[place], self._actions)
                observations[world] = self._worlds.reset([seeds[place]], [world])[0]
            except MjrunError as error:
                failure.note(place, seeds[place], error)
            else:
                running[world] = _Running(place, seeds[place], actor, len(self.rewards))
                return

    def _act(self, running: Mapping[int, _Running], observations: np.ndarray, failure: _FirstFailure) -> None:
        """Asks the policy in each episode."""
        for world, episode in running.items():
            try:
                episode.action = episode.actor(observations[world])
                if not np.isfinite(episode.action).all():
                    step, time = episode.steps * self._worlds.control_steps, episode.steps * self._task.control_dt
                    raise _invalid(self._policy, self._actions, episode.action, step, float(time))
            except MjrunError as error:
                failure.note(episode.place, episode.seed, error)


class EnvironmentPlayer(EpisodePlayer):
    """Plays an environment of Gymnasium's, one episode after the other: it resets, steps and rewards itself.

    What never ends is cut short where its video would be.
    """

    def __init__(self, source: GymSource, policy: Policy) -> None:
        self._policy, self._environment = policy, Environment(source)
        environment = self._environment
        self._actions = ActionSpace(environment.action_names, environment.action_low, environment.action_high)
        self._periods = environment.episode_steps or math.ceil(UNLIMITED / environment.control_dt)
        environment.reset(0)
        self.rewards = environment.names(environment.step(np.zeros(len(self._actions.names)))).rewards
        self.endings = [TERMINATED, TIMED_OUT.name]
        self.can_succeed = False  # it does not say so before it happens

    def play(self, seeds: Sequence[int]) -> list[Episode]:
        episodes, failure = list[Episode](), _FirstFailure()
        for place, seed in enumerate(seeds):
            try:
                episodes.append(self._played(place, seed))
            except MjrunError as error:
                failure.note(place, seed, error)
                break
        failure.throw()
        return episodes

    def _played(self, place: int, seed: int) -> Episode:
        environment, control_dt = self._environment, float(self._environment.control_dt)
        episode = _Running(place, seed, self._policy.episode(seed, self._actions), len(self.rewards))
        observation = environment.reset(seed)
        while True:
            action = episode.actor(observation)
            if not np.isfinite(action).all():
                step, time = episode.steps * environment.control_steps, episode.steps * control_dt
                raise _invalid(self._policy, self._actions, action, step, time)
            result = environment.step(action)
            terms = [result.reward_terms.get(name, np.nan) for name in self.rewards]
            episode.add(result.reward, np.array(terms))
            ending = result.ending or (TIMED_OUT if episode.steps == self._periods else None)
            if ending:
                return episode.ended(ending, self.rewards, control_dt)
            observation = result.observation


class MeasuringPlayer(EpisodePlayer):
    """Plays episodes one after the other, step by step, and measures them: as `player` plays them, bit for bit.

    Raises:
      UsageError: a metric is not well formed, or names nothing.
    """

    def __init__(self, player: EpisodePlayer, spec: EpisodeSpec, policy: Policy) -> None:
        self._player, self._spec, self._policy = player, spec, policy
        self.rewards, self.endings, self.can_succeed = player.rewards, player.endings, player.can_succeed
        simulation = Simulation(spec.task, policy=policy)
        assert simulation.episode
        self._metrics = self._parsed(simulation.load(), simulation.episode.columns)
        names = dict.fromkeys(name for metric in self._metrics for name in metric.columns if name != "time")
        self._columns = [*names]

    def play(self, seeds: Sequence[int]) -> list[Episode]:
        return [self._played(seed) for seed in seeds]

    def _parsed(self, model: mujoco.MjModel, columns: EpisodeColumns) -> list[Metric]:
        available = AvailableProbes(model, columns.names)
        metrics: list[Metric] = []
        for name, text in self._spec.metrics:
            with concerning("metric", name):
                metrics.append(parse_metric(text, available, f"{option('metric')} {name}"))
        return metrics

    def _played(self, seed: int) -> Episode:
        """An episode with its metrics over the rows at all control instants, the end among them."""
        simulation = Simulation(self._spec.task, policy=self._policy, seed=seed)
        assert simulation.episode
        model = simulation.load()
        timeline = Timeline.of_steps(rational(model.opt.timestep), simulation.episode.longest)
        sampler = ProbeSampler(model, self._columns, timeline, simulation.episode.columns)
        evaluation = MetricEvaluation(self._metrics, [column.name for column in sampler.columns])
        try:
            with collected_warnings():  # which plain episodes do not tell of either
                episode = self._stepped(simulation, model, sampler, evaluation)
            return replace(episode, metrics=evaluation.values())
        except MjrunError as error:
            failure = error
        # An unstable simulation has no last instant. Any other error is that of the plain episode, if it has one.
        (episode,) = self._player.play([seed])
        if not isinstance(failure, SimulationError):
            raise failure
        return replace(episode, metrics=evaluation.values())

    def _stepped(
        self, simulation: Simulation, model: mujoco.MjModel, sampler: ProbeSampler, evaluation: MetricEvaluation
    ) -> Episode:
        """An episode without its metrics, whose rows `evaluation` gets."""
        stepper = simulation.stepper(model)
        assert isinstance(stepper, EpisodeStepper)
        assert simulation.episode
        period, longest = stepper.control_steps, simulation.episode.longest
        tally, ending = _Tally(simulation.seed, len(self.rewards)), None
        evaluation.feed(_row(sampler, stepper))
        while ending is None:
            stepper.advance(stepper.step + period)
            tally.add(stepper.now().reward, self._terms(stepper))
            evaluation.feed(_row(sampler, stepper))
            ending = stepper.now().ending or (TIMED_OUT if stepper.step >= longest else None)
        return tally.ended(ending, self.rewards, float(period * rational(model.opt.timestep)))

    def _terms(self, stepper: EpisodeStepper) -> np.ndarray:
        """The terms of the reward of the last control period, in the order of `rewards`."""
        terms = dict(zip(stepper.names.rewards, stepper.now().reward_terms, strict=True))
        return np.array([terms.get(name, np.nan) for name in self.rewards])


def _row(sampler: ProbeSampler, stepper: EpisodeStepper) -> np.ndarray:
    return sampler.stack([stepper.step], [sampler.read(stepper)]).values


def _invalid(policy: Policy, actions: ActionSpace, action: np.ndarray, step: int, time: float) -> InvalidActionError:
    values = {name: float(value) for name, value in zip(actions.names, action, strict=True) if not np.isfinite(value)}
    return InvalidActionError(step, time, policy.name, values)
