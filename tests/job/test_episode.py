"""Simulations that a policy drives, against bare loops."""

import json
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest

from mjrun.document.task import read_task
from mjrun.errors import InvalidActionError, UsageError
from mjrun.formats.recording_reader import RecordingReader
from mjrun.formats.table_reader import read_table
from mjrun.job.episode import episode_of
from mjrun.job.image import Image
from mjrun.job.recording import Recording
from mjrun.job.simulation import Simulation
from mjrun.job.trace import Trace
from mjrun.model import state
from mjrun.model.sources import parse_source
from mjrun.model.sources.dm import ControlSuiteSource
from mjrun.policy.load import load_policy
from tests.policy.networks import linear
from tests.policy.test_agreement import METADATA, MODEL, MOTORS
from tests.policy.test_task_of_policy import DOCUMENT
from tests.task.environments import registered


class Spring:
    """Pulls a cart back to where it belongs; forgets nothing within an episode."""

    def __init__(self) -> None:
        self.calls = 0

    def reset(self, seed: int) -> None:
        self.calls = seed

    def act(self, observation: np.ndarray) -> list[float]:
        self.calls += 1
        return [-3 * observation[0] - 0.1 * observation[1] + 0.01 * self.calls]


def bare_episode(name: str, seed: int, periods: int) -> list[dict[str, Any]]:
    """What Gymnasium's own loop gives at each control instant."""
    environment: Any = gymnasium.make(name, disable_env_checker=True)
    policy = Spring()
    policy.reset(seed)
    observation, _ = environment.reset(seed=seed)
    data, model, total, rows = environment.unwrapped.data, environment.unwrapped.model, 0.0, []
    reward = 0.0
    for _ in range(periods):
        action = policy.act(observation)
        rows.append({"obs": observation, "action": action, "reward": reward, "total": total})
        rows[-1]["state"] = state.save(model, data)
        observation, reward, *_ = environment.step(np.array(action, np.float32))  # as its actions are
        total += reward
    environment.close()
    return rows


def test_a_trace_of_an_environment_has_the_numbers_of_its_own_loop(tmp_path: Path) -> None:
    with registered(tmp_path, max_episode_steps=12) as name:
        expected = bare_episode(name, 5, 12)
        simulation = Simulation(f"gym:{name}", policy=Spring, seed=5)
        path = str(tmp_path / "t.csv")
        result = Trace(simulation, path, every=4, probe=["qpos", "obs", "action", "reward/total", "return"]).run()
    columns = read_table(Path(path)).columns
    assert [*columns] == ["time", "qpos/x", "obs/0", "obs/1", "action/motor", "reward/total", "return"]
    table = np.column_stack([*columns.values()])
    assert len(table) == 13
    np.testing.assert_array_equal(table[:12, 2:4], [row["obs"] for row in expected])
    np.testing.assert_array_equal(table[:12, 4], [row["action"][0] for row in expected])
    np.testing.assert_array_equal(table[:12, 5], [row["reward"] for row in expected])
    np.testing.assert_array_equal(table[:12, 6], [row["total"] for row in expected])
    assert result.episode is not None
    assert (result.episode.ending, result.episode.kind, result.episode.periods) == ("timeout", "timeout", 12)
    assert (result.episode.total, result.episode.time, result.steps) == (18.0, pytest.approx(0.48), 48)


def test_a_recording_holds_the_states_of_the_environment_and_says_how_it_ended(tmp_path: Path) -> None:
    with registered(tmp_path, "arrives", max_episode_steps=50) as name:
        expected = bare_episode(name, 2, 3)
        simulation = Simulation(f"gym:{name}", policy=Spring, seed=2)
        output, manifest = str(tmp_path / "run.npz"), tmp_path / "m.json"
        Recording(simulation, output, manifest=str(manifest)).run()
    facts = json.loads(manifest.read_text())["result"]["episode"]
    assert (facts["ending"], facts["kind"], facts["periods"], facts["seed"]) == ("terminated", "success", 3, 2)
    with RecordingReader(output) as recording:
        assert len(recording.steps) == 13
        model = mujoco.MjModel.from_xml_path(str(tmp_path / "cart.xml"))
        qpos = state.fields(state.sizes(model))["qpos"]
        for index, row in enumerate(expected):
            np.testing.assert_array_equal(recording.state(4 * index)[qpos], row["state"][qpos])


def test_a_recording_of_an_environment_replays_as_the_same_physics(tmp_path: Path) -> None:
    with registered(tmp_path, max_episode_steps=3) as name:
        Recording(Simulation(f"gym:{name}", policy="random"), str(tmp_path / "run.npz")).run()
        replay = Simulation(f"gym:{name}", replay=str(tmp_path / "run.npz"))
        assert replay.replay_remarks(replay.load()) == []


def test_a_second_look_at_an_episode_does_not_disturb_the_first(tmp_path: Path) -> None:
    with registered(tmp_path, max_episode_steps=9) as name:
        episode = episode_of(parse_source(f"gym:{name}"), load_policy("random"), 4)
        first, second = episode.stepper(), episode.stepper()
        for step in (5, 12, 13):
            for stepper in (first, second):
                stepper.advance(step)
            np.testing.assert_array_equal(first.state(), second.state())


def test_tasks_of_dm_control_are_told_to_be_out_of_reach(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ControlSuiteSource, "load", lambda _: mujoco.MjModel.from_xml_string("<mujoco/>"))
    with pytest.raises(UsageError) as caught:
        episode_of(ControlSuiteSource("humanoid/walk"), load_policy("zero"), 0)
    assert "tasks of dm_control are out of reach" in caught.value.spelled(str)


def test_a_duration_beyond_the_end_of_an_environment_is_cut_with_a_remark(tmp_path: Path) -> None:
    with registered(tmp_path, max_episode_steps=3) as name:
        simulation = Simulation(f"gym:{name}", policy="zero", duration=2)
        with pytest.warns(UserWarning, match=r"the episode ends at 0.12 s"):
            result = Trace(simulation, str(tmp_path / "t.csv")).run()
        assert result.steps == 12
        with pytest.raises(UsageError, match="the episode ended at step 12"):
            Image(Simulation(f"gym:{name}", policy="zero"), str(tmp_path / "i.png"), time=1).run()


def test_actions_that_are_not_finite_end_it_with_the_step(tmp_path: Path) -> None:
    answers = iter([0.5, float("nan")] * 2)
    with registered(tmp_path) as name, pytest.raises(InvalidActionError, match=r"at step 4, time 0.04 s.*motor = nan"):
        Trace(Simulation(f"gym:{name}", policy=lambda _: next(answers)), str(tmp_path / "t.csv")).run()
    assert not (tmp_path / "t.csv").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"policy": "zero", "controller": print}, "both drive the actuators"),
        ({"policy": "zero", "ctrl_from": "a.csv"}, "both drive the actuators"),
        ({"policy": "zero", "key": "home"}, "says how an episode starts"),
        ({"policy": "zero", "perturb": 0.1}, "says how an episode starts"),
        ({"policy": "zero", "replay": "a.npz"}, "driven by what is replayed"),
        ({"normalize": "none"}, "there is none"),
    ],
)
def test_what_does_not_go_with_a_policy_is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        Simulation("gym:Ant-v5", **options)


def test_a_model_alone_is_played_where_the_file_of_the_policy_says_the_rest(tmp_path: Path) -> None:
    (tmp_path / "robot.xml").write_text(MODEL.format("", MOTORS.format("")))
    (tmp_path / "task.yaml").write_text(DOCUMENT)
    policy = str(linear(tmp_path / "walk.onnx", np.full((2, 6), 0.5, np.float32), bias=1, metadata=METADATA))
    alone = Simulation(str(tmp_path / "robot.xml"), policy=policy, control_dt="0.02", duration="0.1")
    task = read_task(tmp_path / "task.yaml")
    tables = []
    for simulation in (alone, Simulation(task, policy=policy, duration="0.1")):
        Trace(simulation, str(tmp_path / "t.csv"), probe=["qpos", "action"]).run()
        tables.append((tmp_path / "t.csv").read_bytes())
    assert tables[0] == tables[1]
    with pytest.raises(UsageError, match=r"does not say its control period\nsay it by control_dt"):
        Trace(Simulation(str(tmp_path / "robot.xml"), policy=policy), str(tmp_path / "t.csv")).run()
    with pytest.raises(UsageError, match=r"^control_dt: .*task.yaml says its control period"):
        Trace(Simulation(task, policy=policy, control_dt="0.01"), str(tmp_path / "t.csv")).run()
