"""Theorems about limits and ranges, fixes of all ranges in a text, and hinges that turn a link through its parent."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.check.rules import limits
from tests.cases import cases
from tests.check.fixes import fixed
from tests.check.models import arms, attaching, hinged, lint, lint_file, mjcf

MUSCLE = ".75 1.05 5 200 .5 1.6 1.5 1.3 1.2"
MOTOR = '<actuator><motor name="m" joint="j" {}/></actuator>'
PARENT = '<geom type="box" size="0.8 1 {half}" pos="1 0 0"/>'
LINK = '<body name="link">{joint}<geom size="0.1" pos="-1 0 0"/></body>'


def largest_force(actuator: str, ctrl: float) -> float:
    """The largest force in 5 s on a joint that is too heavy to move far."""
    body = '<body name="b"><joint name="j" armature="1e9"/><geom name="g" size=".1"/></body>'
    model = mujoco.MjModel.from_xml_string(mjcf(body, f"<actuator>{actuator}</actuator>", '<option gravity="0 0 0"/>'))
    data, largest = mujoco.MjData(model), 0.0
    data.ctrl[:] = ctrl
    for _ in range(2500):
        mujoco.mj_step(model, data)
        largest = max(largest, abs(float(data.actuator_force[0])))
    return largest


@pytest.mark.parametrize(
    "actuator",
    [
        '<motor name="a" joint="j"/>',
        '<motor name="a" joint="j" ctrlrange="-1 1"/>',
        '<motor name="a" joint="j" forcerange="-1 1"/>',
        '<position name="a" joint="j"/>',
        '<velocity name="a" joint="j"/>',
        '<intvelocity name="a" joint="j" kp="3" actrange="-1 1"/>',
        '<intvelocity name="a" joint="j" kp="3"/>',
        '<muscle name="a" joint="j" lengthrange="0 1" force="5"/>',
        f'<general name="a" joint="j" gaintype="muscle" lengthrange="0 1" gainprm="{MUSCLE}"/>',
        '<general name="a" joint="j" dyntype="filter" dynprm=".1" actlimited="true" actrange="0 1"/>',
        '<general name="a" joint="j" dyntype="filter" dynprm=".1"/>',
    ],
)
def test_an_actuator_has_limits_exactly_when_a_huge_control_makes_no_huge_force(actuator: str) -> None:
    codes = [f.code for f in lint(hinged(after=f"<actuator>{actuator}</actuator>"))]
    bounded = largest_force(actuator, 1e6) < 1.01 * largest_force(actuator, 1)
    assert ("MJ301" in codes) == (not bounded)


@cases("positions, severity, remedy")
def test_a_start_beyond_a_range_is_a_note_if_a_keyframe_is_within(
    positions: list[float], severity: str, remedy: str
) -> None:
    keys = "".join(f'<key name="{index}" qpos="{position}"/>' for index, position in enumerate(positions))
    text = hinged('type="slide" range="1 2"', after=f"<keyframe>{keys}</keyframe>")
    (finding,) = [f for f in lint(text) if f.code == "MJ304"]
    assert finding.severity == severity
    assert finding.remedy.startswith(remedy)


@cases("unit, joint, mistaken, remedy")
def test_a_range_in_the_other_unit_is_one_that_only_that_unit_explains(
    unit: str, joint: str, mistaken: bool, remedy: str
) -> None:
    findings = [f for f in lint(hinged(joint, before=f'<compiler angle="{unit}"/>')) if f.code == "MJ305"]
    assert len(findings) == mistaken
    assert all(remedy in f.remedy for f in findings)


def test_the_unit_of_an_attached_model_is_told_of_that_model_alone() -> None:
    assert [f.code for f in lint(arms(attaching("l_"), joint='range="-1.57 1.57"'))] == ["MJ308"]
    assert [f.code for f in lint_file(Path("arm.xml"))] == ["MJ305"]


@pytest.mark.parametrize(
    ("span", "found"),
    [("-2.1 2", []), ("-2 1.9", ["MJ308"]), ("-360 360", []), ("-360 390", ["MJ308"]), ("-1.57 1.57", ["MJ305"])],
)
def test_a_hinge_turns_by_4_degrees_to_two_turns(span: str, found: list[str]) -> None:
    joint = f'range="{span}"'
    assert [f.code for f in lint(hinged(joint)) if f.code != "MJ304"] == found
    assert lint(hinged(f'type="slide" {joint}')) == []


@pytest.mark.parametrize(
    ("text", "old", "new"),
    [
        (hinged('range="0 1" actuatorfrcrange="0 1"'), '1"/>', '1" limited="true" actuatorfrclimited="true"/>'),
        (hinged(before='<default><joint range="0 1"/></default>'), '1"/></d', '1" limited="true"/></d'),
        (hinged(after=MOTOR.format('ctrlrange="0 1"')), '0 1"', '0 1" ctrllimited="true"'),
        (hinged(before='<default><joint limited="false"/></default>'), "", ""),
    ],
)
def test_ranges_without_a_limit_are_enabled(text: str, old: str, new: str) -> None:
    text = text.replace("<mujoco>", '<mujoco><compiler autolimits="false"/>')
    after = fixed(text)
    assert after == (text.replace(old, new, 1) if old else text)
    free = mujoco.MjModel.from_xml_string(text.replace(' autolimits="false"', ""))
    model = mujoco.MjModel.from_xml_string(after)
    for name in ("jnt_limited", "jnt_actfrclimited", "jnt_range", "actuator_ctrllimited"):
        np.testing.assert_array_equal(getattr(model, name), getattr(free, name))


@pytest.mark.parametrize(
    "text",
    [
        hinged('limited="true" range="2 1"'),
        hinged('actuatorfrclimited="true" actuatorfrcrange="2 1"'),
        hinged(after=MOTOR.format('ctrllimited="true" ctrlrange="2 1"')),
        hinged(after='<tendon><fixed limited="true" range="2 1"><joint joint="j" coef="1"/></fixed></tendon>'),
    ],
)
def test_reversed_ranges_that_keep_a_model_from_loading_are_swapped(text: str) -> None:
    assert fixed(text) == text.replace("2 1", "1 2")


def reported(half: float, joint: str) -> bool:
    """Returns whether a ball 1 m from the hinge of a parent with a box of this half height is found to pass through."""
    joint = f'<joint name="j" axis="0 1 0" {joint}/>'
    world = f"<body><freejoint/>{PARENT.format(half=half)}{LINK.format(joint=joint)}</body>"
    return [f.object for f in lint(mjcf(world)) if f.code == "MJ313"] == ["joint 'j'"]


STEP = 360 / limits.SAMPLES  # [degrees]


@pytest.mark.parametrize(("angle", "passes"), [(30 - STEP / 2, False), (30 + STEP, True)])
def test_the_ball_is_in_the_box_for_more_than_30_degrees(angle: float, passes: bool) -> None:
    half = float(np.sin(np.radians(angle / 2)) / limits.INNER)
    assert reported(half, "") == passes
    assert reported(half, 'range="0 330"') == passes
    assert not reported(half, 'range="0 170"')
    assert not reported(half, 'range="-190 -10" ref="-100"')
