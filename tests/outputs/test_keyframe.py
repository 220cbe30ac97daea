"""Keyframes and recordings of a simulation."""

import json
import re
import warnings
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from mjrun.errors import FileError, ModelError, UnstableError, UsageError
from mjrun.model import state
from mjrun.model.override import Override
from mjrun.model.sources import load
from mjrun.model.sources.file import FileSource
from mjrun.outputs.keyframe import Keyframe, KeyframeResult
from mjrun.outputs.perform import perform, preview
from mjrun.outputs.recording import Recording
from mjrun.outputs.trace import Trace
from mjrun.simulation.simulation import Simulation
from tests.cases import cases
from tests.reporters import RecordingReporter

SCENES = Path(__file__).parents[2] / "scenes"
MOCAP = """<?xml version="1.0" encoding="UTF-8"?>
<!-- é: what a hand drags -->
<mujoco>
  <worldbody>
    <body name="hand" mocap="true" pos="0 0 1" quat=".6 .8 0 0"><geom size=".05"/></body>
    <body name="box" pos="0 0 .5"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
    <body pos="1 0 1"><joint name="arm" axis="0 1 0"/><geom size=".1" pos=".3 0 0"/></body>
  </worldbody>
  <equality><weld body1="hand" body2="box"/></equality>
  <actuator><general name="lag" joint="arm" dyntype="filter" dynprm=".1"/></actuator>
</mujoco>
"""
KEY_FIELDS = ("time", "qpos", "qvel", "act", "ctrl", "mocap_pos", "mocap_quat")


def copied(name: str, folder: Path) -> Path:
    path = folder / f"{name}.xml"
    path.write_bytes(MOCAP.encode() if name == "mocap" else (SCENES / f"{name}.xml").read_bytes())
    return path


def last_state(recording: Path) -> np.ndarray:
    return np.load(recording)["states"][-1]


@pytest.mark.parametrize("in_place", [False, True])
@cases("name, options")
def test_the_next_simulation_starts_where_this_one_ended(
    tmp_path: Path, name: str, options: dict[str, object], in_place: bool
) -> None:
    path = copied(name, tmp_path)
    before = path.read_bytes()
    target = path if in_place else tmp_path / "saved.xml"
    simulation = Simulation(path, steps=123, **options)  # type: ignore[arg-type]
    perform([Keyframe(simulation, str(target), name="résumé"), Recording(simulation, f"{tmp_path}/r.npz")])

    model = load(target)
    started = Simulation(target, key="résumé").start.data(model)
    expected = mujoco.MjData(model)
    state.restore(model, expected, last_state(tmp_path / "r.npz"))
    for field in KEY_FIELDS:
        assert np.asarray(getattr(started, field)).tobytes() == np.asarray(getattr(expected, field)).tobytes(), field

    after = target.read_bytes()
    start, end = after.index('<key name="résumé"'.encode()), after.rindex(b"/>", 0, after.index(b"</keyframe>")) + 2
    untouched = after[:start].rstrip() + after[end:]
    assert b"".join(before.split()) in {
        b"".join(untouched.split()),
        b"".join(untouched.replace(b"<keyframe>", b"").replace(b"</keyframe>", b"").split()),
    }
    assert path.read_bytes() == (after if in_place else before)


def test_a_keyframe_is_an_output_like_others(tmp_path: Path) -> None:
    path = copied("mocap", tmp_path)
    target, manifest = tmp_path / "a.xml", tmp_path / "a.json"
    job = Keyframe(Simulation(path, duration=0.02), str(target), manifest=str(manifest))
    assert preview([job]).outputs[0].kind == "keyframe"
    assert not target.exists()
    result = job.run()
    assert (result.path, result.name, result.step, result.time) == (str(target), "end", 10, 0.02)
    facts = json.loads(manifest.read_text())
    assert facts["result"]["name"] == "end"
    assert str(target) in json.dumps(facts)


@pytest.mark.parametrize(("when", "step"), [({"time": 0}, 0), ({"time": "1/30"}, 17), ({"step": 9}, 9), ({}, 60)])
def test_it_holds_the_instant_that_is_asked_for(tmp_path: Path, when: dict[str, Any], step: int) -> None:
    path = copied("mocap", tmp_path)
    simulation = Simulation(path, steps=60, qvel={"box": (1, 2, 3, 1, 2, 3)})
    jobs = [Keyframe(simulation, f"{tmp_path}/a.xml", **when), Recording(simulation, f"{tmp_path}/r.npz")]
    result = perform(jobs)[0]
    assert isinstance(result, KeyframeResult)
    assert (result.step, result.time) == (step, step / 500)
    model = load(tmp_path / "a.xml")
    part = state.fields(state.sizes(model))["qpos"]
    assert np.array_equal(model.key("end").qpos, np.load(tmp_path / "r.npz")["states"][step][part])


def test_it_is_saved_with_the_controls_and_from_replays_too(tmp_path: Path) -> None:
    path = copied("mocap", tmp_path)

    def act(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.ctrl[0] = round(1 + data.time, 9)
        data.mocap_pos[0] = 0.1, 0.2, data.time

    driven = Simulation(path, steps=20, controller=act)
    perform([Keyframe(driven, f"{tmp_path}/a.xml"), Recording(driven, f"{tmp_path}/r.npz")])
    key = load(tmp_path / "a.xml").key("end")
    assert key.ctrl[0] == 1.04
    assert key.mpos[2] == key.time[0]

    Keyframe(Simulation(path, replay=f"{tmp_path}/r.npz"), f"{tmp_path}/b.xml").run()
    assert (tmp_path / "b.xml").read_bytes() == (tmp_path / "a.xml").read_bytes()


def test_overrides_are_not_in_the_file_and_that_is_reported(tmp_path: Path) -> None:
    path, reporter = copied("mocap", tmp_path), RecordingReporter()
    light = Simulation(path, steps=50, set={"opt.gravity": "0,0,-1"}, timestep=0.001)
    Keyframe(light, f"{tmp_path}/a.xml").run(reporter)
    (warning,) = reporter.warnings
    assert warning.endswith("without its overrides: opt.gravity=0,0,-1, opt.timestep=0.001 is left out")
    assert load(tmp_path / "a.xml").opt.gravity[2] == -9.81


@pytest.mark.parametrize(
    ("given", "lost"),
    [({"ground": -5}, []), ({"set": {"actuator/*.delay": "0.01"}}, ["history"])],
    ids=["ground", "delay"],
)
def test_a_keyframe_holds_the_state_of_a_model_that_overrides_have_extended(
    tmp_path: Path, given: dict[str, Any], lost: list[str]
) -> None:
    path, reporter = copied("mocap", tmp_path), RecordingReporter()
    longer = Simulation(path, steps=50, **given)
    Keyframe(longer, f"{tmp_path}/a.xml").run(reporter)
    overrides, *others = reporter.warnings
    name, value = next(iter(given.items()))
    setting = f"{name}={float(value)}" if name == "ground" else "actuator/*.delay=0.01"
    assert overrides.endswith(f"a.xml holds the model without its overrides: {setting} is left out")
    assert [text.split("does not hold ")[1].split(":")[0] for text in others] == lost

    model, key = longer.source.load(), load(tmp_path / "a.xml").key("end")
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=50)
    assert key.qpos.tolist() == data.qpos.tolist()
    assert key.qvel.tolist() == data.qvel.tolist()
    assert key.mpos.tolist() == data.mocap_pos.ravel().tolist()


def test_a_keyframe_of_a_model_with_other_activations_is_refused_before_the_first_step(tmp_path: Path) -> None:
    path = copied("mocap", tmp_path)
    simulation = Simulation(path, duration=1e9, set={"actuator/lag.dyntype": "none"})
    with pytest.raises(UsageError, match=re.escape("with actuator/lag.dyntype=none, na is 0, not 1")):
        Keyframe(simulation, f"{tmp_path}/a.xml").run()
    assert not (tmp_path / "a.xml").exists()


def test_what_a_push_leaves_is_reported(tmp_path: Path) -> None:
    path, reporter = copied("mocap", tmp_path), RecordingReporter()
    Keyframe(Simulation(path, steps=50, push="box=1/0/0@0+1"), f"{tmp_path}/a.xml").run(reporter)
    (warning,) = reporter.warnings
    assert warning.endswith("a.xml: a keyframe does not hold xfrc_applied: its value at this instant is lost")


@pytest.mark.parametrize("suffix", [".mjb", ".mjz", ".urdf"])
def test_a_model_without_xml_of_its_own_takes_no_key(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"m{suffix}"
    with pytest.raises(UsageError, match=rf"m{suffix} has no .xml file to add a keyframe to"):
        Keyframe(Simulation(path), f"{tmp_path}/a.xml").run()


def test_a_compiled_model_and_standard_input_take_no_key(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    with pytest.raises(UsageError, match=r"a compiled model has no .xml file to add"):
        Keyframe(Simulation(model), f"{tmp_path}/a.xml").run()
    with pytest.raises(UsageError, match=r"the model - has no .xml file to add"):
        Keyframe(Simulation("-"), f"{tmp_path}/a.xml").run()


@cases("output, name, message")
def test_an_output_that_cannot_be_is_refused(tmp_path: Path, output: str, name: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        Keyframe(Simulation(copied("mocap", tmp_path)), output, name=name).run()


@pytest.mark.parametrize("name", ["a\x01b", "a\0", "a\udce9b", "a\uffff"])
def test_a_name_that_xml_cannot_hold_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(UsageError, match="has a character that XML does not allow"):
        Keyframe(Simulation(copied("mocap", tmp_path)), f"{tmp_path}/o.xml", name=name).run()


def test_a_urdf_that_is_called_xml_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.xml"
    path.write_text('<robot name="r"><link name="a"/></robot>')
    with pytest.raises(UsageError, match=r"cannot add a key to .*m.xml: it is not MJCF: its root element is <robot>"):
        Keyframe(Simulation(path), f"{tmp_path}/a.xml").run()


def test_a_key_of_an_included_file_is_not_doubled(tmp_path: Path) -> None:
    (tmp_path / "keys.xml").write_text('<mujoco><keyframe><key name="home"/></keyframe></mujoco>')
    path = tmp_path / "m.xml"
    path.write_text('<mujoco><include file="keys.xml"/></mujoco>')
    with pytest.raises(UsageError, match=r"keyframe 'home' already exists in a file that the model includes"):
        Keyframe(Simulation(path), f"{tmp_path}/a.xml", name="home").run()
    Keyframe(Simulation(path, steps=1), f"{tmp_path}/a.xml").run()
    assert load(tmp_path / "a.xml").nkey == 2


def test_the_model_is_rewritten_by_a_keyframe_alone(tmp_path: Path) -> None:
    path = copied("mocap", tmp_path)
    simulation = Simulation(path, steps=1)
    with pytest.raises(UsageError, match="clashes with the model, which is read"):
        Trace(simulation, str(path), format="csv").run()
    with pytest.raises(UsageError, match="each output needs a separate file"):
        perform([Keyframe(simulation, str(path)), Trace(simulation, str(path), format="csv")])
    with pytest.raises(UsageError, match="each output needs a separate file"):
        perform([Keyframe(simulation, str(path), name="a"), Keyframe(simulation, str(path), name="b")])
    assert path.read_text() == MOCAP


def test_an_unstable_simulation_leaves_no_keyframe(exploding: Path, tmp_path: Path) -> None:
    with pytest.raises(UnstableError):
        Keyframe(Simulation(exploding, key="fast"), f"{tmp_path}/a.xml").run()
    assert not (tmp_path / "a.xml").exists()


def test_a_folder_that_cannot_be_made_is_reported_before_the_first_step(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="is not a folder"):
        Keyframe(Simulation(copied("mocap", tmp_path)), "/dev/null/a.xml").run()
    with pytest.raises(ModelError):
        Keyframe(Simulation(tmp_path / "no.xml"), f"{tmp_path}/a.xml").run()


def test_a_replay_gives_the_same_numbers_as_the_simulation(swing: Path, tmp_path: Path) -> None:
    live = Simulation(swing, steps=120, qvel={"hinge": 3})
    perform([Trace(live, f"{tmp_path}/a.csv"), Recording(live, f"{tmp_path}/r.npz")])
    Trace(Simulation(swing, replay=f"{tmp_path}/r.npz"), f"{tmp_path}/b.csv").run()
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    with pytest.raises(UsageError, match="the recording ends at step 120"):
        Trace(Simulation(swing, replay=f"{tmp_path}/r.npz", steps=121), f"{tmp_path}/c.csv").run()
    for start in ({"qvel": {"hinge": 1}}, {"key": "0"}, {"ctrl": {"motor": 1}}):
        with pytest.raises(UsageError, match=r"^replay and .* exclude each other: a recording holds all of the state"):
            Trace(Simulation(swing, replay=f"{tmp_path}/r.npz", **start), f"{tmp_path}/c.csv").run()  # type: ignore[arg-type]


@pytest.mark.parametrize("mode", ["states", "controls"])
@pytest.mark.parametrize(
    "option",
    [
        {"map": "time=t"},
        {"quat": "xyzw"},
        {"replay_rate": 100},
        {"replay_interpolation": "hold"},
        {"replay_unwrap": True},
        {"ctrl_interpolation": "linear"},
        {"ctrl_noise_time": 0.1},
    ],
)
def test_a_replay_of_a_recording_refuses_options_that_have_no_effect_on_it(
    swing: Path, tmp_path: Path, mode: str, option: dict[str, Any]
) -> None:
    Recording(Simulation(swing, steps=10), f"{tmp_path}/r.npz").run()
    with pytest.raises(UsageError, match=f"^{next(iter(option))} requires "):
        Trace(Simulation(swing, replay=f"{tmp_path}/r.npz", replay_mode=mode, **option), f"{tmp_path}/c.csv").run()


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"overrides": (Override("opt.gravity", "0,0,-1"),)}, True),
        ({"overrides": (Override("geom/box.mass", "50"),)}, True),
        ({"overrides": (Override("vis.map.force", "3"), Override("geom/box.rgba", "1,1,1,1"))}, False),
        ({}, False),
    ],
)
def test_a_recording_of_other_physics_is_reported(
    swing: Path, tmp_path: Path, change: dict[str, Any], told: bool
) -> None:
    Recording(Simulation(swing, duration=0.1), f"{tmp_path}/r.npz").run()
    again = Trace(
        Simulation(FileSource(swing, **change), replay=f"{tmp_path}/r.npz"), f"{tmp_path}/t.csv", probe=["energy"]
    )
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        again.run()
    assert any("other physics" in str(warning.message) for warning in heard) == told


def test_states_are_those_of_a_bare_loop(swing: Path, tmp_path: Path) -> None:
    result = Recording(Simulation(swing, steps=120, qvel={"hinge": 3}), f"{tmp_path}/r.npz").run()
    model = mujoco.MjModel.from_xml_path(str(swing))
    data = mujoco.MjData(model)
    data.joint("hinge").qvel = 3
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION)
    states = np.load(tmp_path / "r.npz")["states"]
    assert (result.states, result.size, result.simulated) == (121, size, 0.24)
    for recorded in states:
        expected = np.empty(size)
        mujoco.mj_getState(model, data, expected, mujoco.mjtState.mjSTATE_INTEGRATION)
        assert np.array_equal(recorded[1:], expected[1:])
        assert recorded[0] == pytest.approx(data.time)
        mujoco.mj_step(model, data)
