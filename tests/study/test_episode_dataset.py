"""Datasets of episodes: those of mjrun eval, the same bytes after any interruption, and none of another policy."""

import json
from collections import Counter
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas
import pytest

import mjrun
import mjrun.gym
from mjrun.errors import FailedEpisodesError, FileError, MjrunWarning, UsageError
from mjrun.formats.temporary_output import TemporaryOutput, unused_name
from mjrun.policy.load import load_policy
from mjrun.policy.policy import ActionSpace
from mjrun.reporter import PythonApiReporter
from mjrun.study.dataset_specs import camera_keys
from mjrun.study.episode_dataset import EpisodeDataset, EpisodeDatasetResult
from mjrun.study.prepared import PreparedStudy
from mjrun.task.task import Reward, Task
from tests.evaluation.tasks import XML, cart_task, write_policies

SEEDS = [3, 4, 5]
WILD = """
class Wild:
    def reset(self, seed):
        self.seed, self.calls = seed, 0

    def act(self, observation):
        import numpy as np
        self.calls += 1
        return np.array([9e9 if self.seed == 4 and self.calls > 4 else np.nan if self.seed == 5 else 0.1])
"""


@pytest.fixture
def task(tmp_path: Path) -> Task:
    return cart_task(tmp_path)


@pytest.fixture
def policy(tmp_path: Path) -> str:
    return f"{write_policies(tmp_path)}:act"


@pytest.fixture
def simulation(task: Task, policy: str) -> mjrun.Simulation:
    return mjrun.Simulation(task, policy=policy, seed=3)


def made(simulation: mjrun.Simulation, folder: Path, **options: Any) -> EpisodeDatasetResult:
    defaults: dict[str, Any] = {"episodes": 3, "jobs": 1, "size": (64, 48), "quality": "draft", "stage": "none"}
    return EpisodeDataset(simulation, str(folder), **defaults | options).run(PythonApiReporter())


def contents(folder: Path) -> dict[str, bytes]:
    """Returns the files of a dataset, without those about the runs that made it."""
    paths = [path.relative_to(folder) for path in folder.rglob("*") if path.is_file()]
    return {str(path): (folder / path).read_bytes() for path in paths if not str(path).startswith("mjrun/parts")}


def table(folder: Path, episode: int | None = None) -> dict[str, np.ndarray]:
    """Returns the columns of the first data file, or of an episode in it."""
    data = pandas.read_parquet(folder / "data/chunk-000/file-000.parquet")
    chosen = data if episode is None else data[data["episode_index"] == episode]
    return {name: np.array(chosen[name].tolist()) for name in chosen.columns}


def frames(path: Path) -> np.ndarray:
    import av

    with av.open(str(path)) as container:
        return np.array([frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)])


def test_a_policy_with_a_memory_that_episodes_would_share_is_reported(tmp_path: Path, task: Task) -> None:
    code = tmp_path / "remembering.py"
    code.write_text("CALLS = []\ndef act(observation):\n    CALLS.append(0)\n    return [0.01 * len(CALLS)]\n")
    simulation = mjrun.Simulation(task, policy=f"{code}:act", seed=3)
    with pytest.warns(MjrunWarning, match=r"^policy acts differently .* depend on the order of episodes"):
        made(simulation, tmp_path / "carts", format="minari", episodes=1)


def test_episodes_are_those_of_the_environment_and_of_mjrun_eval(tmp_path: Path, task: Task, policy: str) -> None:
    import minari

    result = made(mjrun.Simulation(task, policy=policy, seed=3), tmp_path / "carts", format="minari")
    environment = mjrun.gym.make(task).unwrapped
    actor = load_policy(policy).episode(0, ActionSpace(["push"], np.array([-1.0]), np.array([1.0])))
    for seed, episode in zip(SEEDS, minari.MinariDataset(tmp_path / "carts/data").iterate_episodes(), strict=True):
        observation, _ = environment.reset(seed=seed)
        terminated = truncated = False
        for index, action in enumerate(episode.actions):
            np.testing.assert_array_equal(episode.observations[index], observation)
            np.testing.assert_array_equal(action, actor(observation))
            observation, reward, terminated, truncated, _ = environment.step(action)
            assert episode.rewards[index] == reward
            assert (episode.terminations[index], episode.truncations[index]) == (terminated, truncated)
        np.testing.assert_array_equal(episode.observations[-1], observation)
        np.testing.assert_array_equal(episode.infos["qpos"][:, 0], episode.observations[:, 0])
        assert terminated or truncated
    evaluated = mjrun.Evaluation(task, str(tmp_path / "eval"), policy=policy, episodes=3, seed=3, jobs=1).run()
    summary = evaluated.policies[0]
    assert (result.seeds, result.rows) == (SEEDS, evaluated.steps)
    assert result.mean_return == pytest.approx(summary.returns.mean, rel=1e-12)
    assert result.successes == (summary.success.count if summary.success else 0) > 0


def test_progress_counts_episodes(tmp_path: Path, simulation: mjrun.Simulation) -> None:
    class Progress(PythonApiReporter):
        def __init__(self) -> None:
            self.seen: list[tuple[str, int, int]] = []

        def progress(self, what: str, done: int, total: int) -> None:
            self.seen.append((what, done, total))

    reporter = Progress()
    EpisodeDataset(simulation, str(tmp_path / "set"), episodes=2, jobs=1, chunk=1).run(reporter)
    assert reporter.seen == [(what, done, 2) for what in ("episodes", "episodes written") for done in (1, 2)]


def test_an_interrupted_dataset_continues_to_the_same_bytes_as_do_processes(
    tmp_path: Path, simulation: mjrun.Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    made(simulation, tmp_path / "at once", jobs=2)
    publish = EpisodeDataset._publish

    def interrupted(self: EpisodeDataset, key: str, result: Any) -> None:
        publish(self, key, result)
        if result.index == 1:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(EpisodeDataset, "_publish", interrupted)
        with pytest.raises(KeyboardInterrupt):
            made(simulation, tmp_path / "continued")
    assert not (tmp_path / "continued/meta").exists()
    (tmp_path / "continued/mjrun/episodes/000001/numbers.npz").unlink()
    (tmp_path / "continued/mjrun/episodes/000001/key").unlink()
    assert made(simulation, tmp_path / "continued").simulated == 2
    assert contents(tmp_path / "continued") == contents(tmp_path / "at once")
    before = contents(tmp_path / "at once")
    (left := tmp_path / "at once/mjrun/episodes/000001").mkdir(parents=True)  # by a process that was killed at its end
    (left / "key").touch()
    unused_name(tmp_path / "at once/meta/info.json").touch()
    assert made(simulation, tmp_path / "at once").simulated == 0
    assert contents(tmp_path / "at once") == before


def test_a_process_that_ends_early_leaves_the_waiting_episodes_of_another(
    tmp_path: Path, simulation: mjrun.Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    publish = EpisodeDataset._publish

    def interrupted(self: EpisodeDataset, key: str, result: Any) -> None:
        publish(self, key, result)
        if result.index == 1:  # whose result the other process has not recorded yet
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(EpisodeDataset, "_publish", interrupted)
        with pytest.raises(KeyboardInterrupt):
            made(simulation, tmp_path / "set", chunk=1)
    with pytest.raises(FailedEpisodesError, match="2 of 3 episodes are not simulated yet"):
        made(simulation, tmp_path / "set", time_budget=Fraction(1, 10**9))
    waiting = sorted(path.name for path in (tmp_path / "set/mjrun/episodes/000001").iterdir())
    assert waiting == ["key", "numbers.npz"]


def test_more_episodes_are_added_to_the_same_bytes(tmp_path: Path, simulation: mjrun.Simulation) -> None:
    made(simulation, tmp_path / "at once", episodes=5)
    made(simulation, tmp_path / "added", episodes=2)
    assert made(simulation, tmp_path / "added", episodes=5).simulated == 3
    assert contents(tmp_path / "added") == contents(tmp_path / "at once")
    with pytest.raises(FileError, match="has 5 episodes, of seeds that this command does not ask for"):
        made(simulation, tmp_path / "added", episodes=3)


def test_two_exports_into_one_folder_at_the_same_time_make_one_dataset(
    tmp_path: Path, simulation: mjrun.Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulate = PreparedStudy.simulate

    def overtaken(self: PreparedStudy, *arguments: Any, **options: Any) -> Counter[str]:
        statuses = simulate(self, *arguments, **options)
        with monkeypatch.context() as patch:
            patch.setattr(PreparedStudy, "simulate", simulate)
            made(simulation, tmp_path / "shared")
        return statuses

    monkeypatch.setattr(PreparedStudy, "simulate", overtaken)
    assert made(simulation, tmp_path / "shared").episodes == 3
    monkeypatch.undo()
    made(simulation, tmp_path / "alone")
    assert contents(tmp_path / "shared") == contents(tmp_path / "alone")


def test_waiting_episodes_of_a_larger_export_stay(tmp_path: Path, simulation: mjrun.Simulation) -> None:
    made(simulation, tmp_path / "set", episodes=1)
    (waiting := tmp_path / "set/mjrun/episodes/000003").mkdir(parents=True)
    made(simulation, tmp_path / "set", episodes=2)
    assert waiting.exists()


def test_an_export_that_ended_before_its_manifest_continues(tmp_path: Path, simulation: mjrun.Simulation) -> None:
    (tmp_path / "set/mjrun/parts").mkdir(parents=True)
    assert made(simulation, tmp_path / "set", episodes=1).episodes == 1


def test_nothing_of_another_policy_task_or_option_is_mixed_in(tmp_path: Path, simulation: mjrun.Simulation) -> None:
    folder, policies = tmp_path / "carts", tmp_path / "policies.py"
    made(simulation, folder)
    before = contents(folder)
    assert isinstance(simulation.source, Task)
    rewards = {**simulation.source.rewards, "effort": Reward(value="-0.02 * ctrl/push^2")}
    changed = replace(simulation, model=replace(simulation.source, rewards=rewards))
    others = [(changed, {}), (simulation, {"fps": 25}), (simulation, {"probe": ["qpos"]})]
    for other, options in others:
        with pytest.raises(FileError, match="of another task, policy, model, version or options"):
            made(other, folder, **options)
    policies.write_text(policies.read_text().replace("-2.0", "-2.1"))
    with pytest.raises(FileError, match="another task, policy"):
        made(simulation, folder, episodes=4)
    assert contents(folder) == before


def test_waiting_episodes_of_an_edited_model_are_simulated_again(
    tmp_path: Path, simulation: mjrun.Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(EpisodeDataset, "_conclude", interrupted)
        with pytest.raises(KeyboardInterrupt):
            made(simulation, tmp_path / "carts")
    model = tmp_path / "cart.xml"
    model.write_text(model.read_text().replace('mass="1"', 'mass="1.5"'))
    edited = replace(simulation)
    assert made(edited, tmp_path / "carts").simulated == 3
    made(edited, tmp_path / "new")
    assert contents(tmp_path / "carts") == contents(tmp_path / "new")


def test_episodes_that_fail_are_named_and_the_others_stay(tmp_path: Path) -> None:
    (tmp_path / "wild.py").write_text(WILD)
    task = cart_task(tmp_path)
    (tmp_path / "cart.xml").write_text(
        (tmp_path / "cart.xml").read_text().replace(' ctrlrange="-1 1" ctrllimited="true"', "")
    )
    simulation = mjrun.Simulation(task, policy=f"{tmp_path / 'wild.py'}:Wild", seed=3)
    with pytest.raises(FailedEpisodesError) as caught:
        made(simulation, tmp_path / "set", episodes=4)
    assert caught.value.exit_code == 8
    assert "2 of 4 episodes failed; the dataset has the others" in str(caught.value)
    assert "seed 4: the simulation became unstable" in str(caught.value)
    assert "seed 5: " in str(caught.value)
    (result,) = caught.value.results
    assert isinstance(result, EpisodeDatasetResult)
    assert (result.seeds, result.episodes) == ([3, 6], 2)
    assert {*table(tmp_path / "set")["episode_index"].tolist()} == {0, 1}
    with pytest.raises(FailedEpisodesError, match="2 of 4"):  # which another run reports again, without simulating
        made(simulation, tmp_path / "set", episodes=4)
    with pytest.raises(FailedEpisodesError, match="1 of 1 episode failed; there is no dataset"):
        made(replace(simulation, seed=4), tmp_path / "none", episodes=1)
    assert not (tmp_path / "none/meta").exists()
    (tmp_path / "raising.py").write_text("def act(observation):\n    raise ValueError('no idea')\n")
    raising = replace(simulation, policy=f"{tmp_path / 'raising.py'}:act")
    with pytest.raises(
        FailedEpisodesError, match=r"raised ValueError: no idea \(raising.py:2\)\n.*Traceback(.|\n)*line 2, in act"
    ):
        made(raising, tmp_path / "none", episodes=2)


def test_numbers_that_32_bits_cannot_hold_are_no_rows_of_lerobot(tmp_path: Path, task: Task, policy: str) -> None:
    import minari

    rewards = {"huge": Reward(value="where(qpos/slider > 0.5, 1e39, 1)")}
    simulation = mjrun.Simulation(replace(task, rewards=rewards), policy=policy, seed=3)
    made(simulation, tmp_path / "all", episodes=6, format="minari")
    episodes = [*minari.MinariDataset(tmp_path / "all/data").iterate_episodes()]
    large = [episode.rewards.max() > np.finfo(np.float32).max for episode in episodes]
    assert 0 < sum(large) < 6
    with pytest.raises(FailedEpisodesError) as caught:
        made(simulation, tmp_path / "set", episodes=6)
    failures = caught.value.results[0].failures
    assert [*failures] == [f"seed {seed}" for seed, is_large in enumerate(large, 3) if is_large]
    assert "the reward is too large for 32 bits in row" in next(iter(failures.values()))
    assert np.isfinite(table(tmp_path / "set")["next.reward"]).all()


def test_rows_of_a_lower_rate_add_up_rewards(tmp_path: Path, simulation: mjrun.Simulation) -> None:
    made(simulation, tmp_path / "all")
    made(simulation, tmp_path / "some", fps=Fraction(50, 5))
    for index in range(3):
        rows, fewer = table(tmp_path / "all", index), table(tmp_path / "some", index)
        for name in ("observation.state", "action"):
            np.testing.assert_array_equal(fewer[name], rows[name][::5])
        sums = np.add.reduceat(rows["next.reward"], np.arange(0, len(rows["index"]), 5))
        np.testing.assert_allclose(fewer["next.reward"], sums, rtol=1e-5)
    assert json.loads((tmp_path / "some/meta/info.json").read_text())["fps"] == 10
    for options, message in (
        (
            {"fps": 30},
            "acts 50 times per second; rows per second are that divided by a whole number, such as 50, 25, 10",
        ),
        ({"fps": 25, "format": "minari"}, "each row of a Minari dataset is a control period"),
        ({"camera": "free", "format": "minari"}, "a Minari dataset has no images"),
        ({"camera": "nowhere"}, "nowhere"),
        ({"probe": ["qpos/nowhere"]}, "nowhere"),
        ({"engine": "warp"}, "plays no policies"),
    ):
        with pytest.raises(UsageError, match=message):
            made(simulation, tmp_path / "new", **options)
    assert not (tmp_path / "new").exists()


def test_what_is_no_dataset_of_episodes_is_left_alone(tmp_path: Path, simulation: mjrun.Simulation) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full/notes.txt").write_text("mine")
    (tmp_path / "file").write_text("mine")
    made(simulation, tmp_path / "lerobot")
    for name, message in (
        ("full", "contains other files"),
        ("file", "is not a folder"),
        ("lerobot", "contains a lerobot dataset"),
    ):
        with pytest.raises(FileError, match=message):
            made(simulation, tmp_path / name, format="minari")
    assert (tmp_path / "full/notes.txt").read_text() == "mine"
    manifest = tmp_path / "lerobot/mjrun/dataset.json"
    manifest.write_text(manifest.read_text().replace('"rows"', '"lines"'))
    with pytest.raises(FileError, match="contains other files"):
        made(simulation, tmp_path / "lerobot")


def test_a_dataset_begins_beside_another_process_that_writes_its_manifest(
    tmp_path: Path, simulation: mjrun.Simulation
) -> None:
    (tmp_path / "set/mjrun/parts").mkdir(parents=True)
    other = TemporaryOutput(tmp_path / "set/mjrun/dataset.json")
    assert made(simulation, tmp_path / "set", episodes=1).episodes == 1
    other.remove()


def test_a_recording_is_an_episode_of_its_states_and_controls(tmp_path: Path) -> None:
    (tmp_path / "m.xml").write_text(XML)
    driven = mjrun.Simulation(tmp_path / "m.xml", ctrl={"push": (0.3,)}, qpos={"slider": (0.5,)}, duration=1)
    mjrun.Recording(driven, str(tmp_path / "r.npz")).run()
    replay = mjrun.Simulation(tmp_path / "m.xml", replay=str(tmp_path / "r.npz"))
    result = made(replay, tmp_path / "set", episodes=None, fps=20, instruction="push it")
    assert (result.episodes, result.rows, result.seeds) == (1, 20, [None])
    data = table(tmp_path / "set")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "m.xml"))
    state = mujoco.MjData(model)
    state.qpos[0], state.ctrl[0] = 0.5, 0.3
    for row in data["observation.state"]:
        np.testing.assert_array_equal(row, np.array([*state.qpos, *state.qvel], np.float32))
        for _ in range(5):
            mujoco.mj_step(model, state)
    assert {*data["action"].tolist()} == {float(np.float32(0.3))}
    assert "next.reward" not in data
    assert data["next.done"].tolist() == [False] * 19 + [True]
    assert pandas.read_parquet(tmp_path / "set/meta/tasks.parquet").index.tolist() == ["push it"]
    with pytest.raises(UsageError, match="gives one episode, not 2"):
        made(replay, tmp_path / "two", episodes=2)
    with pytest.raises(UsageError, match="episodes with rewards"):
        made(replay, tmp_path / "two", episodes=None, format="minari")


@pytest.mark.gl
def test_images_are_those_of_mjrun_video(tmp_path: Path, simulation: mjrun.Simulation) -> None:
    cameras = ["free:azimuth=90", "track:cart"]
    result = made(simulation, tmp_path / "set", episodes=2, camera=cameras)
    assert result.cameras == ["free_azimuth_90", "track_cart"]
    for name, camera in zip(result.cameras, cameras, strict=True):
        shown = frames(tmp_path / f"set/videos/observation.images.{name}/chunk-000/file-000.mp4")
        expected = [
            frame
            for seed in SEEDS[:2]
            for frame in mjrun.frames(
                replace(simulation, seed=seed), camera=camera, size=(64, 48), quality="draft", stage="none", fps=50
            )
        ]
        assert len(shown) == len(expected) == result.rows
        difference = np.abs(shown.astype(int) - expected)
        assert difference.mean() < 2
        assert difference.max(axis=(1, 2, 3)).max() < 60  # at edges of colours, which the codec subsamples


def test_environments_of_gymnasium_are_played(tmp_path: Path) -> None:
    import minari

    simulation = mjrun.Simulation("gym:InvertedPendulum-v5", policy="zero")
    result = made(simulation, tmp_path / "pendulum-v0", episodes=2, format="minari")
    dataset = minari.MinariDataset(tmp_path / "pendulum-v0/data")
    assert dataset.spec.env_spec is not None
    environment = dataset.recover_environment()
    for seed, episode in enumerate(dataset.iterate_episodes()):
        observation, _ = environment.reset(seed=seed)
        np.testing.assert_array_equal(episode.observations[0], observation)
    assert result.rows == dataset.total_steps


@pytest.mark.parametrize(
    ("cameras", "keys"),
    [
        (["front", "front"], ("front", "front_2")),
        (["a/b", "a b", "../c", "\x1b[31m", "ü"], ("a_b", "a_b_2", "c", "31m", "camera")),
        (["track:box,distance=.5", 0], ("track_box", "0")),
    ],
)
def test_names_of_cameras_are_fit_for_paths(cameras: list[object], keys: tuple[str, ...]) -> None:
    assert camera_keys(cameras) == keys
