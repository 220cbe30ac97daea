"""Theorems about keyframes."""

from pathlib import Path

import pytest

from mjrun.check.rule import GENERATED
from mjrun.model.sources import load
from tests.check.fixes import fixing
from tests.check.models import arms, attaching, hinged, keyed, lint, mjcf


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
    more = '<geom size="1" pos="9 9 -9"/><body><freejoint name="f"/><geom size=".1" pos="9 0 0"/></body>'
    key = '<keyframe><key name="k" qpos="1"/></keyframe>'
    if where == "included":
        Path("arm.xml").write_text(hinged(after=key))
        text = mjcf(more, before='<include file="arm.xml"/>')
    else:
        text = arms(more + attaching("l_"), joint="").replace("</mujoco>", f"{key}</mujoco>")
    assert lint(text) == []
    assert load(Path("model.xml")).nq > 1


@pytest.mark.parametrize(("qpos", "needed"), [("0 0", 0), ("0", 2)])
@pytest.mark.parametrize("before", [True, False])
def test_a_keyframe_of_an_included_file_fits_the_joints_up_to_its_last(qpos: str, needed: int, before: bool) -> None:
    two = '<body pos="0 0 5"><joint name="i"/><geom size=".1"/></body>'
    Path("arm.xml").write_text(hinged(world=two, after=f'<keyframe><key name="k" qpos="{qpos}"/></keyframe>'))
    include, other = '<include file="arm.xml"/>', '<body><freejoint/><geom size=".1" pos="9 0 0"/></body>'
    text = mjcf(other, before=include) if before else mjcf(other, after=include)
    needed = needed if before else 9  # those of the other body come first
    messages = [finding.message for finding in lint(text) if finding.code == "MJ405"]
    count = f"{len(qpos.split())} number{'s' * (qpos != '0')}"
    expected = f"qpos of the keyframe has {count}, but the model has {needed}; MuJoCo uses qpos0 for the rest"
    assert messages == [expected] * bool(needed)
    assert load(Path("model.xml")).nq == 9


def test_no_number_of_an_attached_keyframe_is_replaced_by_its_index_in_the_whole_model() -> None:
    motor = '<actuator><motor joint="{}" ctrlrange="-1 1"/></actuator>'
    motors, key = 2 * motor.format("j"), '<keyframe><key qpos="2 0.5" ctrl="3 0.25"/></keyframe>'
    joints, compiler = 'range="-1 1"/><joint axis="1 0 0"', '<compiler angle="radian"/>'
    own = '<body><joint name="i"/><geom size=".1" pos="-9 0 0"/></body>'
    text = arms(own + attaching("l_"), motors + key, joints, compiler)
    Path("model.xml").write_text(text.replace("</mujoco>", f"{motor.format('i')}</mujoco>"))
    made = fixing("model.xml", unsafe=True)
    assert made.files == []
    reasons = {f.code: f.unfixed for f in made.results[0].findings}  # type: ignore[attr-defined]
    assert [reasons[code] for code in ("MJ402", "MJ403")] == [GENERATED] * 2
