"""A vector of worlds is what Gymnasium's SyncVectorEnv makes of single ones, to the bit, in every autoreset mode."""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from hypothesis import example, given, settings
from hypothesis import strategies as st

import mjrun.gym
from tests.gym.tasks import write_cart


@pytest.fixture(scope="module")
def task(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_cart(tmp_path_factory.mktemp("cart"))


def assert_same(ours: dict[str, Any], theirs: dict[str, Any]) -> None:
    """Compares infos: every key, mask and number, also of worlds that a mask leaves out."""
    assert ours.keys() == theirs.keys()
    for name, values in theirs.items():
        if isinstance(values, dict):
            assert_same(ours[name], values)
            continue
        assert (ours[name].dtype, ours[name].shape) == (values.dtype, values.shape), name
        for value, expected in zip(ours[name], values, strict=True):
            np.testing.assert_equal(value, expected, name)


@pytest.mark.slow
@settings(max_examples=6, deadline=None)
@given(
    mode=st.sampled_from(AutoresetMode),
    count=st.integers(1, 4),
    seed=st.integers(0, 2**31 - 10),
    step_count=st.integers(1, 25),
)
@example(mode=AutoresetMode.SAME_STEP, count=3, seed=11, step_count=40)
@example(mode=AutoresetMode.NEXT_STEP, count=3, seed=11, step_count=40)
@example(mode=AutoresetMode.DISABLED, count=3, seed=11, step_count=40)
def test_it_is_gymnasiums_own_vector_of_environments(
    task: Path, mode: AutoresetMode, count: int, seed: int, step_count: int
) -> None:
    ours = mjrun.gym.make_vec(task, count, autoreset_mode=mode)
    theirs = SyncVectorEnv([lambda: mjrun.gym.TaskEnv(task)] * count, autoreset_mode=mode)
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    assert ours.metadata["autoreset_mode"] == mode
    np.testing.assert_array_equal(ours.reset(seed=seed)[0], theirs.reset(seed=seed)[0])

    theirs.action_space.seed(seed)
    for _ in range(step_count):
        actions = theirs.action_space.sample()
        observations, rewards, terminated, truncated, infos = ours.step(actions)
        expected = theirs.step(actions)
        for value, other in zip((observations, rewards, terminated, truncated), expected[:4], strict=True):
            np.testing.assert_array_equal(value, other)
        assert_same(infos, expected[4])
        over = terminated | truncated
        if mode == AutoresetMode.DISABLED and over.any():
            with pytest.raises(ValueError, match="reset_mask"):
                ours.step(actions)
            again = ours.reset(options={"reset_mask": over.copy()})[0]
            np.testing.assert_array_equal(again, theirs.reset(options={"reset_mask": over.copy()})[0])


def test_episodes_end_in_every_way_there_is(task: Path) -> None:
    worlds = mjrun.gym.make_vec(task, 5)
    worlds.reset(seed=11)
    worlds.action_space.seed(0)
    endings: set[str] = set()
    for _ in range(40):
        infos = worlds.step(worlds.action_space.sample())[4]
        endings |= {*infos.get("ending", ())} - {None}
    assert endings == {"fallen", "there", "timeout"}


def test_gymnasium_makes_it_by_its_name(tmp_path: Path) -> None:
    task = str(write_cart(tmp_path))
    made = gymnasium.make_vec("mjrun/Task-v0", 3, vectorization_mode="vector_entry_point", task=task)
    assert isinstance(made.unwrapped, mjrun.gym.TaskVectorEnv)
    observations, _ = made.reset(seed=[4, 5, 6])  # type: ignore[arg-type]
    np.testing.assert_array_equal(observations, mjrun.gym.make_vec(task, 3).reset(seed=4)[0])


def test_masks_and_seeds_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    made = mjrun.gym.make_vec(write_cart(tmp_path), 2)
    for mask in (np.array([True]), [True, False], np.array([False, False])):
        with pytest.raises(ValueError, match="reset_mask"):
            made.reset(options={"reset_mask": mask})
    with pytest.raises(ValueError, match="3 seeds"):
        made.reset(seed=[1, 2, 3])
