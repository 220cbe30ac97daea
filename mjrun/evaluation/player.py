"""Plays episodes: a policy on a task in many worlds side by side, or in an environment of somebody else's."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence

import numpy as np

from mjrun.errors import InvalidActionError
from mjrun.evaluation.episode import Episode, EpisodeSpec
from mjrun.job.episode import UNLIMITED
from mjrun.model.source import Source
from mjrun.model.sources.gym import GymSource
from mjrun.model.variants import BYTES
from mjrun.policy.agreement import check_agreement
from mjrun.policy.load import load_policy
from mjrun.policy.policy import ActionSpace, Actor, Policy
from mjrun.task.episode import Ending
from mjrun.task.gymnasium import Environment
from mjrun.task.task import Task
from mjrun.task.terms import TIMED_OUT
from mjrun.task.worlds import TaskWorlds

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
          MjrunError: the policy fails.
        """


def player_of(spec: EpisodeSpec) -> EpisodePlayer:
    """What plays the episodes of `spec`, with its policy loaded, and all that must fit checked.

    Raises:
      UsageError: what is to be played is no task, or the policy does not fit it.
      FileError: the policy cannot be read.
      ModelError: the model cannot be had.
    """
    chosen = spec.chosen
    policy = load_policy(chosen.policy, trust=chosen.trust, normalize=chosen.normalize)
    player = _plain_player(spec.task, policy)
    if not spec.metrics:
        return player
    from mjrun.evaluation.measurement import MeasuringPlayer

    return MeasuringPlayer(player, spec, policy)


def _plain_player(task: Source, policy: Policy) -> EpisodePlayer:
    if isinstance(task, GymSource):
        return EnvironmentPlayer(task, policy)
    if isinstance(task, Task):
        return TaskPlayer(task, policy)
    from mjrun.policy.task_of_policy import task_of_policy

    return TaskPlayer(task_of_policy(policy, task), policy)


class _Running:
    """An episode that is being played.

    Attributes:
      steps: control periods so far.
    """

    def __init__(self, seed: int, actor: Actor, terms: int) -> None:
        self.seed, self.actor, self.steps = seed, actor, 0
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
        """The episodes, as they end, in `count` worlds."""
        waiting, control_dt = list(seeds[count:]), float(self._task.control_dt)
        running = {world: self._begun(seed) for world, seed in enumerate(seeds[:count])}
        ids = list(running)
        observations = self._worlds.reset(seeds[:count], ids)
        while ids:
            actions = np.stack([self._action(running[world], observations[i]) for i, world in enumerate(ids)])
            step = self._worlds.step(actions, ids)
            observations = step.observations
            for index, world in enumerate(ids):
                running[world].add(float(step.rewards[index]), step.reward_terms[index])
            if not step.over.any():
                continue

            observations = observations.copy()
            goes_on = np.ones(len(ids), bool)
            for index, ending in enumerate(step.ended):
                if ending is None:
                    continue
                world = ids[index]
                yield running.pop(world).ended(ending, self.rewards, control_dt)
                if waiting:
                    seed = waiting.pop(0)
                    running[world] = self._begun(seed)
                    observations[index] = self._worlds.reset([seed], [world])[0]
                else:
                    goes_on[index] = False
            ids = [world for world, more in zip(ids, goes_on, strict=True) if more]
            observations = observations[goes_on]

    def _begun(self, seed: int) -> _Running:
        return _Running(seed, self._policy.episode(seed, self._actions), len(self.rewards))

    def _action(self, episode: _Running, observation: np.ndarray) -> np.ndarray:
        action = episode.actor.act(observation)
        if not np.isfinite(action).all():
            step = episode.steps * self._worlds.control_steps
            time = episode.steps * float(self._task.control_dt)
            raise _invalid(self._policy, self._actions, action, episode.seed, step, time)
        return action


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
        return [self._played(seed) for seed in seeds]

    def _played(self, seed: int) -> Episode:
        environment, control_dt = self._environment, float(self._environment.control_dt)
        episode = _Running(seed, self._policy.episode(seed, self._actions), len(self.rewards))
        observation = environment.reset(seed)
        while True:
            action = episode.actor.act(observation)
            if not np.isfinite(action).all():
                step, time = episode.steps * environment.control_steps, episode.steps * control_dt
                raise _invalid(self._policy, self._actions, action, seed, step, time)
            result = environment.step(action)
            terms = [result.reward_terms.get(name, np.nan) for name in self.rewards]
            episode.add(result.reward, np.array(terms))
            ending = result.ending or (TIMED_OUT if episode.steps == self._periods else None)
            if ending:
                return episode.ended(ending, self.rewards, control_dt)
            observation = result.observation


def _invalid(
    policy: Policy, actions: ActionSpace, action: np.ndarray, seed: int, step: int, time: float
) -> InvalidActionError:
    values = {name: float(value) for name, value in zip(actions.names, action, strict=True) if not np.isfinite(value)}
    error = InvalidActionError(step, time, policy.name, values)
    error.add_note(f"in the episode of seed {seed}")
    return error
