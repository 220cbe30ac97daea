"""Minari datasets, loaded by Minari."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import FileError, UsageError
from mjrun.formats.episodes.minari import check, dataset_id
from tests.formats.episodes.made_episodes import LAYOUT, NUMBERS, episode, episodes, written


def test_minari_loads_every_number(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import minari

    written("minari", tmp_path / "arm-v3", NUMBERS, episodes(range(3)))
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    dataset = minari.load_dataset("arm-v3")
    assert (dataset.total_episodes, dataset.total_steps) == (3, 39)
    assert (dataset.action_space.low.tolist(), dataset.action_space.high.tolist()) == ([-1], [np.inf])
    for found, made in zip(dataset.iterate_episodes(), episodes(range(3)), strict=True):
        np.testing.assert_array_equal(found.observations, made.observations)
        np.testing.assert_array_equal(found.actions, made.actions)
        np.testing.assert_array_equal(found.rewards, made.rewards)
        np.testing.assert_array_equal(found.infos["qpos"], made.infos["qpos"])
        assert (found.terminations[-1], found.truncations[-1]) == (made.terminated, made.truncated)
        assert not found.terminations[:-1].any()
        assert found.infos["success"][-1] == made.success
        assert dataset.observation_space.contains(found.observations[0])
    assert [each["seed"] for each in dataset.storage.get_episode_metadata(range(3))] == [0, 1, 2]


def test_a_continued_dataset_holds_the_same_episodes(tmp_path: Path) -> None:
    import minari

    folder = tmp_path / "arm"
    written("minari", folder, NUMBERS, episodes(range(2)))
    written("minari", folder, NUMBERS, episodes([2]), 2)
    rewards = [found.rewards.tolist() for found in minari.MinariDataset(folder / "data").iterate_episodes()]
    assert rewards == [episode(seed).rewards.tolist() for seed in range(3)]
    (folder / "data/main_data.hdf5").write_bytes(b"\x89HDF")
    with pytest.raises(FileError, match="damaged"):
        written("minari", folder, NUMBERS, episodes([3]), 3)


def test_the_same_episodes_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        written("minari", tmp_path / name, NUMBERS, episodes(range(2)))
    assert (tmp_path / "a/data/main_data.hdf5").read_bytes() == (tmp_path / "b/data/main_data.hdf5").read_bytes()


@pytest.mark.parametrize(
    ("folder", "name"),
    [("walker-v2", "walker-v2"), ("walker", "walker-v0"), ("a b/ü ö", "___-v0"), ("---", "dataset-v0")],
)
def test_the_folder_names_the_dataset(folder: str, name: str) -> None:
    assert dataset_id(Path(folder)) == name


def test_unsupported_layouts_are_refused() -> None:
    check(NUMBERS)
    for layout, message in ((LAYOUT, "no images"), (replace(NUMBERS, has_rewards=False), "with rewards")):
        with pytest.raises(UsageError, match=message):
            check(layout)
    with pytest.raises(UsageError, match="requires observations"):
        check(replace(NUMBERS, observations=[]))
