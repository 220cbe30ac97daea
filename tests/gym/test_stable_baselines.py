"""Worlds of a task against Stable-Baselines3's own vector of single environments; skipped where it is absent."""

from pathlib import Path

import numpy as np
import pytest

import mjrun.gym
from tests.gym.tasks import write_cart

vec_env = pytest.importorskip("stable_baselines3.common.vec_env")


def test_it_is_their_vector_of_single_environments(tmp_path: Path) -> None:
    from mjrun.gym.stable_baselines import TaskVecEnv

    task = write_cart(tmp_path)
    ours, theirs = TaskVecEnv(task, 3), vec_env.DummyVecEnv([lambda: mjrun.gym.TaskEnv(task)] * 3)
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    assert ours.seed(5) == theirs.seed(5)
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    ended = 0
    for _ in range(60):
        actions = np.stack([ours.action_space.sample() for _ in range(3)])
        for our, their in zip(ours.step(actions)[:3], theirs.step(actions)[:3], strict=True):
            np.testing.assert_array_equal(our, their)
            assert our.dtype == their.dtype
        infos = zip(ours.step(actions)[3], theirs.step(actions)[3], strict=True)
        for our, their in infos:
            terminal = [info.pop("terminal_observation", None) for info in (our, their)]
            np.testing.assert_equal(*terminal)
            assert our == their
            ended += terminal[0] is not None
    assert ended
    assert vec_env.VecMonitor(ours).reset().shape == (3, *ours.observation_space.shape)
    assert ours.env_is_wrapped(object) == [False] * 3
    with pytest.raises(NotImplementedError):
        ours.env_method("render")
