"""Actions become controls in the order that is said, through exactly the actuators that are meant."""

import mujoco
import numpy as np
import pytest

from mjrun.errors import UsageError
from mjrun.task.action_map import ActionMap, TargetTorques
from mjrun.task.task import Action

MODEL = mujoco.MjModel.from_xml_string(
    """<mujoco><worldbody><body><freejoint name="root"/><geom size=".1"/>
    <body><joint name="hip"/><geom size=".1"/><body><joint name="knee" type="slide"/><geom size=".1"/></body></body>
    <body><joint name="wheel"/><geom size=".1"/></body><body><joint name="idle"/><geom size=".1"/></body></body>
    </worldbody><actuator><motor name="k" joint="knee" gear="4"/><motor name="h" joint="hip"/>
    <position name="w" joint="wheel" kp="3"/></actuator>
    <keyframe><key name="home" qpos="0 0 0 1 0 0 0 .1 .2 .3 .4" qvel="0 0 0 0 0 0 1 2 3 4" ctrl="5 6 7"/></keyframe>
    </mujoco>"""
)


def test_actions_are_squashed_clipped_scaled_and_offset_in_this_order() -> None:
    actions = ActionMap(
        [
            Action(actuators=["w", "h"], squash="tanh", clip=[-0.5, [0.2, 1]], scale=[2, 3], offset="home"),
            Action(actuators="k", offset=1),
        ],
        MODEL,
    )
    assert actions.names == ["w", "h", "k"]
    given = np.array([[0.1, -2, 9], [3, 0.3, -9]])
    expected = np.clip(np.tanh(given[:, :2]), -0.5, [0.2, 1]) * [2, 3] + [7, 6]
    np.testing.assert_array_equal(actions.targets(given), np.column_stack([expected, given[:, 2] + 1]))


def test_joints_come_in_the_order_said_with_their_defaults_of_a_keyframe() -> None:
    servo = ActionMap([Action(joints=["wheel"], target="control", offset="home")], MODEL)
    torque = ActionMap([Action(joints=["knee", "h*"], target="position", kp=[1, 2], kd=3, offset="home")], MODEL)
    assert (servo.offset.tolist(), torque.offset.tolist()) == ([0.3], [0.2, 0.1])
    assert [each.control for each in torque.driven] == [0, 1]
    speed = ActionMap([Action(joints="hip", target="velocity", kd=3, offset="home")], MODEL)
    assert speed.offset.tolist() == [1]


def test_torques_hold_targets_by_the_formula() -> None:
    actions = ActionMap(
        [
            Action(joints="knee", target="position", kp=50, kd=2),
            Action(joints="hip", target="velocity", kd=3),
            Action(actuators="w"),
        ],
        MODEL,
    )
    torques = TargetTorques(actions, MODEL, 2)
    for world in range(2):
        torques.begin(world, MODEL)
    assert torques.is_needed
    generator = np.random.default_rng(0)
    qpos, qvel = generator.normal(size=(2, MODEL.nq)), generator.normal(size=(2, MODEL.nv))
    ctrl, targets = np.zeros((2, 3)), generator.normal(size=(2, 3))
    for rows in (slice(None), np.array([1, 0])):
        ctrl[:] = 0
        torques.apply(targets[rows], ctrl, rows)
        torques.hold(targets[rows], qpos, qvel, ctrl, rows)
        np.testing.assert_array_equal(ctrl[:, 0], (50 * (targets[:, 0] - qpos[:, 8]) - 2 * qvel[:, 7]) / 4)
        np.testing.assert_array_equal(ctrl[:, 1], 3 * (targets[:, 1] - qvel[:, 6]))
        np.testing.assert_array_equal(ctrl[:, 2], targets[:, 2])


@pytest.mark.parametrize(
    ("action", "message", "path"),
    [
        (Action(actuators=["h", "q"]), "no actuator 'q'", ("actuators", 1)),
        (Action(joints="idle", target="torque"), "0 actuators, not one", ("joints", 0)),
        (Action(joints="wheel", target="torque"), "is not a motor", ("target",)),
        (Action(actuators="*", scale=[1, 2]), "one number, or 3", ("scale",)),
        (Action(actuators="*", offset="hom"), "no keyframe 'hom'", ("offset",)),
        (Action(joints="hip", target="torque", offset="home"), "does not store torques", ("offset",)),
    ],
)
def test_what_does_not_fit_is_told_where_it_stands(action: Action, message: str, path: tuple[str | int, ...]) -> None:
    with pytest.raises(UsageError, match=message) as caught:
        ActionMap([action], MODEL)
    assert caught.value.path[:3] == ("actions", 0, path[0])


def test_an_actuator_is_driven_once() -> None:
    with pytest.raises(UsageError, match="driven twice"):
        ActionMap([Action(actuators="*"), Action(joints="hip", target="torque")], MODEL)


def test_a_torque_is_that_of_the_joint_after_an_actuator_with_several_gears() -> None:
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body><joint name="ball" type="ball"/><geom size=".1"/></body>
        <body pos="1 0 0"><joint name="hinge"/><geom size=".1"/></body></worldbody><actuator>
        <orientation name="turn" joint="ball"/><motor name="push" joint="hinge" gear="4"/></actuator></mujoco>"""
    )
    torques = TargetTorques(ActionMap([Action(joints="hinge", target="torque")], model), model, 1)
    torques.begin(0, model)
    data = mujoco.MjData(model)
    torques.apply(np.array([[1.5]]), data.ctrl[None], slice(None))
    mujoco.mj_forward(model, data)
    assert data.joint("hinge").qfrc_actuator == pytest.approx(1.5)


@pytest.mark.parametrize(
    "actuator",
    [
        "motor gear='3'",
        "general gainprm='-2' gear='0.5'",
        "motor gear='0'",
        "general gainprm='0'",
        "position kp='3'",
        "velocity kv='3'",
        "damper kv='3' ctrlrange='0 1'",
        "general gaintype='affine' gainprm='2 1 0'",
        "general biastype='affine' biasprm='1 0 0'",
        "general dyntype='integrator'",
        "general dyntype='filter' dynprm='.1'",
        "muscle lengthrange='0 1'",
    ],
)
def test_a_joint_accepts_torques_if_mujocos_torque_is_proportional_to_the_control(actuator: str) -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint name="j"/><geom size=".1"/></body></worldbody>'
        f"<actuator><{actuator} joint='j'/></actuator></mujoco>"
    )
    data = mujoco.MjData(model)
    generator = np.random.default_rng(0)
    controls, torques = generator.uniform(0.1, 1, size=5), np.empty(5)
    for i, control in enumerate(controls):
        data.qpos[:], data.qvel[:], data.ctrl[:] = *generator.normal(size=2), control
        data.act[:] = generator.uniform(size=model.na)
        mujoco.mj_forward(model, data)
        torques[i] = data.qfrc_actuator[0]
    is_motor = torques.all() and np.ptp(torques / controls) < 1e-12

    action = Action(joints="j", target="torque")
    if is_motor:
        ActionMap([action], model)
    else:
        with pytest.raises(UsageError, match="is not a motor"):
            ActionMap([action], model)
