"""Worlds of a task as a vector environment of rsl_rl, which is imported with this module, as is torch."""

# pyright: basic
# since the library, which defines the base class, is optional

from typing import Any

import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from gymnasium.vector import AutoresetMode
from rsl_rl.env import VecEnv  # pyright: ignore[reportMissingImports]
from tensordict import TensorDict  # pyright: ignore[reportMissingImports]

from mjrun.gym.environments import TaskLike, TaskVectorEnv


class TaskVecEnv(VecEnv):
    """`num_envs` worlds of a task, whose numbers are those of `make_vec`, as tensors.

    Args:
      task: a task, or the file of its document.
      num_envs: the number of worlds.
      seed: world i begins with the episode of seed + i.
      device: device of the tensors; the worlds are stepped on the cores of this machine.
      threads: one for each core when 0.

    Attributes:
      num_actions: numbers of an action.
      max_episode_length: control periods of an episode.
      episode_length_buf: control periods of each episode so far `(num_envs,)`; changing them does not change episodes.
      cfg: settings of the task, for the runner's files.
    """

    def __init__(self, task: TaskLike, num_envs: int = 1, seed: int = 0, device: str = "cpu", threads: int = 0) -> None:
        self._worlds = worlds = TaskVectorEnv(task, num_envs, AutoresetMode.SAME_STEP, threads)
        self.num_envs, self.device = num_envs, device
        self.num_actions = len(worlds.worlds.action_names)
        self.max_episode_length = worlds.task.periods
        self.episode_length_buf = torch.zeros(num_envs, dtype=torch.long, device=device)
        self.cfg = {"task": worlds.task.text, "seed": seed}
        self._observations = worlds.reset(seed=seed)[0]

    def get_observations(self) -> TensorDict:
        """Returns the observations `(num_envs, nobs)` float32 as the group `policy`."""
        return TensorDict({"policy": self._tensor(self._observations)}, batch_size=[self.num_envs], device=self.device)

    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, Any]]:
        """Steps every world by a control period; where the episode ends, the next one begins.

        Returns:
          Observations, rewards `(num_envs,)`, the worlds whose episode has ended as 0 or 1, and extras: `time_outs`,
          those that the time limit ended, and in `log` the mean of each term of the reward over all worlds.
        """
        result = self._worlds.step(actions.detach().cpu().numpy().astype(float))
        self._observations, rewards, terminated, truncated, infos = result
        over = torch.as_tensor(terminated | truncated, device=self.device)
        self.episode_length_buf = torch.where(over, 0, self.episode_length_buf + 1)
        terms = {f"/reward/{name}": self._mean(f"reward/{name}", infos) for name in self._worlds.worlds.reward_names}
        extras = {"time_outs": torch.as_tensor(truncated & ~terminated, device=self.device), "log": terms}
        return self.get_observations(), self._tensor(rewards), over.long(), extras

    def _mean(self, name: str, infos: dict[str, Any]) -> float:
        """Returns the mean of a term over all worlds; `final_info` has it where the episode ended."""
        parts = [part[name] for part in (infos, infos.get("final_info", {})) if name in part]
        return float(sum(part.sum() for part in parts) / self.num_envs)

    def _tensor(self, values: np.ndarray) -> torch.Tensor:
        return torch.as_tensor(values, dtype=torch.float32, device=self.device)
