"""Worlds of a task as a vector environment of Stable-Baselines3, which is imported with this module."""

# pyright: basic
# since the library, which defines the base class, is optional

from collections.abc import Iterable
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv  # pyright: ignore[reportMissingImports]

from mjrun.gym.environments import TaskLike, TaskVectorEnv

Indices = int | Iterable[int] | None


class TaskVecEnv(VecEnv):
    """`num_envs` worlds of a task, bit for bit those of Stable-Baselines3's DummyVecEnv with `TaskEnv`, but faster.

    Args:
      task: a task, or the file of its document.
      num_envs: the number of worlds.
      threads: one for each core when 0.

    After `seed(S)`, the next `reset()` gives world i the seed S + i. The info of each world is that of `TaskEnv`, with
    `TimeLimit.truncated`, and with `terminal_observation` if its episode has ended. `VecMonitor` adds returns.
    """

    def __init__(self, task: TaskLike, num_envs: int = 1, threads: int = 0) -> None:
        self._worlds = worlds = TaskVectorEnv(task, num_envs, AutoresetMode.SAME_STEP, threads)
        self._actions = np.zeros(worlds.action_space.shape or ())
        super().__init__(num_envs, worlds.single_observation_space, worlds.single_action_space)

    def reset(self) -> np.ndarray:
        """Begins an episode in every world; returns the observations `(num_envs, nobs)`."""
        observations, _ = self._worlds.reset(seed=self._seeds)
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        """Takes the actions `(num_envs, nact)` of the next `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Steps every world by a control period.

        Returns:
          Observations, rewards as float32, the worlds whose episode has ended, and the info of each world.
        """
        observations, rewards, terminated, truncated, infos = self._worlds.step(self._actions)
        over = terminated | truncated
        each = self._info_of_each(infos)
        if over.any():
            ends = self._info_of_each(infos["final_info"])
            for world in np.flatnonzero(over).tolist():
                each[world] = {**ends[world], "terminal_observation": infos["final_obs"][world]}
        for info, is_truncated in zip(each, (truncated & ~terminated).tolist(), strict=True):
            info["TimeLimit.truncated"] = is_truncated
        return observations, rewards.astype(np.float32), over, each

    def close(self) -> None:
        """Does nothing: the worlds hold no files or processes."""

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """Returns an attribute of the worlds, such as `task`, for each of `indices`.

        Raises:
          AttributeError: they have no such attribute.
        """
        return [getattr(self._worlds, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        """Refuses to change a world.

        Raises:
          NotImplementedError: always.
        """
        raise NotImplementedError(f"worlds of a task share {attr_name}; create them from another task")

    def env_method(self, method_name: str, *method_args: Any, indices: Indices = None, **method_kwargs: Any) -> Any:
        """Refuses to call a method of a world.

        Raises:
          NotImplementedError: always.
        """
        raise NotImplementedError(f"worlds of a task are no environments that have {method_name}")

    def env_is_wrapped(self, wrapper_class: type[object], indices: Indices = None) -> list[bool]:
        """Returns False for each of `indices`."""
        return [False for _ in self._get_indices(indices)]

    def _info_of_each(self, infos: dict[str, Any]) -> list[dict[str, Any]]:
        """Splits infos of all worlds, arrays with masks, into one for each world."""
        each: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for name, values in infos.items():
            if not isinstance(values, np.ndarray) or f"_{name}" not in infos or name == "final_obs":
                continue
            for world in np.flatnonzero(infos[f"_{name}"]).tolist():
                each[world][name] = values.item(world)
        return each
