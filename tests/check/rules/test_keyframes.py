"""Theorems about keyframes."""

from pathlib import Path

import pytest

from mjrun.model.sources import load
from tests.check.models import Case, arms, attaching, hinged, keyed, lint, mjcf

CASES = [
    Case("MJ401", keyed('qpos="nan"'), 12, "qpos[0] is nan", keyed('qpos="0"')),
    Case("MJ401", keyed('qvel="1e20"'), 12, "qvel[0] is 1e+20", keyed('qvel="1e9"')),
    Case("MJ402", keyed('qpos="1.1"'), 12, "joint 'j' is at 1.1 rad, outside [-1, 1]", keyed('qpos="1"')),
    Case(
        "MJ403",
        keyed('ctrl="2"'),
        12,
        "the control of actuator 'm' is at 2, outside [-1, 1]; MuJoCo clamps",
        keyed('ctrl="1"'),
    ),
    Case(
        "MJ404",
        keyed('qpos="2 0 0 0"', 'type="ball"'),
        12,
        "the quaternion of joint 'j' has length 2, not 1",
        keyed('qpos=".6 .8 0 0"', 'type="ball"'),
    ),
    Case(
        "MJ405", keyed('qpos="0 0"'), 12, "qpos of the keyframe has 2 numbers, but the model has 1", keyed('qpos="0"')
    ),
    Case(
        "MJ405", keyed('ctrl="0 0"'), 12, "ctrl of the keyframe has 2 numbers, but the model has 1", keyed('ctrl="0"')
    ),
    Case("MJ405", keyed('act="0"'), 12, "act of the keyframe has 1 number", keyed('act=""')),
    Case("MJ405", keyed('mpos="0 0 0"'), 12, "mpos of the keyframe has 3 numbers, but the model has 0", keyed("")),
    Case("MJ405", keyed('mquat="1 0"'), 12, "mquat of the keyframe has 2 numbers, but the model has 0", keyed("")),
    Case(
        "MJ405",
        keyed('qpos="1 0 0"', 'type="ball"'),
        12,
        "qpos of the keyframe has 3 numbers, but the model has 4; MuJoCo uses qpos0 for the rest",
        keyed('qpos="1 0 0 0"', 'type="ball"'),
    ),
]


@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_rule_finds_what_it_is_for_at_its_line_and_nothing_in_a_correct_model(case: Case) -> None:
    case.check()


@pytest.mark.parametrize("name", ['name="k"', ""])
def test_a_number_of_an_attached_keyframe_is_told_by_its_joint(name: str) -> None:
    key = f'<keyframe><key {name} qpos="2"/></keyframe>'
    text = arms(f"{attaching('l_')}\n{attaching('r_')}", key, 'range="-1 1"', '<compiler angle="radian"/>')
    findings = [f for f in lint(text) if f.code == "MJ402"]
    assert [f.object for f in findings] == [f"keyframe '{side}_{'k' * bool(name)}'" for side in "lr"]
    assert [f.message.partition(" is at")[0] for f in findings] == ["joint 'l_j'", "joint 'r_j'"]
    assert {f.remedy for f in findings} == {
        "change the position of the joint in the keyframe, or the range of the joint"
    }


def test_a_number_of_a_keyframe_of_the_model_is_told_by_its_place() -> None:
    (beyond,) = lint(keyed('qpos="2"'))
    assert beyond.remedy == "change qpos[0] in the keyframe, or the range of the joint"


@pytest.mark.parametrize("where", ["included", "attaching"])
def test_a_keyframe_need_not_be_complete_where_other_files_add_joints(where: str) -> None:
    more = '<body><freejoint name="f"/><geom size=".1" pos="9 0 0"/></body>'
    key = '<keyframe><key name="k" qpos="1"/></keyframe>'
    if where == "included":
        Path("arm.xml").write_text(hinged(after=key))
        text = mjcf(more, '<include file="arm.xml"/>')
    else:
        text = arms(more + attaching("l_"), joint="").replace("</mujoco>", f"{key}</mujoco>")
    assert lint(text) == []
    assert load(Path("model.xml")).nq > 1
