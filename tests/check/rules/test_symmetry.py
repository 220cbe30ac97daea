"""Bodies on the left and on the right: mirrored ones, and ones that differ by a little more than is allowed."""

from pathlib import Path

import pytest

from tests.check.models import lint, mjcf

GEOM = '<geom type="box" size=".1 .2 .3" mass="{mass}"/>'
BODY = '<body name="{name}" pos="0 {y} 0"><joint name="{name}_joint" axis="{axis}" {joint}/>{geom}</body>'
DEGREES = 'range="-20 50"'


def side(name: str, axis: str = "1 1 0", joint: str = DEGREES, mass: float = 1, geom: str = GEOM, y: float = 1) -> str:
    return BODY.format(name=name, axis=axis, joint=joint, geom=geom.format(mass=mass), y=y)


def messages(*sides: str) -> list[str]:
    """What is found in a trunk, turned in the world, with these sides."""
    trunk = f'<body name="trunk" euler="10 20 30"><joint name="t"/><geom size=".1"/>{"".join(sides)}</body>'
    return [f"{f.object}: {f.message}" for f in lint(mjcf(trunk)) if f.code == "MJ309"]


@pytest.mark.parametrize(
    ("left", "right"),
    [
        *(("left_thigh", "right_thigh"), ("LeftThigh", "RightThigh"), ("THIGH_LEFT", "THIGH_RIGHT")),
        *(("FL_hip", "FR_hip"), ("RL_hip", "RR_hip"), ("hip_lf", "hip_rf"), ("LH_hip", "RH_hip")),
        *(("thigh_l", "thigh_r"), ("L1_leg", "R1_leg"), ("l/hip", "r/hip"), ("bl", "br")),
    ],
)
def test_names_of_sides(left: str, right: str) -> None:
    assert messages(side(left), side(right, y=-1)) == []
    for pair in ((left, right), (right, left)):
        (message,) = messages(side(pair[0]), side(pair[1], mass=2))
        assert message.startswith(f"body '{pair[0]}': it differs from body '{pair[1]}': masses 1 and 2 kg")


def test_limbs_with_different_numbers_of_bodies_are_meant_to_differ() -> None:
    geom = '<geom size="0.1" mass="{mass}"/><body pos="0 0 1"><geom size="0.1"/></body>'
    assert messages(side("left"), side("right", mass=2, geom=geom, y=-1)) == []
    (message,) = messages(side("left", geom=geom), side("right", mass=2, geom=geom, y=-1))
    assert "masses" in message


def test_one_model_that_is_attached_on_both_sides_may_be_turned() -> None:
    Path("arm.xml").write_text(mjcf(side("arm")))
    attach = '<frame pos="0 {} 0" euler="0 0 {}"><attach model="m" body="arm" prefix="{}_"/></frame>'
    both = attach.format(1, 0, "left") + attach.format(-1, 30, "right")
    findings = lint(mjcf(both, before='<asset><model name="m" file="arm.xml"/></asset>'))
    assert "MJ309" not in [finding.code for finding in findings]


@pytest.mark.parametrize(
    ("left", "right"),
    [("left", "lift"), ("hull", "hurr"), ("FL_hip", "RL_hip"), ("front", "rear"), ("hip_1", "hip_2"), ("a", "left")],
)
def test_names_of_other_bodies(left: str, right: str) -> None:
    assert messages(side(left), side(right, mass=2)) == []


@pytest.mark.parametrize(
    ("other", "difference"),
    [
        ({"axis": "1 -1 0", "joint": 'range="-50 20"'}, ""),
        ({"axis": "-1 1 0"}, ""),
        ({"axis": "1 0.7 0"}, ""),
        ({"axis": "1 0.5 0"}, "axes of left_joint"),
        ({"mass": 1.019}, ""),
        ({"mass": 1.021}, "masses 1 and 1.021 kg"),
        ({"joint": 'range="-20 51"'}, ""),
        ({"joint": 'range="-20 52"'}, "ranges of left_joint, -0.3491 to 0.8727 and -0.3491 to 0.9076"),
        ({"joint": ""}, "only one left_joint has a range"),
        ({"joint": 'type="slide" range="-20 50"'}, "other joints"),
        ({"geom": '<geom type="box" size=".1 .2 .306" mass="1"/>'}, ""),
        ({"geom": '<geom type="box" size=".1 .2 .32" mass="1"/>'}, "inertias by 9 %; sizes of colliding geoms by 6 %"),
        ({"geom": GEOM.replace("<geom", '<geom contype="0" conaffinity="0"')}, "1 and 0 colliding geoms"),
    ],
    ids=lambda value: str(value)[:60],
)
def test_differences_beyond_those_of_cad_models_are_reported(other: dict[str, str], difference: str) -> None:
    found = messages(side("left"), side("right", y=-1, **other))  # type: ignore[arg-type]
    assert len(found) == bool(difference)
    assert not difference or found[0].endswith(difference)


@pytest.mark.parametrize(
    ("axis", "joint", "difference"),
    [
        ("0 1 0", 'range="-20 50"', ""),
        ("0 -1 0", 'range="-50 20"', ""),
        ("0 -1 0", 'range="-20 50"', "its axis is mirrored, but its range is not"),
        ("0 1 0", 'range="-50 20"', "its range is mirrored, but its axis is not"),
    ],
)
def test_knees_on_both_sides_bend_the_same_way(axis: str, joint: str, difference: str) -> None:
    found = messages(side("left", "0 1 0"), side("right", axis, joint, y=-1))
    assert len(found) == bool(difference)
    assert not difference or found[0].endswith(f"left_joint turns the other way: {difference}")


@pytest.mark.parametrize(("axis", "joint"), [("1 0 0", 'range="-20 50"'), ("-1 0 0", 'range="-20 50"')])
def test_hips_may_be_mirrored_or_moved_to_the_other_side(axis: str, joint: str) -> None:
    assert messages(side("left", "1 0 0"), side("right", axis, joint, y=-1)) == []


@pytest.mark.parametrize(
    ("left", "right", "ranges", "difference"),
    [
        ("gear='2'", "gear='2'", DEGREES, ""),
        ("gear='2'", "gear='-2'", DEGREES, "pulls the other way: its gear is 2, and -2 on the other side"),
        ("gear='2'", "gear='-2'", 'range="-20 20"', ""),  # either sense may be meant
        ("gear='2'", "gear='3'", DEGREES, "gears of left, 2 and 3"),
        ("forcerange='-5 5'", "forcerange='-5 9'", DEGREES, "forceranges of left, up to 5 and 9"),
        ("", "", DEGREES, ""),
    ],
)
def test_actuators_on_both_sides_are_alike(left: str, right: str, ranges: str, difference: str) -> None:
    sides = "".join((side("left", joint=ranges), side("right", joint=ranges, y=-1)))
    motors = f'<motor name="left" joint="left_joint" {left}/><motor name="right" joint="right_joint" {right}/>'
    found = [f.message for f in lint(mjcf(sides, f"<actuator>{motors}</actuator>")) if f.code == "MJ309"]
    assert len(found) == bool(difference)
    assert not difference or difference in found[0]


@pytest.mark.parametrize(("pos", "difference"), [("0 .3 0", ""), ("0 0 .3015", ""), ("0 0 .4", "0.3 and 0.4 m")])
def test_links_are_as_far_from_their_parents_on_both_sides(pos: str, difference: str) -> None:
    calf = '<body name="{}_calf" pos="{}"><joint/><geom size=".1"/></body>'
    left, right = (GEOM + calf.format(*each) for each in (("left", "0 0 .3"), ("right", pos)))
    found = messages(side("left", geom=left), side("right", geom=right, y=-1))
    expected = f"it differs from body 'right_calf': distances from left and right, {difference}"
    assert found == [f"body 'left_calf': {expected}"] * bool(difference)
