"""Worlds of a task as rsl_rl receives them, against `make_vec`; skipped where rsl_rl is absent."""

from pathlib import Path

import numpy as np
import pytest

import mjrun.gym
from tests.gym.tasks import write_cart

rsl_rl_env = pytest.importorskip("rsl_rl.env")


def test_its_tensors_are_the_numbers_of_the_vector_environment(tmp_path: Path) -> None:
    import torch  # pyright: ignore[reportMissingImports]

    from mjrun.gym.rsl_rl import TaskVecEnv

    task = write_cart(tmp_path)
    ours, plain = TaskVecEnv(task, 3, seed=2), mjrun.gym.make_vec(task, 3, autoreset_mode="SameStep")
    observations = plain.reset(seed=2)[0]
    lengths = np.zeros(3, int)
    assert isinstance(ours, rsl_rl_env.VecEnv)
    for _ in range(60):
        np.testing.assert_array_equal(ours.get_observations()["policy"], observations.astype(np.float32))
        actions = plain.action_space.sample()
        got, rewards, dones, extras = ours.step(torch.as_tensor(actions))
        observations, expected, terminated, truncated, _ = plain.step(actions)
        np.testing.assert_array_equal(got["policy"], observations.astype(np.float32))
        np.testing.assert_array_equal(rewards, expected.astype(np.float32))
        np.testing.assert_array_equal(dones, terminated | truncated)
        np.testing.assert_array_equal(extras["time_outs"], truncated & ~terminated)
        lengths = np.where(terminated | truncated, 0, lengths + 1)
        np.testing.assert_array_equal(ours.episode_length_buf, lengths)
    assert ours.num_actions == len(plain.worlds.action_names)
    assert ours.max_episode_length == plain.task.periods
