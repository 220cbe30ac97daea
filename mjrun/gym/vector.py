"""Many episodes of a task at once, as a Gymnasium vector environment, stepped in C on all cores."""

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from mjrun.gym.environment import TaskLike, action_space, draw_seed, ending_info, observation_space, task_of
from mjrun.task.expressions import RUNNING
from mjrun.task.worlds import TaskStep, TaskWorlds, action_array

MASK = "reset_mask"


class TaskVectorEnv(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """`num_envs` worlds of a task, bit for bit those of Gymnasium's SyncVectorEnv with `TaskEnv`, but faster.

    Args:
      task: a task, or the file of its document.
      num_envs: the number of worlds.
      autoreset_mode: when a finished world begins its next episode: at the next step, Gymnasium's default, ignoring the
        action; within the same step, with `final_obs` and `final_info` in the infos; or by
        `reset(options={"reset_mask": …})` alone.
      threads: one for each core when 0.

    `reset(seed=S)` gives world i the seed S + i; a list gives a seed to each. The infos of a step contain the weighted
    terms of the reward, `reward/NAME` `(num_envs,)`, and for worlds whose episode has ended `ending` and `is_success`.
    """

    def __init__(
        self,
        task: TaskLike,
        num_envs: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int = 0,
    ) -> None:
        self.task = task_of(task)
        self.num_envs = num_envs
        self.worlds = TaskWorlds(self.task.with_absolute_paths(), num_envs, threads)
        self.single_observation_space = observation_space(self.worlds)
        self.single_action_space = action_space(self.worlds)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {"autoreset_mode": self.autoreset_mode, "render_modes": []}
        self._generators: list[np.random.Generator | None] = [None] * num_envs
        self._over = np.zeros(num_envs, bool)
        self._all = np.arange(num_envs)
        self._rewards = [f"reward/{name}" for name in self.worlds.reward_names]
        self._masks = [f"_{name}" for name in self._rewards]
        self._skips_ended = self.autoreset_mode == AutoresetMode.SAME_STEP

    def reset(  # type: ignore[override]
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begins an episode in every world, or in those of the option `reset_mask` `(num_envs,)` bool."""
        seeds = self._seeds(seed)
        mask = self._mask(options or {})
        worlds = self._all if mask is None else np.flatnonzero(mask)
        for world in worlds.tolist():
            if seeds[world] is not None:
                self._generators[world] = seeding.np_random(seeds[world])[0]
        given = [self._draw(world) if seeds[world] is None else seeds[world] for world in worlds.tolist()]
        self.worlds.reset([int(each or 0) for each in given], worlds)
        self._over[worlds] = False
        return self.worlds.observations, {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Steps every world by a control period; see `VectorEnv`."""
        if self._over.any():
            if self.autoreset_mode == AutoresetMode.DISABLED:
                raise ValueError("an episode is over: reset its world with the option reset_mask")
            return self._step_after_end(action_array(actions, (self.num_envs, len(self.worlds.action_names))))
        step = self.worlds.step(actions)
        terms, over = step.reward_terms.T, step.over
        if not over.any():
            infos = self._terms(terms, None)
        elif self._skips_ended:
            infos = {} if over.all() else self._terms(terms, ~over)
            infos |= self._begin_next(step, over)  # Gymnasium reports these worlds in `final_info` alone
        else:
            self._over = over
            infos = self._terms(terms, None) | self._endings(step.codes)
        return step.observations, step.rewards, step.terminated, step.truncated, infos

    def _step_after_end(
        self, actions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Takes a step in which some worlds begin their next episode instead."""
        begin, running = np.flatnonzero(self._over), np.flatnonzero(~self._over)
        rewards, (terminated, truncated) = np.zeros(self.num_envs), np.zeros((2, self.num_envs), bool)
        self.worlds.reset([self._draw(world) for world in begin.tolist()], begin)
        infos: dict[str, Any] = {}
        if len(running):
            step = self.worlds.step(actions[running], running)
            rewards[running] = step.rewards
            terminated[running], truncated[running] = step.terminated, step.truncated
            terms, codes = np.zeros((len(self._rewards), self.num_envs)), np.full(self.num_envs, RUNNING)
            terms[:, running], codes[running] = step.reward_terms.T, step.codes
            infos = self._terms(terms, ~self._over) | self._endings(codes)
        self._over = terminated | truncated
        return self.worlds.observations, rewards, terminated, truncated, infos

    def _begin_next(self, step: TaskStep, over: np.ndarray) -> dict[str, Any]:
        """Begins the next episode in the worlds of a mask, whose last one ended in this step; returns their infos."""
        ended, final = np.flatnonzero(over), np.full(self.num_envs, None, object)
        for world in ended.tolist():
            final[world] = step.observations[world].copy()
        final_info = self._terms(step.reward_terms.T, over) | self._endings(step.codes)
        step.observations[ended] = self.worlds.reset([self._draw(world) for world in ended.tolist()], ended)
        return {"final_obs": final, "_final_obs": over, "final_info": final_info, "_final_info": over.copy()}

    def _terms(self, terms: np.ndarray, worlds: np.ndarray | None) -> dict[str, Any]:
        """Returns the terms of the reward `(nterms, num_envs)` as infos of the worlds of a mask, or of all."""
        masks = np.ones(terms.shape, bool)
        if worlds is not None:
            masks[:], terms = worlds, np.where(worlds, terms, 0.0)
        infos = dict[str, Any](zip(self._rewards, terms, strict=True))
        infos |= zip(self._masks, masks, strict=True)
        return infos

    def _endings(self, codes: np.ndarray) -> dict[str, Any]:
        """Returns the infos of the worlds whose episode has ended with a code `(num_envs,)`."""
        over = codes != RUNNING
        ended = np.flatnonzero(over)
        if not len(ended):
            return {}
        names, success = np.full(self.num_envs, None, object), np.zeros(self.num_envs, bool)
        for world in ended.tolist():
            info = ending_info(self.worlds.endings[int(codes[world])])
            names[world], success[world] = info["ending"], info["is_success"]
        return {"ending": names, "_ending": over, "is_success": success, "_is_success": over.copy()}

    def _seeds(self, seed: int | Sequence[int | None] | None) -> Sequence[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, int | np.integer):
            return [int(seed) + world for world in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise ValueError(f"{len(seed)} seeds for {self.num_envs} worlds")
        return seed

    def _mask(self, options: dict[str, Any]) -> np.ndarray | None:
        """Returns the mask of worlds to be reset; None for all."""
        if MASK not in options:
            return None
        mask = cast("np.ndarray | None", options[MASK])
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (self.num_envs,):
            raise ValueError(f"{MASK} must be an array of bool of shape ({self.num_envs},)")
        if not mask.any():
            raise ValueError(f"{MASK} selects no world")
        return mask

    def _draw(self, world: int) -> int:
        """Draws the seed of the next episode of a world."""
        generator = self._generators[world] or seeding.np_random(None)[0]
        self._generators[world] = generator
        return draw_seed(generator)


def make_vec(task: TaskLike, num_envs: int = 1, **options: Any) -> TaskVectorEnv:
    """Creates `num_envs` worlds of a task as a vector environment.

    Args:
      task: a task, or the file of its document.
      options: options of `TaskVectorEnv`.

    Raises:
      UsageError: the task does not fit its model.
      DocumentError: the document is invalid; it lists every problem.
    """
    return TaskVectorEnv(task, num_envs, **options)
