"""A vector of worlds is what Gymnasium's SyncVectorEnv makes of single ones, to the bit, in every autoreset mode."""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import mjrun.gym
from tests.gym.tasks import write_cart

COUNT = 5


def assert_same(ours: dict[str, Any], theirs: dict[str, Any]) -> None:
    """Compares infos where both say that there is something."""
    names = [name for name in theirs if not name.startswith("_")]
    assert {name for name in ours if not name.startswith("_")} == set(names)
    for name in names:
        if isinstance(theirs[name], dict):
            assert_same(ours[name], theirs[name])
            continue
        there = theirs[f"_{name}"]
        np.testing.assert_array_equal(ours[f"_{name}"], there)
        for ours_, theirs_ in zip(ours[name][there], theirs[name][there], strict=True):
            np.testing.assert_equal(ours_, theirs_)


@pytest.mark.parametrize("mode", AutoresetMode)
def test_it_is_gymnasiums_own_vector_of_environments(tmp_path: Path, mode: AutoresetMode) -> None:
    task = write_cart(tmp_path)
    ours = mjrun.gym.make_vec(task, COUNT, autoreset_mode=mode)
    theirs = SyncVectorEnv([lambda: mjrun.gym.TaskEnv(task)] * COUNT, autoreset_mode=mode)
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    assert ours.metadata["autoreset_mode"] == mode
    np.testing.assert_array_equal(ours.reset(seed=11)[0], theirs.reset(seed=11)[0])

    theirs.action_space.seed(0)
    ended: set[str] = set()
    for _ in range(40):
        actions = theirs.action_space.sample()
        observations, rewards, terminated, truncated, infos = ours.step(actions)
        expected = theirs.step(actions)
        for value, other in zip((observations, rewards, terminated, truncated), expected[:4], strict=True):
            np.testing.assert_array_equal(value, other)
        assert_same(infos, expected[4])
        told = infos.get("final_info", infos)
        ended |= {name for name in told.get("ending", ()) if name}
        over = terminated | truncated
        if mode == AutoresetMode.DISABLED and over.any():
            with pytest.raises(ValueError, match="reset_mask"):
                ours.step(actions)
            again = ours.reset(options={"reset_mask": over.copy()})[0]
            np.testing.assert_array_equal(again, theirs.reset(options={"reset_mask": over.copy()})[0])
    assert ended == {"fallen", "there", "timeout"}


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
