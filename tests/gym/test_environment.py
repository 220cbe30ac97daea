"""A task is an environment that Gymnasium's checker accepts, with the numbers of its worlds."""

import subprocess
import sys
import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import mjrun.gym
from mjrun.task.worlds import TaskWorlds
from tests.gym.tasks import write_cart


def test_gymnasiums_checker_accepts_a_task(tmp_path: Path) -> None:
    env = mjrun.gym.make(str(write_cart(tmp_path)))
    with warnings.catch_warnings(action="ignore"):  # of infinite observations, as its own environments have
        check_env(env.unwrapped, skip_render_check=True)


def test_it_is_registered_and_has_the_numbers_of_worlds(tmp_path: Path) -> None:
    task = write_cart(tmp_path)
    env = gymnasium.make("mjrun.gym:mjrun/Task-v0", task=task, disable_env_checker=True)
    assert isinstance(env.unwrapped, mjrun.gym.TaskEnv)
    worlds = TaskWorlds(env.unwrapped.task, 1)
    for seed in (3, 4, 5):
        observation, info = env.reset(seed=seed)
        np.testing.assert_array_equal(observation, worlds.reset([seed])[0])
        assert info == {}
        step, terminated, truncated = None, False, False
        while not (terminated or truncated):
            action = env.action_space.sample()
            observation, reward, terminated, truncated, info = env.step(action)
            step = worlds.step(action[None].astype(float))
            np.testing.assert_array_equal(observation, step.observations[0])
            assert reward == step.rewards[0]
            assert info["reward/near"] + info["reward/effort"] == reward
        assert step
        ending = step.ended[0]
        assert ending
        assert (info["ending"], terminated) == (ending.name, ending.terminated)
        assert info["is_success"] == (ending.name == "there")


def test_episodes_without_a_seed_go_on_from_the_last_one(tmp_path: Path) -> None:
    env = mjrun.gym.make(write_cart(tmp_path))
    series = []
    for _ in range(2):
        env.reset(seed=8)
        series.append([env.reset()[0] for _ in range(3)])
    np.testing.assert_array_equal(*series)
    assert (series[0][0][:2] != series[0][1][:2]).all()


@pytest.mark.gl
def test_it_draws_what_it_shows(tmp_path: Path) -> None:
    env = mjrun.gym.make(write_cart(tmp_path), render_mode="rgb_array", width=64, height=48)
    env.reset(seed=1)
    image = env.render()
    assert isinstance(image, np.ndarray)
    assert image.shape == (48, 64, 3)
    assert image.std() > 1
    with pytest.raises(ValueError, match="rgb_array or None"):
        mjrun.gym.TaskEnv(write_cart(tmp_path), render_mode="human")


def test_without_gymnasium_it_says_what_to_install() -> None:
    code = "import sys; sys.modules['gymnasium'] = None\nimport mjrun.gym"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 1
    assert "MissingExtraError: mjrun.gym needs gymnasium" in done.stderr
    assert "pip install 'mjrun[gym]'" in done.stderr
