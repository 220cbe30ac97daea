"""Theorems about a simulation as a value: its length, start and model."""

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from mjrun.errors import BadValueError, ModelNotFoundError, UnknownNameError, UsageError, option
from mjrun.formats.table_reader import read_table
from mjrun.model.override import Override
from mjrun.model.sources.file import FileSource
from mjrun.outputs.perform import perform
from mjrun.outputs.recording import Recording
from mjrun.outputs.trace import Trace
from mjrun.python_code import load_code
from mjrun.simulation.simulation import Simulation
from mjrun.timeline import Timeline
from tests.cases import cases
from tests.model.model_files import content

XML = """<mujoco><worldbody><body><joint name="hinge"/><geom size=".1" pos="0 0 -1"/></body></worldbody>
<actuator><motor name="motor" joint="hinge"/></actuator>
<keyframe><key/><key name="swing" qpos="1" qvel="2" ctrl="3"/></keyframe></mujoco>"""
MODEL = mujoco.MjModel.from_xml_string(XML)
STEP = Fraction(1, 500)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    file = tmp_path / "model.xml"
    file.write_text(XML)
    return file


@pytest.mark.parametrize(
    ("how", "timeline"),
    [
        ({}, Timeline(STEP, Fraction(5), 2500)),
        ({"duration": 2}, Timeline(STEP, Fraction(2), 1000)),
        ({"duration": 0.3}, Timeline(STEP, Fraction(3, 10), 150)),
        ({"duration": "1/3"}, Timeline(STEP, Fraction(1, 3), 167)),
        ({"duration": Fraction(1, 3)}, Timeline(STEP, Fraction(1, 3), 167)),
        ({"steps": 1}, Timeline(STEP, STEP, 1)),
        ({"steps": 123456789}, Timeline(STEP, 123456789 * STEP, 123456789)),
    ],
)
def test_a_simulation_lasts_as_asked_or_five_seconds(how: dict[str, Any], timeline: Timeline) -> None:
    assert Simulation(MODEL, **how).timeline(MODEL) == timeline


def test_the_timestep_is_that_of_the_model_which_may_be_overridden(path: Path) -> None:
    simulation = Simulation(FileSource(path, overrides=(Override("opt.timestep", "0.01"),)), duration=1)
    assert simulation.timeline(simulation.load()) == Timeline(Fraction(1, 100), Fraction(1), 100)


def test_a_duration_and_a_number_of_steps_exclude_each_other() -> None:
    with pytest.raises(UsageError, match="duration and steps exclude each other"):
        Simulation(MODEL, duration=1, steps=1)


@pytest.mark.parametrize("duration", [0, -1, 0.0, "0", "-1/2", "x", "", "1/0", float("nan"), float("inf"), "inf"])
def test_a_duration_that_cannot_be_is_refused_before_the_model_is_loaded(duration: float | str) -> None:
    with pytest.raises(BadValueError) as caught:
        Simulation("no such model.xml", duration=duration)
    assert str(caught.value) == f"duration: {str(duration)!r} is not a positive number"


@pytest.mark.parametrize("steps", [0, -1, 2.5])
def test_a_number_of_steps_that_cannot_be_is_refused(steps: Any) -> None:
    with pytest.raises(BadValueError) as caught:
        Simulation(MODEL, steps=steps)
    assert str(caught.value) == f"steps: '{steps}' is not a whole number of at least 1"


@pytest.mark.parametrize("how", [{"duration": 1e300}, {"duration": "1e299"}, {"steps": 10**17}])
def test_more_steps_than_can_be_counted_are_refused_before_the_first(how: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match=r"^(duration|steps): more than 9e\+15 steps"):
        Simulation(MODEL, **how).timeline(MODEL)
    with pytest.raises(UsageError, match=r"^duration: more than 9e\+15 steps"):  # of the usual duration
        Simulation(MODEL).timeline(MODEL, timestep=Fraction(1, 10**16))


def test_a_compiled_model_is_copied_as_it_is() -> None:
    loaded = Simulation(MODEL).load()
    assert loaded is not MODEL
    assert content(loaded) == content(MODEL)


@pytest.mark.parametrize("kind", [str, Path, FileSource])
def test_a_path_is_loaded_however_it_is_given(path: Path, kind: Any) -> None:
    assert Simulation(kind(path)).load().joint("hinge").id == 0


def test_a_source_is_loaded_with_its_overrides(path: Path) -> None:
    source = FileSource(path, overrides=(Override("opt.gravity", "0,0,1"), Override("joint/hinge.damping", "7")))
    model = Simulation(source).load()
    assert model.opt.gravity.tolist() == [0, 0, 1]
    assert model.dof_damping.tolist() == [7]


def test_a_missing_model_is_missed_when_it_is_loaded_not_before() -> None:
    simulation = Simulation("no such model.xml")
    with pytest.raises(ModelNotFoundError):
        simulation.load()


@pytest.mark.parametrize("key", ["swing", 1, "1", "keyframe:1"])
def test_the_stepper_starts_from_the_key_with_names_set_over_it(key: str | int) -> None:
    data = Simulation(MODEL, key=key, qvel={"hinge": -2}).stepper(MODEL).instant()
    assert (data.time, data.qpos[0], data.qvel[0], data.ctrl[0]) == (0, 1, -2, 3)


def test_without_a_key_the_stepper_starts_from_the_models_own_state_not_from_its_first_key() -> None:
    data = Simulation(MODEL, qpos={"hinge": 0.5}, ctrl={"*": 4}).stepper(MODEL).instant()
    assert (data.time, data.qpos[0], data.qvel[0], data.ctrl[0]) == (0, 0.5, 0, 4)


def test_an_unknown_key_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="no keyframe 'swng' \\(did you mean 'swing'"):
        Simulation(MODEL, key="swng").stepper(MODEL)


def test_the_same_simulation_moves_the_same_twice_and_as_a_bare_loop_and_leaves_the_model_alone() -> None:
    model = mujoco.MjModel.from_xml_string(XML)
    simulation = Simulation(model, key="swing", perturb=0.1, seed=3, steps=300)
    first, second = simulation.stepper(model), simulation.stepper(model)
    data = mujoco.MjData(MODEL)
    data.qpos[:], data.ctrl[:] = 1, 3
    data.qvel[:] = 2 + 0.1 * np.random.default_rng(3).standard_normal(1)
    for stepper in (first, second):
        stepper.advance(simulation.timeline(model).steps)
    mujoco.mj_step(MODEL, data, 300)
    assert first.state().tobytes() == second.state().tobytes()
    assert first.instant().qpos.tolist() == data.qpos.tolist()
    assert first.instant().qvel.tolist() == data.qvel.tolist()
    assert model.opt.disableflags == 0


def test_two_simulations_that_say_the_same_are_equal() -> None:
    assert Simulation("a.xml", key=1, duration=2) == Simulation("a.xml", key=1, duration=2)
    assert Simulation("a.xml", key=1, duration=2) != Simulation("a.xml", key=1, duration=3)


def test_a_control_that_is_held_has_no_column_in_the_table_too(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint name="j"/><geom size=".1"/></body></worldbody>'
        '<actuator><motor name="a" joint="j"/><motor name="b" joint="j"/></actuator></mujoco>'
    )
    table = tmp_path / "c.csv"
    table.write_text("time,ctrl/a\n0,1\n")
    for ctrl in ({"b": 2.0}, {"*": 2.0}):
        stepper = Simulation(model, duration=0.1, ctrl=ctrl, ctrl_from=table).stepper(model)
        stepper.advance(1)
        assert list(stepper.instant().ctrl) == [1, 2]
    with pytest.raises(UsageError, match=r"^ctrl and .*c\.csv both drive a$"):
        Simulation(model, duration=0.1, ctrl={"a": 2.0, "b": 2.0}, ctrl_from=table).stepper(model)


def test_pushes_act_on_rows_images_and_recordings_alike(tmp_path: Path) -> None:
    pushed = Simulation(MODEL, steps=40, push=["body:1=0/0/9@0.02+0.03"])
    recording, table, rows = (str(tmp_path / name) for name in ("run.npz", "run.csv", "alone.csv"))
    probe = ["qpos", "qacc", "xfrc_applied"]
    perform([Recording(pushed, recording), Trace(pushed, table, probe=probe)])
    Trace(pushed, rows, probe=probe).run()
    Trace(Simulation(MODEL, replay=recording), str(tmp_path / "again.csv"), probe=probe).run()
    contents = {(tmp_path / name).read_bytes() for name in ("run.csv", "alone.csv", "again.csv")}
    assert len(contents) == 1

    forces = read_table(table).columns["xfrc_applied/body:1/fz"]
    assert np.flatnonzero(forces).tolist() == [*range(10, 25)]


def test_a_push_that_is_too_late_or_of_a_body_that_cannot_move_is_remarked_on() -> None:
    late = Simulation(MODEL, steps=10, push="body:1=0/0/9@1+1")
    (remark,) = late.remarks(MODEL)
    assert remark.startswith(option("push"))
    assert remark.endswith("does nothing: it begins at step 500, and the simulation has 10 steps")


def test_code_that_was_edited_after_its_import_is_remarked_on(tmp_path: Path) -> None:
    path = tmp_path / "controller_that_is_edited.py"
    path.write_text("def act(model, data):\n    data.ctrl[:] = 1\n")
    controller = load_code(f"{path}:act", "controller", "FILE.py:NAME")
    assert isinstance(controller, Callable)
    simulation = Simulation(MODEL, steps=10, controller=controller)
    assert simulation.remarks(MODEL) == []
    path.write_text("def act(model, data):\n    data.ctrl[:] = 2\n")
    (remark,) = simulation.remarks(MODEL)
    assert remark == f"{path} was edited after Python had imported it: restart Python to use the new version"


def sway(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    data.ctrl[0] = np.sin(9 * data.time)
    data.xfrc_applied[1, 1] = data.time


def test_recorded_controls_run_the_physics_again_bit_for_bit(path: Path, tmp_path: Path) -> None:
    live = Simulation(path, steps=200, key="swing", controller=sway, control_dt=0.02)
    perform(
        [
            Trace(live, f"{tmp_path}/a.csv", probe=["qpos", "qvel", "ctrl", "energy", "xfrc_applied", "qacc"]),
            Recording(live, f"{tmp_path}/r.npz"),
        ]
    )
    replay: dict[str, Any] = {"replay": f"{tmp_path}/r.npz", "replay_mode": "controls"}
    Trace(
        Simulation(path, **replay),
        f"{tmp_path}/b.csv",
        probe=["qpos", "qvel", "ctrl", "energy", "xfrc_applied", "qacc"],
    ).run()
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    longer = Simulation(path, steps=300, **replay)  # states end, physics does not
    assert longer.stepper(MODEL).step == 0
    assert longer.remarks(MODEL)[-1].endswith(
        "r.npz ends at 0.4 s; its last controls, applied forces and mocap poses hold from then on"
    )
    assert Simulation(path, **replay).remarks(MODEL) == []
    heavier = mujoco.MjModel.from_xml_string(XML)
    heavier.body_mass[1] *= 2
    (text,) = Simulation(path, **replay).remarks(heavier)
    assert (
        text
        == "the recording was made with other physics: the motion is computed by this model from the recorded inputs"
    )
    noisy = Simulation(path, ctrl_noise=0.5, **replay).stepper(MODEL)
    noisy.advance(200)
    calm = Simulation(path, **replay).stepper(MODEL)
    calm.advance(200)
    assert noisy.instant().qpos[0] != calm.instant().qpos[0]
    with pytest.raises(UsageError, match="the recording was made with another model"):
        Simulation(path, **replay).stepper(mujoco.MjModel.from_xml_string("<mujoco/>"))


def test_controls_of_a_table_start_from_its_first_row(path: Path, tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("time,qpos/hinge,qvel/hinge,ctrl/motor\n5,1,2,3\n5.1,0,0,-3\n5.2,0,0,0\n")
    for way, between in (("hold", [3] * 50), ("linear", 3 - 6 * np.arange(50) / 50)):
        simulation = Simulation(path, replay=f"{tmp_path}/t.csv", replay_mode="controls", ctrl_interpolation=way)
        assert simulation.timeline(MODEL).steps == 100
        data = mujoco.MjData(MODEL)
        data.qpos[:], data.qvel[:] = 1, 2
        for ctrl in between:
            data.ctrl[0] = ctrl
            mujoco.mj_step(MODEL, data)
        stepper = simulation.stepper(MODEL)
        stepper.advance(50)
        assert stepper.instant().qpos[0] == pytest.approx(data.qpos[0], abs=1e-12)
    (tmp_path / "u.csv").write_text("time,qpos/hinge\n0,1\n1,2\n")
    with pytest.raises(UsageError, match=r"u\.csv has no controls to replay; those of the model are ctrl/motor$"):
        Simulation(path, replay=f"{tmp_path}/u.csv", replay_mode="controls").stepper(MODEL)


def test_a_table_takes_what_it_lacks_from_the_start_that_is_asked_for(path: Path, tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("time,qpos/hinge\n0,0.5\n0.1,0.6\n")
    stepper = Simulation(path, replay=f"{tmp_path}/t.csv", key="swing", ctrl={"motor": 4}).stepper(MODEL)
    assert (stepper.instant().qpos[0], stepper.instant().ctrl[0]) == (0.5, 4)
    assert stepper.instant().qvel[0] == pytest.approx(1)
    with pytest.raises(UsageError, match=r"^the table ends at step 50, time 0\.1 s, before step 51"):
        Simulation(path, replay=f"{tmp_path}/t.csv", steps=51).stepper(MODEL)


def test_initial_values_that_a_replayed_table_replaces_are_reported(path: Path, tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("time,qpos/hinge\n0,0.5\n0.1,0.6\n")
    replayed = Simulation(path, replay=f"{tmp_path}/t.csv")
    assert not replace(replayed, qpos={"hinge": 0.5}).remarks(MODEL)
    (remark,) = replace(replayed, qpos={"hinge": 0.4}).remarks(MODEL)
    assert remark == f"{option('qpos')} hinge does nothing: {tmp_path}/t.csv sets it"
    (remark,) = replace(replayed, qvel={"hinge": 0}, qpos={"hinge": 0.5}, key="swing").remarks(MODEL)
    assert remark.startswith(f"{option('qvel')} hinge does nothing: ")


def test_what_is_read_is_known_by_what_it_is(path: Path, tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("t,a\n0,1\n")
    (tmp_path / "n.map").write_text("time=t\nqpos/hinge=a\n")
    simulation = Simulation(path, replay=tmp_path / "t.csv", map=f"@{tmp_path}/n.map")
    assert simulation.inputs[-2:] == [("table", tmp_path / "t.csv"), ("file of columns", tmp_path / "n.map")]
    assert simulation.stepper(MODEL).instant().qpos[0] == 1


def test_faults_of_a_table_are_reported_at_replay_and_those_of_its_reading_at_their_options(
    path: Path, tmp_path: Path
) -> None:
    (tmp_path / "t.csv").write_text("t,a\n0,1\n")
    for texts, place in ((["time=t"], ("replay",)), (["time=t", "qpos/hinge=b"], ("map", 1))):
        with pytest.raises(UsageError) as caught:
            Simulation(path, replay=f"{tmp_path}/t.csv", map=texts).timeline(MODEL)
        assert caught.value.path == place
    with pytest.raises(UsageError, match="for tables without one") as caught:
        Simulation(path, replay=f"{tmp_path}/t.csv", map=["time=t", "qpos/hinge=a"], replay_rate=5).timeline(MODEL)
    assert caught.value.path == ("replay_rate",)


@cases("options")
def test_options_about_a_table_a_controller_or_noise_need_one(path: Path, options: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match=rf"^{next(iter(options))} requires "):
        Simulation(path, **options).stepper(MODEL)
    Simulation(path, quat="wxyz", replay_mode="states").stepper(MODEL)  # as if nothing were said
    Simulation(path, ctrl_noise=0, ctrl_noise_time=0.1).stepper(MODEL)


@cases("values")
def test_other_values_are_those_of_replace(path: Path, values: dict[str, Any]) -> None:
    def outcome(make: Callable[..., Simulation]) -> object:
        try:
            made = make()
        except UsageError as error:
            return type(error), str(error)
        return made, made.source

    for base in (Simulation(str(path)), Simulation(str(path), ctrl={"motor": 1}, steps=7)):
        assert outcome(lambda base=base: base.with_values(values)) == outcome(lambda base=base: replace(base, **values))


@pytest.mark.parametrize("name", ["ctrl_from", "replay"])
def test_standard_input_is_no_table_that_is_read_more_than_once(name: str) -> None:
    values: dict[str, Any] = {name: "-"}
    simulation = Simulation("scene:pendulum", duration=0.1, **values)
    with pytest.raises(UsageError, match=f"^{name}: this file is read more than once"):
        simulation.stepper(simulation.load())
