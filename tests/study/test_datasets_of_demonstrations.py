"""Demonstrations of others as datasets, compared with their files and with a bare MuJoCo loop."""

import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import h5py
import mujoco
import numpy as np
import pandas
import pytest

import mjrun
from mjrun.errors import FailedEpisodesError, ModelError, UsageError
from mjrun.reporter import PythonApiReporter
from mjrun.simulation.demonstration import read_demonstration
from mjrun.study.episode_dataset import EpisodeDataset, EpisodeDatasetResult
from tests.demonstration_files import PLAIN, recorded_states, write_demonstrations

DEMOS = {"demo_1": recorded_states(5, first=0.052), "demo_2": recorded_states(3, seed=1)}
pytestmark = pytest.mark.filterwarnings("ignore::mjrun.errors.MjrunWarning")


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = write_demonstrations(tmp_path / "d.hdf5", DEMOS)
    with h5py.File(path, "a") as written:
        for name, states in DEMOS.items():
            group = written[f"data/{name}"]
            written[f"data/{name}/rewards"] = np.eye(len(states))[-1] * (name == "demo_1")
            del written[f"data/{name}/actions"]
            written[f"data/{name}/actions"] = np.arange(2.0 * len(states)).reshape(-1, 2)
            group.attrs["ep_meta"] = json.dumps({"lang": f"lift {name}"})
    return path


def made(file: Path | str, folder: Path, **options: Any) -> EpisodeDatasetResult:
    return EpisodeDataset(mjrun.Simulation(str(file)), str(folder), jobs=1, **options).run(PythonApiReporter())


def table(folder: Path) -> Any:
    return pandas.read_parquet(folder / "data/chunk-000/file-000.parquet")


def test_each_state_is_a_row_with_its_action_and_its_task(file: Path, tmp_path: Path) -> None:
    result = made(file, tmp_path / "set")
    assert (result.episodes, result.rows, result.fps, result.successes) == (2, 8, 20, 1)
    rows = table(tmp_path / "set")
    info = json.loads((tmp_path / "set/meta/info.json").read_text())
    assert info["features"]["action"]["names"] == ["action_0", "action_1"]
    tasks = pandas.read_parquet(tmp_path / "set/meta/tasks.parquet")
    for index, (name, states) in enumerate(DEMOS.items()):
        own = rows[rows["episode_index"] == index]
        np.testing.assert_array_equal(np.stack(own["observation.state"]), states[:, 1:].astype(np.float32))
        np.testing.assert_array_equal(np.stack(own["action"]).ravel(), np.arange(2 * len(states)))
        assert own["next.done"].tolist() == [False] * (len(states) - 1) + [True]
        assert own["next.success"].tolist()[-1] == (name == "demo_1")
        assert tasks.index[own["task_index"].tolist()[0]] == f"lift {name}"
    listed = json.loads((tmp_path / "set/mjrun/dataset.json").read_text())
    assert [each["demonstration"] for each in listed["episodes"]] == [f"{file}:{name}" for name in DEMOS]


@pytest.mark.parametrize(("timestep", "rate"), [(0.03, 20), (0.002, 15), (0.025, 50), (0.025, 500)])
def test_states_between_the_steps_of_the_model_are_rows_as_they_were_recorded(
    timestep: float, rate: int, tmp_path: Path
) -> None:
    states = recorded_states(6)
    states[:, 0] = np.arange(6) / rate
    model = PLAIN.replace("<visual>", f'<option timestep="{timestep}"/><visual>')
    file = write_demonstrations(tmp_path / "d.hdf5", {"demo_1": states}, model)
    assert made(file, tmp_path / "set").fps == rate
    observed = np.stack(table(tmp_path / "set")["observation.state"])
    np.testing.assert_array_equal(observed, states[:, 1:].astype(np.float32))


def test_offline_reinforcement_learning_gets_rewards_and_ends(file: Path, tmp_path: Path) -> None:
    import minari

    made(file, tmp_path / "set-v0", format="minari", instruction="lift")
    first, second = minari.MinariDataset(tmp_path / "set-v0/data").iterate_episodes()
    np.testing.assert_array_equal(first.observations[:-1], DEMOS["demo_1"][:, 1:])
    assert (first.rewards.tolist(), second.rewards.sum()) == ([0, 0, 0, 0, 1], 0)
    assert (first.terminations[-1], first.truncations[-1]) == (True, False)
    assert (second.terminations[-1], second.truncations[-1]) == (False, True)


@pytest.mark.gl
def test_images_are_those_of_a_bare_loop_over_the_states(file: Path, tmp_path: Path) -> None:
    import av

    made(file, tmp_path / "set", camera="agentview", size=(64, 64), crf=1)
    with av.open(str(tmp_path / "set/videos/observation.images.agentview/chunk-000/file-000.mp4")) as video:
        frames = [frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]
    (tmp_path / "m.xml").write_text(PLAIN)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "m.xml"))
    data, visible = mujoco.MjData(model), mujoco.MjvOption()
    visible.geomgroup[0] = 0
    visible.sitegroup[:] = 0
    states = np.concatenate([*DEMOS.values()])
    assert len(frames) == len(states)
    with mujoco.Renderer(model, 64, 64) as renderer:
        for state, frame in zip(states, frames, strict=True):
            data.qpos[:] = state[1 : 1 + model.nq]
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, "agentview", visible)
            assert abs(frame.astype(int) - renderer.render()).mean() < 2  # what the encoder loses


def test_a_demonstration_of_one_state_is_a_row_if_its_rate_is_stated(tmp_path: Path) -> None:
    file = write_demonstrations(tmp_path / "d.hdf5", {"demo_1": recorded_states(1)})
    with pytest.raises(UsageError) as caught:
        made(file, tmp_path / "set")
    assert str(caught.value) == f"{file}:demo_1 has one state, and therefore no rate; replay_rate states one"
    rate = Fraction(30000, 1001)
    simulation = mjrun.Simulation(str(file), replay_rate=rate)
    result = EpisodeDataset(simulation, str(tmp_path / "set"), jobs=1, fps=30).run(PythonApiReporter())
    assert (result.episodes, result.rows) == (1, 1)
    assert read_demonstration(f"{file}:demo_1", rate).rate == rate


def test_one_demonstration_or_the_first_ones_may_be_selected(file: Path, tmp_path: Path) -> None:
    assert made(f"{file}:demo_2", tmp_path / "one").rows == 3
    assert made(file, tmp_path / "first", episodes=1).rows == 5
    assert made(file, tmp_path / "first").rows == 8  # which adds the second
    assert table(tmp_path / "first")["episode_index"].tolist() == [0] * 5 + [1] * 3


def test_demonstrations_that_do_not_fit_the_first_are_left_out(file: Path, tmp_path: Path) -> None:
    written: Any
    with h5py.File(file, "a") as written:
        written.copy("data/demo_2", "data/demo_3")
        written.copy("data/demo_2", "data/demo_4")
        written["data/demo_2"].attrs["model_file"] = PLAIN.replace('name="turn"', 'name="bend"').replace(
            'joint="turn"', 'joint="bend"'
        )
        written["data/demo_3/states"][:, 0] = [0, 0.1, 0.2]
        del written["data/demo_4/actions"]
        written["data/demo_4/actions"] = np.zeros((3, 4))
    with pytest.raises(FailedEpisodesError) as caught:
        made(file, tmp_path / "set")
    reasons = caught.value.results[0].failures
    assert {name.rpartition(":")[2]: text.partition("demo_")[2][2:] for name, text in reasons.items()} == {
        "demo_2": "has another model than the first demonstration: qpos/bend, qpos/turn, qvel/bend, qvel/turn\n"
        "--probe selects values that all of them have",
        "demo_3": "has 10 states per second, not 20",
        "demo_4": "has actions of 4 numbers, not 2 as the first demonstration",
    }
    assert len(table(tmp_path / "set")) == 5


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"episodes": 3}, UsageError, r"d\.hdf5 has 2 demonstrations"),
        ({"fps": 10}, UsageError, r"fps 10: the demonstrations have 20 actions per second"),
        ({"camera": "front"}, UsageError, r"no camera 'front'"),
    ],
)
def test_other_numbers_are_refused_before_anything_is_made(
    file: Path, tmp_path: Path, options: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        made(file, tmp_path / "set", **options)
    assert not (tmp_path / "set/data").exists()


def test_a_file_without_demonstrations_is_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "t.h5", "w") as written:
        written["time"] = np.arange(3)
    with pytest.raises(ModelError, match="has no demonstrations"):
        made(tmp_path / "t.h5", tmp_path / "set")
