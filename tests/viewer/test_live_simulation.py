"""A live simulation is a bare `mj_step` loop, with exactly the forces and controls of whoever looks at it."""

from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.errors import FileError, UsageError
from mjrun.formats.recording import RecordingReader
from mjrun.model import state
from mjrun.outputs.recording import Recording
from mjrun.simulation.simulation import Simulation
from mjrun.task.task import Action, Observation, Task
from mjrun.viewer.actions import PullBodies, SetStateNumbers
from mjrun.viewer.viewer import RECORDED, REPLAY, LiveSimulation, SessionRecording
from tests.reporters import RecordingReporter

ARM = """<mujoco><option timestep=".002"/><worldbody>
<body name="arm"><joint name="hip" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".02"/>
<body name="hand" pos=".3 0 0"><joint name="elbow" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".02"/></body></body>
<body name="target" mocap="true" pos="0 0 1"/></worldbody>
<actuator><motor name="hip" joint="hip"/><motor name="elbow" joint="elbow"/></actuator>
<keyframe><key name="up" qpos="1 0"/><key qpos="-1 .5"/></keyframe></mujoco>"""


@pytest.fixture
def arm() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(ARM)


def live_of(model: mujoco.MjModel, recording: SessionRecording | None = None, **settings: object) -> LiveSimulation:
    simulation = Simulation(model, **settings)  # type: ignore[arg-type]
    return LiveSimulation(simulation, simulation.load(), RecordingReporter(), recording)


def take(live: LiveSimulation, steps: int) -> None:
    for _ in range(steps):
        live.take_step()


def position(live: LiveSimulation) -> bytes:
    return live.instant().qpos.tobytes()


def forces(model: mujoco.MjModel, body: str, *wrench: float) -> np.ndarray:
    array = np.zeros((model.nbody, 6))
    array[model.body(body).id] = wrench
    return array


def edit_of(live: LiveSimulation, field: str, values: list[float]) -> SetStateNumbers:
    layout = state.fields(state.sizes(live.model))
    numbers, changed = np.zeros((2, state.size(live.model)))
    numbers[layout[field]], changed[layout[field]] = values, 1
    return SetStateNumbers(numbers, changed.astype(bool))


def test_undisturbed_it_is_a_bare_loop(arm: mujoco.MjModel) -> None:
    live = live_of(arm, ctrl={"hip": 0.2})
    take(live, 200)
    data = mujoco.MjData(arm)
    data.ctrl[0] = 0.2
    mujoco.mj_step(arm, data, nstep=200)
    assert (live.step, position(live)) == (200, data.qpos.tobytes())
    assert live.last is None
    assert not live.is_over


def test_forces_of_the_mouse_act_from_step_to_step_and_no_longer(arm: mujoco.MjModel) -> None:
    pull = forces(arm, "hand", 0, 0, 3, 0.1, 0, 0)
    live, data = live_of(arm), mujoco.MjData(arm)
    take(live, 10)
    live.pull(PullBodies(pull))
    take(live, 30)
    live.pull(PullBodies(np.zeros_like(pull)))
    take(live, 10)

    mujoco.mj_step(arm, data, nstep=10)
    data.xfrc_applied[:] = pull
    mujoco.mj_step(arm, data, nstep=30)
    data.xfrc_applied[:] = 0
    mujoco.mj_step(arm, data, nstep=10)
    assert position(live) == data.qpos.tobytes()


def test_they_come_on_top_of_those_of_a_controller(arm: mujoco.MjModel) -> None:
    own, pull = forces(arm, "arm", 0, 0, 1, 0, 0, 0), forces(arm, "hand", 0, 0, 2, 0, 0, 0) + 0.25

    def act(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.xfrc_applied[1] = own[1] * (1 + np.sin(data.time))

    live, data = live_of(arm, controller=act), mujoco.MjData(arm)
    live.pull(PullBodies(pull))
    take(live, 50)
    for _ in range(50):
        act(arm, data)
        applied = data.xfrc_applied.copy()
        data.xfrc_applied += pull
        mujoco.mj_step(arm, data)
        data.xfrc_applied[:] = applied
    live.pull(PullBodies(0 * pull))
    take(live, 20)
    for _ in range(20):
        act(arm, data)
        mujoco.mj_step(arm, data)
    assert position(live) == data.qpos.tobytes()


def test_a_control_that_is_set_stays_and_a_position_moves_the_simulation(arm: mujoco.MjModel) -> None:
    live, data = live_of(arm), mujoco.MjData(arm)
    take(live, 5)
    live.edit(edit_of(live, "ctrl", [0.5, -0.5]))
    live.edit(edit_of(live, "qpos", [0.7, 0.1]))
    take(live, 25)
    mujoco.mj_step(arm, data, nstep=5)
    data.ctrl[:], data.qpos[:] = [0.5, -0.5], [0.7, 0.1]
    mujoco.mj_step(arm, data, nstep=25)
    assert position(live) == data.qpos.tobytes()


def test_what_is_recorded_is_physics_and_replays_bit_for_bit(arm: mujoco.MjModel, tmp_path: Path) -> None:
    """From each recorded state, one bare step leads to the next: forces and controls are in it."""
    path = tmp_path / "run.npz"
    with SessionRecording(str(path), state.size(arm), {"sizes": state.sizes(arm)}) as recording:
        live = live_of(arm, recording)
        take(live, 5)
        live.reset()
        take(live, 10)
        live.pull(PullBodies(forces(arm, "hand", 0, 1, 3, 0, 0.2, 0)))
        take(live, 10)
        live.edit(edit_of(live, "ctrl", [0.5, -0.5]))
        live.edit(edit_of(live, "qpos", [0.7, 0.1]))  # refused
        take(live, 10)
        live.record_state()
        recording.publish()
    states = np.load(path)["states"]
    assert states.shape[0] == 31
    data, spec = mujoco.MjData(arm), int(mujoco.mjtState.mjSTATE_INTEGRATION)
    physics = slice(0, 1 + arm.nq + arm.nv)
    after = np.empty(states.shape[1])
    for now, following in pairwise(states):
        mujoco.mj_setState(arm, data, now, spec)
        mujoco.mj_step(arm, data)
        mujoco.mj_getState(arm, data, after, spec)
        assert after[physics].tobytes() == following[physics].tobytes()

    again = live_of(arm, replay=str(path))
    take(again, 30)
    assert position(again) == states[-1, 1 : 1 + arm.nq].tobytes()
    assert again.is_over


def test_positions_cannot_be_set_where_a_recording_holds_physics(arm: mujoco.MjModel, tmp_path: Path) -> None:
    notes = RecordingReporter()
    with SessionRecording(str(tmp_path / "run.npz"), state.size(arm), {}) as recording:
        simulation = Simulation(arm)
        live = LiveSimulation(simulation, simulation.load(), notes, recording)
        before = position(live)
        live.edit(edit_of(live, "qpos", [0.7, 0.1]))
        live.edit(edit_of(live, "qvel", [0.7, 0.1]))
        assert position(live) == before
        live.edit(edit_of(live, "mocap_pos", [1, 2, 3]))
        assert live.instant().mocap_pos.tolist() == [[1, 2, 3]]
    assert notes.texts == [RECORDED.what]  # once


def test_a_reset_begins_where_the_simulation_does_or_at_a_keyframe(arm: mujoco.MjModel) -> None:
    live = live_of(arm, key="up", duration=0.01)
    begin = position(live)
    take(live, 9)
    assert (live.step, live.is_over, live.last) == (5, True, 5)
    live.reset()
    assert (live.step, live.is_over, position(live)) == (0, False, begin)
    live.reset(1)
    assert live.instant().qpos.tolist() == [-1, 0.5]


def test_an_unstable_simulation_stays_at_its_last_good_step(exploding: Path) -> None:
    live = live_of(mujoco.MjModel.from_xml_path(str(exploding)), key="fast")
    take(live, 1000)
    assert live.failure
    assert live.failure.exit_code == 4
    assert live.step == live.failure.step < 100
    assert np.isfinite(live.instant().qpos).all()
    live.reset()
    assert live.failure is None
    assert live.step == 0


def test_a_replay_steps_and_resets_and_cannot_be_changed(arm: mujoco.MjModel, tmp_path: Path) -> None:
    path, notes = tmp_path / "run.npz", RecordingReporter()
    Recording(Simulation(arm, steps=20), str(path)).run()
    simulation = Simulation(arm, replay=str(path))
    live = LiveSimulation(simulation, simulation.load(), notes)
    states = np.load(path)["states"]
    for row in states:
        assert position(live) == row[1 : 1 + arm.nq].tobytes()
        live.pull(PullBodies(forces(arm, "hand", 0, 0, 9, 0, 0, 0)))
        live.edit(edit_of(live, "qpos", [1, 1]))
        live.take_step()
    assert live.is_over
    live.reset(1)
    assert position(live) == states[0, 1 : 1 + arm.nq].tobytes()
    assert notes.texts == [REPLAY.what]


def test_a_replay_with_gaps_is_refused(arm: mujoco.MjModel, tmp_path: Path) -> None:
    path = tmp_path / "gaps.npz"
    Recording(Simulation(arm, steps=20), str(path)).run()
    whole = dict(np.load(path))
    np.savez(path, states=whole["states"][::2], steps=whole["steps"][::2], facts=whole["facts"])
    with pytest.raises(UsageError, match=r"step 1, time 0\.002 s is not in the recording"):
        live_of(arm, replay=str(path))


def task_of(model: mujoco.MjModel, **values: object) -> Task:
    given = {
        "control_dt": 0.01,
        "duration": 0.1,
        "observations": [Observation(name="joints", joints=["*"])],
        "actions": [Action(actuators=["hip", "elbow"])],
        **values,
    }
    return Task(model, **given)  # type: ignore[arg-type]


def against(observation: np.ndarray) -> np.ndarray:
    return -0.1 * observation


def test_a_policy_drives_and_the_episode_ends_and_begins_again(arm: mujoco.MjModel) -> None:
    simulation = Simulation(task_of(arm), policy=against)
    live = LiveSimulation(simulation, simulation.load(), RecordingReporter())
    stepper = simulation.stepper(arm)
    for step in range(1, 51):
        live.take_step()
        assert live.is_over == (step == 50)
    stepper.advance(50)
    assert position(live) == stepper.instant().qpos.tobytes()
    take(live, 3)
    assert live.step == 50
    assert live.episode is not None
    assert (live.episode.ending, live.episode.time) == ("timeout", 0.1)
    live.reset(key=0)  # which an episode does not start at
    assert (live.step, live.instant().qpos.tolist(), live.is_over) == (0, [0, 0], False)


def test_a_policy_continues_for_as_long_as_is_reported(arm: mujoco.MjModel) -> None:
    simulation = Simulation(task_of(arm), policy=against, duration=0.15)
    live = LiveSimulation(simulation, simulation.load(), RecordingReporter())
    take(live, 100)
    assert (live.step, live.is_over) == (75, True)


def test_the_mouse_pulls_against_a_policy(arm: mujoco.MjModel) -> None:
    simulation = Simulation(task_of(arm), policy=against)
    live = LiveSimulation(simulation, simulation.load(), RecordingReporter())
    data, pull = mujoco.MjData(arm), forces(arm, "hand", 0, 0, 3, 0, 0, 0)
    for step in range(30):
        if step % 5 == 0:
            data.ctrl[:] = against(data.qpos)
        data.xfrc_applied[:] = pull if 7 <= step < 19 else 0
        live.pull(PullBodies(data.xfrc_applied.copy()))
        live.take_step()
        mujoco.mj_step(arm, data)
        assert position(live) == data.qpos.tobytes()


def test_a_restart_drops_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    with SessionRecording(str(path), 2, {"steps": 7, "by": "me"}) as recording:
        for step in range(5):
            recording.write(step, np.full(2, 10.0 + step))
        recording.restart()
        recording.restart()
        for step in range(3):
            recording.write(step, np.full(2, float(step)))
        recording.write(2, np.full(2, 9.0))  # the last one, once more
        assert recording.count == 3
        assert recording.publish() == [path]
    with RecordingReader(path) as reader:
        assert reader.steps.tolist() == [0, 1, 2]
        assert [reader.state(i).tolist() for i in range(3)] == [[0, 0], [1, 1], [2, 2]]
        assert (reader.facts["steps"], reader.facts["by"]) == (2, "me")


def test_without_states_or_publishing_the_old_file_stays(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    path.write_bytes(b"old")
    with SessionRecording(str(path), 1, {}) as recording:
        assert recording.publish() == []
    with SessionRecording(str(path), 1, {}) as recording:
        recording.write(0, np.zeros(1))
    assert path.read_bytes() == b"old"
    assert [file.name for file in tmp_path.iterdir()] == ["run.npz"]


def test_what_cannot_be_written_is_reported_at_once(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"\.npz"):
        SessionRecording(str(tmp_path / "run.csv"), 1, {})
    with pytest.raises(FileError):
        SessionRecording("/dev/null/run.npz", 1, {})
