"""Simulations that a policy drives, against bare loops."""

import gc
import json
import os
import pickle
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
import onnxruntime
import pytest

from mjrun.camera.script import ConditionEvent
from mjrun.document.run import read_run
from mjrun.document.task import read_task
from mjrun.errors import DocumentError, InvalidActionError, UsageError
from mjrun.formats.recording import RecordingReader
from mjrun.formats.table_reader import read_table
from mjrun.model import state
from mjrun.model.sources import parse_source
from mjrun.model.sources.dm import ControlSuiteSource
from mjrun.options.run import RunCommandOptions
from mjrun.outputs.image import Image
from mjrun.outputs.perform import perform
from mjrun.outputs.recording import Recording
from mjrun.outputs.trace import Trace
from mjrun.policy.load import load_policy
from mjrun.simulation.policy_episode import cached_policy, episode_of
from mjrun.simulation.simulation import Simulation
from mjrun.study.simulate import PointSimulator
from mjrun.study.spec import StudyPoint, StudySpec
from tests.policy.networks import linear
from tests.policy.test_task_facts import DOCUMENT, METADATA, MODEL, MOTORS
from tests.task.environments import registered


class Spring:
    """Pulls a cart back to the middle, and remembers the whole episode."""

    def __init__(self) -> None:
        self.calls = 0

    def reset(self, seed: int) -> None:
        self.calls = seed

    def act(self, observation: np.ndarray) -> list[float]:
        self.calls += 1
        return [-3 * observation[0] - 0.1 * observation[1] + 0.01 * self.calls]


def bare_episode(name: str, seed: int, periods: int) -> list[dict[str, Any]]:
    """Returns the values of a bare Gymnasium loop at each control instant."""
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


def test_a_function_is_called_once_for_each_control_period(tmp_path: Path) -> None:
    answers = iter(range(13))
    with registered(tmp_path, max_episode_steps=12) as name:
        simulation = Simulation(f"gym:{name}", policy=lambda observation: [0.01 * next(answers)])
        Trace(simulation, str(tmp_path / "t.csv"), every=4, probe=["action"]).run()
    actions = read_table(tmp_path / "t.csv").columns["action/motor"]
    np.testing.assert_array_equal(actions[:12], 0.01 * np.arange(12))


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


def test_tasks_of_dm_control_are_reported_to_be_out_of_reach(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ControlSuiteSource, "load", lambda _: mujoco.MjModel.from_xml_string("<mujoco/>"))
    with pytest.raises(UsageError) as caught:
        episode_of(ControlSuiteSource("humanoid/walk"), load_policy("zero"), 0)
    assert "tasks of dm_control cannot be played" in caught.value.spelled(str)


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
        ({"policy": "zero", "key": "home"}, "sets the start of an episode"),
        ({"policy": "zero", "perturb": 0.1}, "sets the start of an episode"),
        ({"policy": "zero", "replay": "a.npz"}, "the replayed file drives the simulation"),
        ({"normalize": "none"}, "normalize requires policy"),
    ],
)
def test_what_does_not_go_with_a_policy_is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        Simulation("gym:Ant-v5", **options)


@pytest.mark.parametrize(
    "options",
    [{"quat": "xyzw"}, {"replay_unwrap": True}, {"ctrl_interpolation": "linear"}, {"replay_mode": "controls"}],
)
def test_an_episode_refuses_options_about_tables_that_it_does_not_read(
    task: Path, tmp_path: Path, options: dict[str, Any]
) -> None:
    with pytest.raises(UsageError, match=f"^{next(iter(options))} requires "):
        Trace(Simulation(read_task(task), policy="zero", **options), f"{tmp_path}/t.csv").run()


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
    with pytest.raises(UsageError, match=r"does not specify its control period\nset control_dt"):
        Trace(Simulation(str(tmp_path / "robot.xml"), policy=policy), str(tmp_path / "t.csv")).run()
    with pytest.raises(UsageError, match=r"^control_dt: .*task.yaml specifies the control period"):
        Trace(Simulation(task, policy=policy, control_dt="0.01"), str(tmp_path / "t.csv")).run()


ARM = """<mujoco><option timestep="0.005"/>
  <worldbody><body name="upper" pos="0 0 1"><joint name="shoulder" axis="0 1 0" damping=".1"/>
    <geom name="upper" type="capsule" size=".03" fromto="0 0 0 0 0 -.4"/>
    <body name="lower" pos="0 0 -.4"><joint name="elbow" axis="0 1 0" damping=".1"/>
      <geom name="lower" type="capsule" size=".03" fromto="0 0 0 0 0 -.4"/></body></body></worldbody>
  <actuator><motor name="m1" joint="shoulder"/><motor name="m2" joint="elbow"/></actuator></mujoco>"""
TASK = """
model: arm.xml
control_dt: 0.02
duration: 1
reset: {noise: {"qpos/*": "uniform(-0.5, 0.5)"}}
observations:
  - {name: angles, joints: [elbow, shoulder], scale: 2}
  - {name: speeds, joints: [elbow, shoulder], of: qvel}
  - {name: last, action: previous}
actions: [{actuators: [m2, m1], squash: tanh, scale: 0.5}]
rewards: {calm: "exp(-norm('qvel/*'))", effort: {value: "sum('action/*'^2)", weight: -0.001}}
terminations: {fast: {when: "norm('qvel/*') > 3", as: failure}}
"""
WEIGHTS = np.array([[3, 1, -0.2, 0.1, 0.3, 0], [-1, 2, 0.1, -0.1, 0, 0.2]], np.float32)


@pytest.fixture
def task(tmp_path: Path) -> Path:
    """A task in a document, and a policy in `arm.onnx` beside it."""
    (tmp_path / "arm.xml").write_text(ARM)
    (tmp_path / "arm.yaml").write_text(TASK)
    linear(tmp_path / "arm.onnx", WEIGHTS)
    return tmp_path / "arm.yaml"


def bare_arm(path: Path, start: np.ndarray, periods: int) -> Iterator[dict[str, Any]]:
    """Returns the values of a bare loop of mj_step and onnxruntime at each control instant."""
    model = mujoco.MjModel.from_xml_string(ARM)
    data = mujoco.MjData(model)
    data.qpos[:] = start
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    action, terms, total = np.zeros(2), np.zeros(2), 0.0
    for _ in range(periods + 1):
        observation = np.concatenate([data.qpos[::-1] * 2, data.qvel[::-1], action])
        row = {"obs": observation, "qpos": data.qpos.copy(), "terms": terms, "return": total}
        (answer,) = session.run(None, {"obs": observation[None].astype(np.float32)})
        action = np.asarray(answer, float)[0]
        data.ctrl[::-1] = np.tanh(action) * 0.5
        yield {**row, "action": action, "ctrl": data.ctrl.copy()}
        for _ in range(4):
            mujoco.mj_step(model, data)
        terms = np.array([np.exp(-np.linalg.norm(data.qvel)), -0.001 * np.sum(action**2)])
        total += terms.sum()


def test_a_trace_of_a_task_is_a_bare_loop_of_physics_and_inference(task: Path, tmp_path: Path) -> None:
    simulation = Simulation(read_task(task), policy=str(task.with_suffix(".onnx")), seed=3)
    path = tmp_path / "t.csv"
    probes = ["qpos", "ctrl", "obs", "action", "reward", "return"]
    result = Trace(simulation, str(path), every=4, probe=probes, assert_=["last(return) > first(return)"]).run()
    columns = read_table(path).columns
    assert [*columns][5:] == [
        *("obs/angles/elbow", "obs/angles/shoulder", "obs/speeds/elbow", "obs/speeds/shoulder"),
        *("obs/last/m2", "obs/last/m1", "action/m2", "action/m1"),
        *("reward/calm", "reward/effort", "reward/total", "return"),
    ]
    table = np.column_stack([*columns.values()])
    loop = [*bare_arm(task.with_suffix(".onnx"), table[0, 1:3], len(table) - 1)]
    np.testing.assert_array_equal(table[:, 1:3], [row["qpos"] for row in loop])
    np.testing.assert_array_equal(table[:-1, 3:5], [row["ctrl"] for row in loop[:-1]])
    np.testing.assert_array_equal(table[:, 5:11], [row["obs"] for row in loop])
    np.testing.assert_array_equal(table[:, 11:13], [row["action"] for row in loop])
    np.testing.assert_allclose(table[:, 13:15], [row["terms"] for row in loop], rtol=1e-14)
    np.testing.assert_allclose(table[:, -1], [row["return"] for row in loop], rtol=1e-14)
    assert result.episode is not None
    assert result.episode.ending == ("timeout" if len(table) == 51 else "fast")
    assert result.episode.total == table[-1, -1]


def test_a_policy_that_is_kept_for_later_keeps_no_copies_of_files(task: Path) -> None:
    simulation = Simulation(read_task(task), policy=str(task.with_suffix(".onnx"))).with_snapshot()
    assert simulation.snapshot
    folder = simulation.snapshot.root
    assert simulation.episode
    assert folder.is_dir()
    del simulation
    gc.collect()
    assert not folder.exists()


def test_a_task_lasts_until_it_ends_or_as_long_as_is_reported(task: Path, tmp_path: Path) -> None:
    policy, text = str(task.with_suffix(".onnx")), task.read_text().replace("> 3", "> 0.8")
    task.write_text(text)
    ended = Trace(Simulation(read_task(task), policy=policy, seed=1), str(tmp_path / "a.csv"), probe=["qvel"]).run()
    beyond = Trace(
        Simulation(read_task(task), policy=policy, seed=1, duration=2), str(tmp_path / "b.csv"), probe=["qvel"]
    ).run()
    assert ended.episode is not None
    assert beyond.episode is not None
    assert beyond.episode == replace(ended.episode, simulated=2.0)
    assert beyond.episode.sentence == f"{ended.episode.sentence}; the simulation continued without a reset up to 2 s"
    assert (ended.episode.ending, ended.episode.kind) == ("fast", "failure")
    assert (ended.simulated, beyond.simulated) == (ended.episode.time, 2.0)
    shorter, longer = ((tmp_path / name).read_bytes() for name in ("a.csv", "b.csv"))
    assert longer.startswith(shorter)
    last = np.array([*read_table(tmp_path / "a.csv").columns.values()])[1:]
    assert np.linalg.norm(last[:, -1]) > 0.8 >= np.linalg.norm(last[:, -5])


def test_a_run_document_makes_all_outputs_of_an_episode(task: Path, tmp_path: Path) -> None:
    (tmp_path / "run.yaml").write_text(
        "model: arm.yaml\npolicy: arm.onnx\nseed: 3\n"
        "traces: [{output: a.csv, probe: [return]}, {output: b.csv, probe: [obs]}]\nrecordings: [c.npz]\n"
    )
    (tmp_path / "out").mkdir()
    requests = read_run(tmp_path / "run.yaml", [], RunCommandOptions(output=str(tmp_path / "out")), "")
    results = perform(requests.outputs)
    assert len({str(result.episode) for result in results}) == 1
    alone = Trace(
        Simulation(read_task(task), policy=str(task.with_suffix(".onnx")), seed=3),
        str(tmp_path / "d.csv"),
        probe=["return"],
    ).run()
    assert alone.episode == results[0].episode
    assert (tmp_path / "d.csv").read_bytes() == (tmp_path / "out" / "a.csv").read_bytes()
    (tmp_path / "run.yaml").write_text("model: arm.yaml\npolicy: policy.py:act\ntraces: [a.csv]\n")
    with pytest.raises(DocumentError, match=r"run.yaml:2:9: policy: a document cannot contain code"):
        read_run(tmp_path / "run.yaml", [], RunCommandOptions(), "")


def test_an_event_of_the_episode_decides_when_an_image_is_taken(task: Path, tmp_path: Path) -> None:
    simulation = Simulation(read_task(task), policy=str(task.with_suffix(".onnx")), seed=3)
    Trace(simulation, str(tmp_path / "t.csv"), probe=["return"]).run()
    columns = read_table(tmp_path / "t.csv").columns
    begins = columns["time"][columns["return"] > 0.5][0]
    result = Image(
        simulation, str(tmp_path / "i.png"), time=ConditionEvent("return > 0.5"), size=(64, 48), text="{return:.3f}"
    ).run()
    assert result.time == begins
    assert result.episode is not None


def test_a_task_needs_a_policy_unless_it_is_replayed(task: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="is a task: select a policy for it"):
        Trace(Simulation(read_task(task)), str(tmp_path / "t.csv")).run()
    Recording(Simulation(read_task(task), policy="random", seed=1), str(tmp_path / "r.npz")).run()
    again = Simulation(read_task(task), replay=str(tmp_path / "r.npz"), replay_mode="controls")
    for name, simulation in (("a", Simulation(read_task(task), policy="random", seed=1)), ("b", again)):
        Trace(simulation, str(tmp_path / f"{name}.csv")).run()
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_a_study_varies_seeds_and_the_model_under_a_policy(task: Path, tmp_path: Path) -> None:
    policy, metrics = str(task.with_suffix(".onnx")), (("r", "last(return)"), ("calm", "mean(reward/calm)"))
    spec = StudySpec(Simulation(read_task(task), policy=policy), ("seed", "geom/lower.density"), metrics)
    spec.base.load()  # which leaves nothing behind that cannot be sent to another process
    spec = pickle.loads(pickle.dumps(spec))
    points = [("1", "500"), ("2", "500"), ("2", "2000")]
    results = {
        r.index: r for part in PointSimulator(spec).run([StudyPoint(i, p) for i, p in enumerate(points)]) for r in part
    }
    for index, (seed, density) in enumerate(points):
        simulation = Simulation(read_task(task), policy=policy, seed=int(seed), set={"geom/lower.density": density})
        alone = Trace(simulation, str(tmp_path / "t.csv"), probe=["reward", "return"]).run()
        columns = read_table(tmp_path / "t.csv").columns
        assert alone.episode is not None
        assert (results[index].status, results[index].metrics[0]) == ("ok", alone.episode.total)
        assert results[index].metrics[1] == pytest.approx(columns["reward/calm"].mean(), rel=1e-14)
    assert len({result.metrics for result in results.values()}) == 3


def test_a_policy_is_read_again_when_its_file_has_changed(task: Path) -> None:
    path = str(task.with_suffix(".onnx"))
    before = cached_policy(path, False, None)
    assert cached_policy(path, False, None) is before
    loaded = [before]
    for factor in (1, 2):  # whose files have the same size
        linear(Path(path), np.full((2, 3), factor, np.float32))
        os.utime(path, (0, 0))
        loaded.append(cached_policy(path, False, None))
    assert [each.facts.observation_size for each in loaded[1:]] == [3, 3]
    assert len({id(each) for each in loaded}) == 3
