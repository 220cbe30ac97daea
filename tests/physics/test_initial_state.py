"""Theorems about starts: what is named is where it is put, the rest is as MuJoCo has it."""

import copy
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

from mjrun.errors import BadValueError, ModelError, UnknownNameError, UsageError, clean, spelled
from mjrun.options.setting_kinds import AngleWithUnit, LengthWithUnit
from mjrun.physics.initial_state import InitialState
from tests.cases import cases

MODEL = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
<body name="box"><freejoint name="root"/><geom size="1"/></body>
<body name="arm" pos="5 0 0"><joint name="shoulder" type="ball"/><geom size="1"/>
<body name="hand"><joint/><geom size="1"/></body>
<body name="two"><joint/><joint name="left/knee" axis="1 0 0"/><geom size="1"/></body></body></worldbody>
<actuator><motor name="motor" joint="left/knee" ctrlrange="-1 1"/><motor joint="left/knee"/></actuator>
<keyframe><key name="home" qpos="1 2 3 1 0 0 0 1 0 0 0 4 5 6" qvel="1 2 3 4 5 6 7 8 9 10 11 12" ctrl=".5 7"/>
<key ctrl="3 3" time="2"/></keyframe></mujoco>""")
# qpos: root 0–6, shoulder 7–10, hand 11, two 12 and 13; qvel: root 0–5, shoulder 6–8, hand 9, two 10 and 11


def change(**how: Any) -> dict[str, dict[int, float]]:
    """Where a start differs from MuJoCo's own."""
    data, plain = InitialState(**how).data(MODEL), mujoco.MjData(MODEL)
    found = {}
    for field in ("qpos", "qvel", "ctrl"):
        mine, other = getattr(data, field), getattr(plain, field)
        found |= {field: {int(i): float(mine[i]) for i in np.flatnonzero(mine != other)}}
    return {field: changed for field, changed in found.items() if changed}


def test_a_start_of_nothing_is_the_models_own() -> None:
    assert change() == {}


@pytest.mark.parametrize("key", ["home", "0", "keyframe:0"])
def test_a_keyframe_by_name_or_index_is_mujocos(key: str) -> None:
    expected = mujoco.MjData(MODEL)
    mujoco.mj_resetDataKeyframe(MODEL, expected, 0)
    data = InitialState(key=key).data(MODEL)
    for field in ("time", "qpos", "qvel", "act", "ctrl", "mocap_pos"):
        assert np.array_equal(getattr(data, field), getattr(expected, field))
    assert data.qpos.tolist() == [1, 2, 3, 1, 0, 0, 0, 1, 0, 0, 0, 4, 5, 6]


def test_an_unnamed_keyframe_answers_to_its_index() -> None:
    assert change(key="1") == change(key="keyframe:1") == {"ctrl": {0: 3, 1: 3}}


@cases("how, expected")
def test_what_is_named_is_where_it_is_put_and_nothing_else_moves(
    how: dict[str, Any], expected: dict[str, dict[int, float]]
) -> None:
    assert change(**how) == expected


def test_names_are_set_over_the_keyframe() -> None:
    data = InitialState(key="home", qpos={"hand": -1}, qvel={"root/vx": -2}, ctrl={"motor": -3}).data(MODEL)
    assert data.qpos.tolist() == [1, 2, 3, 1, 0, 0, 0, 1, 0, 0, 0, -1, 5, 6]
    assert data.qvel.tolist() == [-2, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]
    assert data.ctrl.tolist() == [-3, 7]


def test_noise_of_the_same_seed_is_the_same_and_of_another_seed_another() -> None:
    first, again, other = (InitialState(perturb=0.1, seed=seed).data(MODEL).qvel for seed in (1, 1, 2))
    assert first.tobytes() == again.tobytes()
    assert (first != other).all()


def test_noise_touches_velocities_only_and_all_of_them() -> None:
    assert change(perturb=0.1) == {"qvel": change(perturb=0.1)["qvel"]}
    assert len(change(perturb=0.1)["qvel"]) == MODEL.nv


def test_twice_the_deviation_is_twice_the_noise_and_it_adds_to_what_was_set() -> None:
    noise = InitialState(perturb=0.25).data(MODEL).qvel
    assert (InitialState(perturb=0.5).data(MODEL).qvel == 2 * noise).all()
    assert InitialState(key="home", perturb=0.25).data(MODEL).qvel == pytest.approx(np.arange(1, 13) + noise)


def test_noise_has_the_asked_deviation_about_zero() -> None:
    samples = np.concatenate([InitialState(perturb=0.5, seed=seed).data(MODEL).qvel for seed in range(300)])
    error = 0.5 / np.sqrt(samples.size)
    assert abs(samples.mean()) < 5 * error
    assert abs(samples.std() - 0.5) < 5 * error / np.sqrt(2)


@cases("how, message")
def test_a_wrong_number_of_values_is_refused_with_the_right_one(how: dict[str, Any], message: str) -> None:
    with pytest.raises(BadValueError) as caught:
        InitialState(**how).data(MODEL)
    assert str(caught.value).startswith(message)


@cases("how, message")
def test_an_unknown_name_is_refused_with_those_there_are(how: dict[str, Any], message: str) -> None:
    with pytest.raises(UnknownNameError) as caught:
        InitialState(**how).data(MODEL)
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -float("inf")])
@pytest.mark.parametrize(
    ("field", "name", "where"),
    [("qpos", "hand", "qpos[11]"), ("qvel", "root/vz", "qvel[2]"), ("ctrl", "motor", "ctrl[0]")],
)
def test_a_start_that_is_not_finite_is_refused(field: str, name: str, where: str, bad: float) -> None:
    how: dict[str, Any] = {field: {name: bad}}
    with pytest.raises(UsageError) as caught:
        InitialState(**how).data(MODEL)
    assert str(caught.value) == f"the initial {where} is {bad}; it must be finite"


@pytest.mark.parametrize("name", ["qpos", "qvel", "ctrl"])
def test_a_keyframe_that_is_not_finite_is_the_model_s_fault(name: str) -> None:
    model = copy.copy(MODEL)
    getattr(model, f"key_{name}")[0, 1] = float("nan")
    changes: dict[str, Any] = {name: {"hand" if name != "ctrl" else "motor": 0.0}}
    with pytest.raises(ModelError) as caught:
        replace(InitialState(key="home"), **changes).data(model)
    assert str(caught.value) == f"keyframe 'home': {name}[1] is nan; it must be finite"
    assert caught.value.exit_code == 3
    InitialState(key="1").data(model)


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"perturb": float("nan")}, r"qvel\[0\] is nan"),
        ({"perturb": 1, "seed": -1}, "seed: '-1' is not a whole number"),
        ({"qvel": {"hand": 1e11}}, r"qvel\[9\] is 1e\+11; it must be below 1e\+10"),
        ({"qpos": {"hand": -1e11}}, r"qpos\[11\] is -1e\+11; it must be below 1e\+10"),
    ],
)
def test_a_start_that_mujoco_cannot_step_from_is_refused_as_wrong_usage(how: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        InitialState(**how).data(MODEL)


def test_a_start_beyond_mujocos_limit_is_the_models_fault_unless_it_is_replaced() -> None:
    text = '<mujoco><worldbody><body><joint name="far" ref="1e308"/><geom size="1"/></body></worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(text)
    with pytest.raises(ModelError, match=r"the model's own pose: qpos\[0\] is .* must be below 1e\+10") as caught:
        InitialState().data(model)
    assert caught.value.exit_code == 3
    assert InitialState(qpos={"far": 1.0}).data(model).qpos[0] == 1


def test_foreign_text_in_a_name_cannot_steer_the_terminal() -> None:
    spec = mujoco.MjSpec.from_string(
        '<mujoco><worldbody><body><joint name="evil"/><geom size="1"/></body></worldbody></mujoco>'
    )
    spec.joint("evil").name = "e\x1b[31m"
    with pytest.raises(UsageError) as caught:
        InitialState(qpos={"e\x1b[31m/x": 1}).data(spec.compile())
    assert all(line == clean(line) for line in str(caught.value).splitlines())


@pytest.mark.parametrize("value", [1.5, -1.001])
def test_a_control_beyond_its_range_is_remarked_on_with_the_range(value: float) -> None:
    expected = f"ctrl motor={value:g} is beyond the actuator's range; MuJoCo clamps it to [-1, 1]"
    for name in ("motor", "*"):
        assert [spelled(text) for text in InitialState(ctrl={name: value}).remarks(MODEL)] == [expected]


@pytest.mark.parametrize("how", [{}, {"ctrl": {"motor": 1}}, {"ctrl": {"1": 99}}, {"key": "1"}])
def test_a_control_within_its_range_without_one_or_not_asked_for_is_not_remarked_on(how: dict[str, Any]) -> None:
    assert InitialState(**how).remarks(MODEL) == []


def test_nothing_is_remarked_on_where_mujoco_does_not_clamp() -> None:
    model = mujoco.MjModel.from_xml_string("""<mujoco><option><flag clampctrl="disable"/></option><worldbody>
<body><joint name="j"/><geom size="1"/></body></worldbody>
<actuator><motor name="m" joint="j" ctrlrange="-1 1"/></actuator></mujoco>""")
    assert InitialState(ctrl={"m": 9}).remarks(model) == []


def test_starting_twice_gives_two_states_that_do_not_share() -> None:
    start = InitialState(qpos={"hand": 1})
    first, second = start.data(MODEL), start.data(MODEL)
    first.qpos[11] = 9
    assert second.qpos[11] == 1


HINGED = mujoco.MjModel.from_xml_string("""
<mujoco><worldbody>
  <body name="root"><freejoint name="root"/><geom size=".1"/>
    <body><joint name="hip"/><geom size=".1"/><body><joint name="rail" type="slide"/><geom size=".1"/></body></body>
  </body>
</worldbody></mujoco>""")


@pytest.mark.parametrize(
    ("name", "values", "wanted"),
    [
        ("hip", (LengthWithUnit(0.1),), "'0.1 m' is not an angle"),
        ("rail", (AngleWithUnit(0.1),), "'0.1 rad' is not a length"),
        ("root/z", (AngleWithUnit(0.1),), "is not a length"),
        ("root/qw", (AngleWithUnit(1),), "is not a number without a unit"),
        ("root", (0.0, 0.0, 1.0, LengthWithUnit(1.0), 0.0, 0.0, 0.0), "is not a number without a unit"),
    ],
)
def test_units_fit_the_joint(name: str, values: tuple[float, ...], wanted: str) -> None:
    with pytest.raises(BadValueError, match=f"qpos {name}: .*{wanted}"):
        InitialState(qpos={name: values}).data(HINGED)


def test_units_are_those_of_mujoco_once_they_are_read() -> None:
    start = InitialState(
        qpos={
            "hip": (AngleWithUnit(0.5),),
            "rail": (LengthWithUnit(0.2),),
            "root": (0.0, LengthWithUnit(0.1), 1.0, 1.0, 0.0, 0.0, 0.0),
        },
        qvel={"root/wx": (AngleWithUnit(2.0),), "root/vz": (LengthWithUnit(3.0),)},
    ).data(HINGED)
    assert start.qpos.tolist() == [0, 0.1, 1, 1, 0, 0, 0, 0.5, 0.2]
    assert start.qvel.tolist() == [0, 0, 3, 2, 0, 0, 0, 0]


def test_an_angle_beyond_a_turn_is_questioned_unless_its_unit_is_given() -> None:
    (text,) = InitialState(qpos={"hip": (90.0,), "rail": (90.0,), "root/x": (90.0,)}).remarks(HINGED)
    assert spelled(text) == (
        "qpos hip=90 is 14.3 turns, as angles are in radians; 90deg is 90 degrees, and 90rad means the turns"
    )
    assert InitialState(qpos={"hip": (AngleWithUnit(90.0),)}).remarks(HINGED) == []
    assert InitialState(qpos={"hip": (6.28,)}).remarks(HINGED) == []
    with pytest.raises(BadValueError, match="1 number"):
        InitialState(qpos={"hip": ()}).remarks(HINGED)
