"""Bodies whose size fits their mass and its centre, and bodies just beyond the bounds, as boxes of known extents."""

import numpy as np
import pytest

from mjrun.check.rules import bodies
from tests.cases import cases
from tests.check.models import lint, mjcf

SIDES = np.array([0.3, 0.2, 0.1])
VISUAL = 'contype="0" conaffinity="0" mass="0"'


def found(code: str, world: str, before: str = "") -> list[tuple[str, str]]:
    """The objects and severities of the findings of a rule."""
    return [(f.object, f.severity) for f in lint(mjcf(world, before=before)) if f.code == code]


def body(inner: str, name: str = "b") -> str:
    return f'<body name="{name}" euler="20 30 40" pos="1 2 3"><joint name="{name}"/>{inner}</body>'


def box(sides: np.ndarray = SIDES, more: str = "") -> str:
    return f'<geom type="box" size="{" ".join(repr(float(side / 2)) for side in sides)}" {more}/>'


@cases("density, severity")
def test_the_density_of_a_box_decides(density: float, severity: str) -> None:
    mass = f'mass="{density * SIDES.prod()}"'
    assert found("MJ207", body(box(more=mass))) == [("body 'b'", severity)] * bool(severity)
    assert found("MJ207", body(box(more=mass)), '<option gravity="0 0 -981"/>') == []


@pytest.mark.parametrize(
    ("geom", "volume"),
    [
        ('size="0.1"', 4 / 3 * np.pi * 0.1**3),
        ('type="capsule" size="0.1 0.2"', 4 / 3 * np.pi * 0.1**3 + 0.4 * np.pi * 0.1**2),
        ('type="mesh" mesh="tetrahedron"', 0.2**3 / 6),
        (f'type="box" size="0.1 0.1 0.1"/><geom {VISUAL} type="box" size="0.1 0.1 0.1"', 0.2**3),
        (f'size="0.1"/><geom {VISUAL} type="box" size="0.1 0.1 0.1"', 4 / 3 * np.pi * 0.1**3),
        ('size="0.1"/><geom size="0.1"/><geom size="0.1"', 0.2**3),
    ],
    ids=["sphere", "capsule", "hull", "repeated", "shell", "box around"],
)
def test_the_volume_of_the_geoms_decides_and_repeated_ones_count_once(geom: str, volume: float) -> None:
    mesh = '<asset><mesh name="tetrahedron" vertex="0 0 0 0.2 0 0 0 0.2 0 0 0 0.2"/></asset>'
    for density, reported in ((11_900, False), (12_100, True)):
        inertial = f'<inertial pos="0 0 0" mass="{density * volume}" diaginertia="1 1 1"/>'
        assert bool(found("MJ207", body(f"{inertial}<geom {geom}/>"), mesh)) == reported


def test_welded_bodies_and_visual_geoms_count_and_small_masses_may_be_dense() -> None:
    heavy = box(more=f'mass="{30_000 * SIDES.prod()}"')
    assert found("MJ207", body(heavy)) != []
    assert found("MJ207", body(heavy + box(2 * SIDES, VISUAL))) == []
    assert found("MJ207", body(heavy + f'<body pos="0 0 0.4">{box(2 * SIDES, VISUAL)}</body>')) == []
    assert found("MJ207", heavy) == []

    for mass, reported in ((0.049, False), (0.051, True)):
        dense = box(np.full(3, (mass / 30_000) ** (1 / 3)), f'mass="{mass}"')
        assert bool(found("MJ207", body(dense))) == reported


@pytest.mark.parametrize(("excess", "reported"), [(0.24, False), (0.26, True)])
def test_a_centre_of_mass_may_be_a_quarter_of_the_longest_side_outside(excess: float, reported: bool) -> None:
    for axis in range(3):
        centre = np.eye(3)[axis] * (SIDES[axis] / 2 + excess * SIDES.max())
        inertial = f'<inertial pos="{" ".join(map(str, centre))}" mass="1" diaginertia=".01 .01 .01"/>'
        assert found("MJ208", body(inertial + box())) == [("body 'b'", "warning")] * reported


def test_the_centre_of_mass_of_welded_bodies_counts() -> None:
    distant = '<body><inertial pos="0 0 1" mass="1" diaginertia=".01 .01 .01"/></body>'
    for mass, reported in ((9, False), (1, True)):
        solid = box(more=f'mass="{mass}"')
        assert bool(found("MJ208", body(solid + distant))) == reported


@pytest.mark.parametrize(("side", "reported"), [(19.9, False), (20.1, True)])
def test_a_body_may_be_20_m_long(side: float, reported: bool) -> None:
    assert found("MJ209", body(box(np.array([1, side, 1])))) == [("body 'b'", "note")] * reported
    assert found("MJ209", box(np.array([1, side, 1]))) == []


@pytest.mark.parametrize(("share", "reported"), [(0.19, True), (0.21, False)])
def test_visual_and_colliding_geoms_share_a_fifth_of_their_box(share: float, reported: bool) -> None:
    side = 1 - 2 * bodies.TOLERANCE  # boxes are made larger by the tolerance
    cube, shift = np.full(3, side), 1 - share
    visual = box(cube, f'{VISUAL} pos="{shift} 0 0"')
    assert found("MJ507", body(box(cube) + visual)) == [("body 'b'", "note")] * reported
    assert found("MJ507", body(box(cube) + f'<body pos="{shift} 0 0">{box(cube, VISUAL)}</body>')) != [] or not reported
    assert found("MJ507", body(visual)) == []
