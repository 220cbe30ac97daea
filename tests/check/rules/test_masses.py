"""Explicit inertias that a body can have, and those that it cannot; bodies that consist of several links of a URDF."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.check.context import CheckContext
from mjrun.check.rule_catalogue import Thresholds
from mjrun.check.rules import bodies
from mjrun.model.xml_source import read_xml
from tests.check.models import lint, lint_file, mjcf

SIDES = st.floats(0.05, 0.3)


WELDED = '<body><geom size="0.1" pos="2 2 2"/></body>'
BOUNDS = (Thresholds.min_inertia_share, 3 * Thresholds.inertia_spread**2)  # of the inertia relative to a solid box's
INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
URDF = """<robot name="r"><link name="base"/><link name="arm">{}</link><link name="tip">{}</link>
<joint name="turn" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint>
<joint name="weld" type="fixed"><parent link="arm"/><child link="tip"/></joint></robot>"""
SPHERE = '<{0}><geometry><sphere radius="0.1"/></geometry></{0}>'


def inertial(mass: float, inertia: np.ndarray, more: str = "") -> str:
    shown = " ".join(repr(float(value)) for value in inertia)
    return f'<inertial pos="0 0 0" mass="{mass}" diaginertia="{shown}"/>{more}'


def body(inner: str, geom: str, name: str = "b") -> str:
    return f'<body name="{name}"><joint name="{name}"/>{inner}<geom {geom}/></body>'


def findings(world: str) -> list[str]:
    return [finding.object for finding in lint(mjcf(world)) if finding.code == "MJ206"]


def box(sides: tuple[float, float, float]) -> tuple[str, np.ndarray]:
    """A geom, and its principal inertias for 2 kg."""
    x, y, z = (side**2 for side in sides)
    return f'type="box" size="{" ".join(map(repr, sides))}" mass="2"', 2 / 3 * np.array([y + z, x + z, x + y])


@given(sides=st.tuples(SIDES, SIDES, SIDES), factor=st.floats(0.005, 20))
def test_an_inertia_of_a_box_is_possible_within_its_bounds(sides: tuple[float, float, float], factor: float) -> None:
    """The mean distance of the mass of a box is its reach over √3; it grows with the root of the inertia."""
    geom, inertia = box(sides)
    if any(abs(factor / bound - 1) < 1e-3 for bound in BOUNDS):
        return
    is_placeholder = np.ptp(inertia) <= bodies.EQUAL * inertia.max() and max(
        sides
    ) > Thresholds.placeholder_slenderness * min(sides)
    possible = BOUNDS[0] < factor < BOUNDS[1] and not is_placeholder
    assert findings(body(inertial(2, factor * inertia), geom)) == ([] if possible else ["body 'b'"])


@pytest.mark.parametrize(("share", "reported"), [(0.09, True), (0.11, False)])
def test_the_inertia_about_each_axis_is_compared_with_that_of_a_solid(share: float, reported: bool) -> None:
    """Two boxes that make a larger one have its inertia, wherever the mass is and whichever axes are principal."""
    geom = 'type="box" size="0.1 0.2 0.15" pos="-0.1 0 0"/><geom type="box" size="0.2 0.1 0.15" pos="0.1 0 0" '
    geom += 'euler="0 0 90"'
    inertia = 2 / 3 * np.array([0.2**2 + 0.15**2, 0.2**2 + 0.15**2, 0.2**2 + 0.2**2])
    shown = " ".join(map(str, np.roll(inertia * (1, 1, share), -1)))
    inner = f'<inertial pos="0.01 0 0" quat="0.5 0.5 0.5 0.5" mass="2" diaginertia="{shown}"/>'
    assert findings(body(inner, geom)) == ["body 'b'"] * reported


@pytest.mark.parametrize(
    ("inner", "geom", "reported"),
    [
        (inertial(1, np.full(3, 0.01)), 'type="box" size="0.3 0.05 0.05"', True),
        (inertial(1, np.full(3, 0.01)), 'type="box" size="0.1 0.1 0.1"', False),
        (inertial(1, np.array([0.4, 0.4, 0.4])), 'size="0.1"', True),
        (inertial(1, np.array([1, 1, 0.9]), WELDED), 'size="0.1"', False),
        (inertial(1, np.full(3, 1.0), WELDED), 'size="0.1"', True),
        (inertial(1, np.full(3, 0.4)), 'type="hfield" hfield="h"', False),
        ("", 'size="0.1"', False),
    ],
    ids=["placeholder", "cube", "too large", "reached by a welded body", "equal", "infinite", "inferred"],
)
def test_the_geoms_of_a_body_and_of_those_welded_to_it_decide(inner: str, geom: str, reported: bool) -> None:
    asset = '<asset><hfield name="h" nrow="2" ncol="2" size="1 1 1 1"/></asset>'
    model = mjcf(body(inner, geom), before=asset)
    assert [f.object for f in lint(model) if f.code == "MJ206"] == ["body 'b'"] * reported


@pytest.mark.parametrize(("compiler", "reported"), [("", True), ('<compiler inertiafromgeom="true"/>', False)])
def test_an_inertia_that_mujoco_infers_nevertheless_is_not_judged(compiler: str, reported: bool) -> None:
    inner = inertial(1, np.full(3, 0.001))
    model = mjcf(body(inner, 'type="box" size="1 1 1" mass="0"/><geom size="0.1"'), before=compiler)
    assert [f.object for f in lint(model) if f.code == "MJ206"] == ["body 'b'"] * reported


@pytest.mark.parametrize(("factor", "reported"), [(0.9, True), (1.1, False)])
def test_a_sphere_is_compared_with_a_solid_sphere(factor: float, reported: bool) -> None:
    inertia = factor * Thresholds.min_inertia_share * 2 / 5 * 0.1**2
    assert findings(body(inertial(1, np.full(3, inertia)), 'size="0.1"')) == ["body 'b'"] * reported


@pytest.mark.parametrize(
    ("visual", "share", "more"),
    [
        ('size="0.1" {} density="420"', 0, ""),
        ('size="0.1" {} density="440"', 31, ""),
        ('size="0.1" {} mass="9"', 0, ""),
        ('size="0.1" {} density="440" group="1"', 0, '<compiler inertiagrouprange="0 0"/>'),
        ('size="0.1" density="440"', 0, ""),
    ],
    ids=["29 %", "31 %", "meant", "left out", "colliding"],
)
def test_visual_geoms_give_less_than_a_third_of_the_mass(visual: str, share: int, more: str) -> None:
    geom = visual.format('contype="0" conaffinity="0"')
    model = mjcf(body(f"<geom {geom}/>", 'size="0.1"'), before=more)
    messages = [f.message for f in lint(model) if f.code == "MJ210"]
    assert [message.partition(" %")[0] for message in messages] == [str(share)] * bool(share)


def test_bodies_that_do_not_move_and_negligible_ones_are_left_alone() -> None:
    bad = inertial(1, np.full(3, 0.4))
    still = f'<body name="b">{bad}<geom size="0.1"/></body>'
    assert findings(still) == ["body 'b'"]  # a part of other models
    assert findings(still + body("", 'size="0.1"', "moves")) == []
    heavy = f'<body>{inertial(1e6, np.full(3, 1e4))}<geom size="0.1"/></body>'
    assert findings(heavy + body(bad, 'size="0.1"')) == ["body 'b'"]

    small = body(inertial(1e-8, np.full(3, 1e-7)), 'size="0.1"', "small")
    assert findings(small) == ["body 'small'"]
    large = body(inertial(1, np.full(3, 0.01)), 'size="0.1"', "large")
    assert findings(small + large) == []


@pytest.mark.parametrize(
    ("arm", "tip", "reported"),
    [("collision", "collision", True), ("visual", "collision", False), ("collision", "visual", False)],
)
def test_links_that_are_fixed_to_each_other_are_one_body_with_all_their_shapes(
    arm: str, tip: str, reported: bool
) -> None:
    path = Path("r.urdf")
    path.write_text(URDF.format(*(SPHERE.format(shape) + INERTIAL for shape in (arm, tip))))
    remedies = [finding.remedy for finding in lint_file(path, ["MJ206"])]
    assert len(remedies) == reported
    assert all("the links fixed to it (tip)" in remedy for remedy in remedies)


def test_remedies_of_links_and_their_joints_are_in_terms_of_urdf() -> None:
    path, joint = Path("r.urdf"), '<joint name="j" type="revolute"><parent link="base"/><child link="a"/>{}</joint>'
    robot = f'<robot name="r"><link name="base"/><link name="a">{{}}</link>{joint.format("<limit {}/>")}</robot>'
    path.write_text(robot.format(INERTIAL, 'lower="1" upper="-2" effort="1" velocity="1"'))
    assert [f.remedy for f in lint_file(path, ["MJ302"])] == ['write <limit lower="-2" upper="1" …/>']
    path.write_text(robot.format("", 'lower="-1" upper="1" effort="1" velocity="1"'))
    (finding,) = lint_file(path)
    assert (finding.code, finding.remedy[:49]) == ("MJ202", "give the link an <inertial> with <mass value=…/> ")


def test_a_shape_of_a_link_that_is_fused_into_the_world_is_placed_at_this_link() -> None:
    path = Path("r.urdf")
    shape = SPHERE.format("collision")
    path.write_text(URDF.replace('"base"/>', f'"base">\n{shape}</link>', 1).format(shape + INERTIAL, shape + INERTIAL))
    context = CheckContext.load(path, read_xml(path))
    assert int(context.model.geom_bodyid[0]) == 0
    assert context.place("geom", 0) == (path, 1, None)
