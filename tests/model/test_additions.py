"""Servos in place of motors: the same as written by hand, stable, and as strong as the motors."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

import mjrun
from mjrun.errors import BadValueError, UsageError
from mjrun.model.additions import GROUND, servo_sentence, servos
from mjrun.model.override import Override
from mjrun.model.sources import load, parse_source
from mjrun.model.variants import VariantLoader
from mjrun.options.option import options_of
from mjrun.simulation.simulation import Simulation

ARM = """
<mujoco>
  <option integrator="{integrator}" timestep="0.001"><flag contact="disable" gravity="{gravity}"/></option>
  <worldbody>
    <body><joint name="hip" axis="0 1 0" range="-90 90"/><geom size=".05" pos=".3 0 0" mass="2"/>
      <body pos=".3 0 0">
        <joint name="rail" type="slide" axis="1 0 0" actuatorfrcrange="-9 9"/><geom size=".05" mass="1"/>
      </body>
    </body>
  </worldbody>
  <actuator>{actuators}</actuator>
  <keyframe><key name="up" qpos="0.4 0.1" {key}/></keyframe>
</mujoco>
"""
MOTORS = """
<motor name="hip" joint="hip" gear="-2" ctrlrange="-3 4"/>
<general name="rail" joint="rail" gainprm="5" gear="2" ctrlrange="-1 1" forcerange="-3 9"/>
"""
SERVOS = """
<position name="hip" joint="hip" kp="70" kv="3" ctrlrange="-1.5707963267948966 1.5707963267948966" forcerange="-8 6"/>
<position name="rail" joint="rail" kp="70" kv="3" forcerange="-6 10"/>
"""


def written(path: Path, actuators: str = MOTORS, integrator: str = "Euler", gravity: str = "enable") -> str:
    path.write_text(ARM.format(actuators=actuators, integrator=integrator, gravity=gravity, key=""))
    return str(path)


@pytest.fixture
def arm(tmp_path: Path) -> str:
    return written(tmp_path / "arm.xml")


def with_servos(model: str, gains: str = "auto") -> mujoco.MjModel:
    return load(model, overrides=[Override("", gains, "position_control")])


def test_servos_are_those_that_one_writes_by_hand(arm: str, tmp_path: Path) -> None:
    own = mjrun.Simulation(
        written(tmp_path / "own.xml", SERVOS), key="up", ctrl={"hip": 0.4, "rail": 0.1}, duration=0.5
    )
    made = mjrun.Simulation(arm, position_control="kp=70,kd=3", key="up", duration=0.5)
    one, other = (mjrun.trace(each, probe=["qpos", "qvel", "ctrl", "actuator_force"]) for each in (own, made))
    for name in one:
        assert np.array_equal(one[name], other[name]), name
    assert np.ptp(one["qpos/hip"]) > 0.01


@pytest.mark.parametrize("kp", [40.0, 400.0])
def test_without_kd_a_servo_is_critically_damped(tmp_path: Path, kp: float) -> None:
    free = '<motor name="hip" joint="hip"/><motor name="rail" joint="rail"/>'
    model = with_servos(written(tmp_path / "a.xml", free, "RK4", "disable"), f"kp={kp}")
    data = mujoco.MjData(model)
    model.body_mass[1], model.jnt_actfrclimited[:] = 1e6, False  # the rail moves alone
    target = 0.02
    data.ctrl[1] = target
    frequency = np.sqrt(kp * model.dof_invweight0[1])
    for step in range(300):
        time = step * 0.001 * frequency
        assert data.qpos[1] == pytest.approx(target * (1 - (1 + time) * np.exp(-time)), abs=2e-4 * target)
        mujoco.mj_step(model, data)


def test_servos_are_as_strong_as_the_motors(arm: str) -> None:
    model = with_servos(arm)
    assert model.actuator_forcerange.tolist() == [[-8, 6], [-6, 10]]
    motors = load(arm)
    for name, controls in (("hip", (-3, 4)), ("rail", (-1, 1))):
        index = motors.actuator(name).id
        torques = []
        for control in controls:
            data = mujoco.MjData(motors)
            data.ctrl[index] = control
            mujoco.mj_forward(motors, data)
            torques.append(data.actuator_force[index] * motors.actuator_gear[index, 0])
        assert sorted(torques) == model.actuator_forcerange[index].tolist()
    assert model.actuator_ctrlrange[0].tolist() == model.jnt_range[0].tolist()
    assert not model.actuator_ctrllimited[1]


def test_the_initial_position_is_held_until_a_control_is_given(arm: str) -> None:
    start = Simulation(arm, position_control="auto", key="up", qpos={"rail": 0.05})
    assert start.initial_data(start.load()).ctrl.tolist() == [0.4, 0.05]
    other = Simulation(arm, position_control="auto", key="up", ctrl={"hip": 0.1})
    assert other.initial_data(other.load()).ctrl.tolist() == [0.1, 0.1]
    plain = Simulation(arm, key="up")
    assert plain.initial_data(plain.load()).ctrl.tolist() == [0, 0]


def test_a_model_without_actuators_gets_a_servo_on_each_joint(tmp_path: Path) -> None:
    bare = written(tmp_path / "bare.xml", "")
    model = with_servos(bare)
    assert [model.actuator(i).name for i in range(model.nu)] == ["hip", "rail"]
    assert servos(model) == [0, 1]
    table = mjrun.trace(bare, position_control="auto", key="up", duration=2, probe="qpos")
    assert abs(table["qpos/hip"] - 0.4).max() < 0.15
    assert abs(table["qpos/rail"] - 0.1).max() < 0.06


@pytest.mark.parametrize("name", ["gym:Ant-v5", "gym:Walker2d-v5", "gym:Humanoid-v5"])
def test_derived_gains_hold_walking_machines_in_their_pose(name: str) -> None:
    model = parse_source(name, [Override("", "auto", "position_control")]).load()
    data = mujoco.MjData(model)
    joints = model.actuator_trnid[:, 0]
    positions = model.jnt_qposadr[joints]
    data.ctrl[:] = data.qpos[positions]
    while data.time < 1:
        mujoco.mj_step(model, data)
    # The ant starts beyond its limits.
    wanted = np.where(model.jnt_limited[joints], np.clip(data.ctrl, *model.jnt_range[joints].T), data.ctrl)
    assert abs(data.qpos[positions] - wanted).max() < 0.4
    assert np.isfinite(data.qacc).all()
    assert servo_sentence(model).startswith(f"{model.nu} servos, kp ")


def test_other_overrides_do_not_change_the_gains_and_may_replace_them(arm: str) -> None:
    usual = Simulation(arm, position_control="auto").load()
    heavy = Simulation(arm, position_control="auto", set={"scale:geom/*.mass": 9}, timestep=0.002).load()
    assert np.array_equal(usual.actuator_gainprm, heavy.actuator_gainprm)
    soft = Simulation(arm, position_control="auto", set={"actuator/rail.gainprm[0]": 3}).load()
    assert (soft.actuator_gainprm[1, 0], soft.actuator_gainprm[0, 0]) == (3, usual.actuator_gainprm[0, 0])


def test_variants_of_a_study_are_compiled_as_each_alone(arm: str) -> None:
    variants = VariantLoader()
    for mass in ("1", "2", "5"):
        source = Simulation(arm, position_control="auto", set={"geom/1.mass": mass}).source
        expected = source.load()
        made = variants.load(source).model
        assert np.array_equal(made.actuator_gainprm, expected.actuator_gainprm)
        assert np.array_equal(made.body_mass, expected.body_mass)


@pytest.mark.parametrize(
    ("actuators", "message"),
    [
        ("<position joint='hip'/>", "its actuators are servos already"),
        ("<muscle joint='hip' lengthrange='0 1'/>", "none of its actuators is a motor"),
    ],
)
def test_models_without_motors_are_refused(tmp_path: Path, actuators: str, message: str) -> None:
    with pytest.raises(UsageError, match=f"position_control does not apply to this model: {message}"):
        Simulation(written(tmp_path / "a.xml", actuators), position_control="auto").load()
    (tmp_path / "b.xml").write_text("<mujoco><worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>")
    with pytest.raises(UsageError, match="it has no hinge or slide joint with a name"):
        Simulation(tmp_path / "b.xml", position_control="auto").load()


@pytest.mark.parametrize("text", ["", "kp", "kp=-1", "kp=0", "kv=3", "kp=nan", "kp=1,kd=x"])
def test_gains_are_positive_numbers(text: object) -> None:
    with pytest.raises(BadValueError, match="auto, or gains as in kp=50,kd=2"):
        Simulation("scene:pendulum", position_control=text)  # type: ignore[arg-type]


def test_a_keyframe_is_not_saved_for_actuators_that_the_file_lacks(arm: str, tmp_path: Path) -> None:
    job = mjrun.Keyframe(Simulation(arm, position_control="auto", steps=1), tmp_path / "key.xml")
    with pytest.raises(UsageError, match="position_control and a keyframe exclude each other"):
        job.run()
    assert not (tmp_path / "key.xml").exists()


def test_tasks_say_themselves_what_actions_control(arm: str) -> None:
    with pytest.raises(UsageError, match="policy and position_control exclude each other"):
        Simulation("scene:car_drive", policy="zero", position_control="auto")
    for cls in (mjrun.Evaluation, mjrun.Bench):
        assert "position_control" not in {option.name for option in options_of(cls)}


def test_a_recording_is_replayed_on_the_same_servos(arm: str, tmp_path: Path) -> None:
    made = Simulation(arm, position_control="auto", key="up", duration=0.1)
    mjrun.Recording(made, tmp_path / "r.npz").run()
    again = Simulation(arm, position_control="auto", replay=str(tmp_path / "r.npz"), replay_mode="controls")
    one, other = (mjrun.trace(each, probe=["qpos", "ctrl"]) for each in (made, again))
    assert all(np.array_equal(one[name], other[name]) for name in one)


def test_a_ground_is_a_plane_in_a_last_body_and_the_motion_that_of_such_a_model(tmp_path: Path) -> None:
    ball = '<body name="ball" pos="0 0 .2"><freejoint/><geom size=".1"/></body>'
    plane = '<body pos="0 0 -.1"><geom type="plane" size="0 0 .05"/></body>'
    path = tmp_path / "ball.xml"
    path.write_text(f"<mujoco><worldbody>{ball}</worldbody></mujoco>")
    simulation = mjrun.Simulation(path, ground=-0.1)
    models = [
        simulation.load(),
        mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{ball}{plane}</worldbody></mujoco>"),
    ]
    ends = []
    for model in models:
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, nstep=500)
        ends.append(data.qpos.copy())
    assert np.array_equal(*ends)
    assert ends[0][2] == pytest.approx(0, abs=0.01)


def test_a_ground_needs_a_free_name(tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_text('<mujoco><worldbody><geom name="ground" size=".1"/></worldbody></mujoco>')
    with pytest.raises(UsageError, match=f"already has a body or a geom called {GROUND}"):
        mjrun.Simulation(path, ground=0).load()


@pytest.mark.parametrize(
    ("plane", "is_floor"),
    [('pos="0 0 .2"', True), ('pos="3 4 .2"', True), ('pos="0 0 .1"', False), ('pos="0 0 .2" euler="90 0 0"', False)],
)
def test_a_second_floor_whose_contacts_would_count_twice_is_refused(tmp_path: Path, plane: str, is_floor: bool) -> None:
    path = tmp_path / "m.xml"
    path.write_text(f'<mujoco><worldbody><geom name="base" type="plane" size="1 1 1" {plane}/></worldbody></mujoco>')
    simulation = mjrun.Simulation(path, ground=0.2)
    if is_floor:
        with pytest.raises(UsageError, match="the model has a floor at this height already, base"):
            simulation.load()
    else:
        assert simulation.load().ngeom == 2


def test_servos_hold_the_position_beside_actuators_with_several_controls_and_with_gears(tmp_path: Path) -> None:
    bodies = "".join(
        f'<body pos="{x} 0 0"><joint name="{name}" type="{kind}" axis="0 1 0"/><geom size=".1" mass="1"/></body>'
        for x, (name, kind) in enumerate([("ball", "ball"), ("hip", "hinge"), ("knee", "hinge")])
    )
    actuators = """<actuator><orientation joint="ball"/><motor name="hip" joint="hip" gear="2" ctrlrange="-3 3"/>
      <position name="knee" joint="knee" kp="10" gear="2"/></actuator>"""
    path = tmp_path / "arm.xml"
    path.write_text(f"<mujoco><option gravity='0 0 0'/><worldbody>{bodies}</worldbody>{actuators}</mujoco>")
    simulation = Simulation(str(path), position_control="auto", qpos={"hip": 0.5, "knee": 0.3})
    model = simulation.load()
    assert [model.actuator(index).name for index in servos(model)] == ["hip", "knee"]
    assert model.actuator_forcerange[1].tolist() == [-6, 6]
    data = simulation.initial_data(model)
    mujoco.mj_forward(model, data)
    assert np.abs(data.qfrc_actuator[3:]).max() < 1e-9
