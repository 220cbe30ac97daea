"""Meshes whose triangles enclose a volume, and cavities in them."""

from pathlib import Path

import numpy as np
import pytest

from mjrun.check.context import CheckContext
from mjrun.check.rules.meshes import Surface, geom_mass
from mjrun.model.xml_source import read_xml
from tests.check.models import lint, mjcf, write

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
FACES = np.array([[0, 2, 1], [0, 3, 2], [0, 1, 3], [1, 2, 3]])
# A tray of walls with a tenth of its size: the profile, its triangles, and the same shifted by one along y.
PROFILE = [(0, 0), (1, 0), (1, 1), (0.9, 1), (0.9, 0.1), (0.1, 0.1), (0.1, 1), (0, 1)]
TRIANGLES = np.array([(0, 1, 4), (0, 4, 5), (1, 2, 3), (1, 3, 4), (0, 5, 6), (0, 6, 7)])
SIDES = np.array([((i, i + 8, j + 8), (i, j + 8, j)) for i, j in ((k, (k + 1) % 8) for k in range(8))]).reshape(-1, 3)
TRAY = np.array([(x, y, z) for y in (0, 1) for x, z in PROFILE])
TRAY_FACES = np.concatenate([TRIANGLES, TRIANGLES[:, ::-1] + 8, SIDES])


def asset(vertices: np.ndarray = CORNERS, faces: np.ndarray = FACES, more: str = "") -> str:
    texts = (" ".join(map(str, array.ravel())) for array in (vertices, faces))
    return '<asset><mesh name="m" vertex="{}" face="{}" {}/></asset>'.format(*texts, more)


def findings(before: str, geom: str = "", body: str = "") -> list[str]:
    world = f'<body name="b"><joint name="j"/>{body}<geom type="mesh" mesh="m" {geom}/></body>'
    return [f.message.split(":")[0] for f in lint(mjcf(world, before=before)) if f.code == "MJ505"]


INERTIAL = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
VISUAL = 'contype="0" conaffinity="0"'
INWARDS, OPEN = "its triangles face inwards", "it gives its body mass, but is not closed, so its volume is uncertain"


@pytest.mark.parametrize(
    ("faces", "more", "geom", "body", "found"),
    [
        (FACES, "", "", "", []),
        (FACES[:, ::-1], "", "", "", [INWARDS]),
        (FACES[:, ::-1], "", "", INERTIAL, [INWARDS]),
        (FACES[:, ::-1], "", VISUAL, INERTIAL, []),
        (FACES[1:], "", "", "", [OPEN]),
        (FACES[1:], "", VISUAL, "", [OPEN]),
        (FACES[1:], "", "", INERTIAL, []),
        (FACES[1:], 'inertia="convex"', "", "", []),
        (FACES[1:], 'inertia="shell"', "", "", []),
        (FACES[1:], "", 'mass="0"', '<geom size="1"/>', []),
    ],
)
def test_a_mesh_that_matters_is_closed_and_faces_outwards(
    faces: np.ndarray, more: str, geom: str, body: str, found: list[str]
) -> None:
    assert findings(asset(faces=faces, more=more), geom, body) == found


def test_a_mesh_with_a_corner_for_each_face_is_closed_where_the_corners_coincide() -> None:
    vertices = CORNERS[FACES].reshape(-1, 3)
    assert Surface(vertices, np.arange(12).reshape(-1, 3)).open_edges() == 0
    assert Surface(vertices[3:], np.arange(9).reshape(-1, 3)).open_edges() == 3


def test_the_volume_is_signed_and_the_inside_is_where_solid_angles_add_up() -> None:
    tray, inverted = Surface(TRAY, TRAY_FACES), Surface(TRAY, TRAY_FACES[:, ::-1])
    assert tray.volume == pytest.approx(1 - 0.8 * 0.9)
    assert inverted.volume == pytest.approx(-tray.volume)
    for surface in (tray, inverted):
        for point in np.random.default_rng(0).uniform(-0.2, 1.2, (100, 3)):
            outside = (point < 0).any() or (point > 1).any() or (0.1 < point[0] < 0.9 and point[2] > 0.1)
            assert surface.encloses(point) != outside


@pytest.mark.parametrize("inertia", ["legacy", "exact", "convex", "shell"])
def test_masses_of_geoms_are_those_that_mujoco_infers(inertia: str) -> None:
    geoms = ('type="sphere" size="2"', 'type="capsule" size="1 2"', 'type="cylinder" size="1 2"')
    geoms += ('type="box" size="1 2 3"', 'type="ellipsoid" size="1 2 3"', 'type="mesh" mesh="m"')
    geoms += ('type="box" size="1 2 3" mass="7"', 'type="box" size="1 2 3" group="1"')
    bodies = "".join(f'<body><geom density="2" {geom}/></body>' for geom in geoms)
    compiler = '<compiler inertiagrouprange="0 0"/>'
    text = mjcf(bodies, before=compiler + asset(TRAY, TRAY_FACES, f'inertia="{inertia}"'))
    path = Path(write("model.xml", text))
    context = CheckContext.load(path, read_xml(path))
    assert context.spec
    masses = [geom_mass(context, geom) for geom in context.spec.geoms]
    assert masses == pytest.approx(context.model.body_mass[1:], rel=1e-5)


@pytest.mark.parametrize(
    ("x", "cavity", "deep"),
    [(0.5, True, True), (0.95, False, True), (1.5, False, False)],
    ids=["in the cavity", "in the wall", "beside it"],
)
def test_a_hull_fills_a_cavity_only_around_what_starts_there(x: float, cavity: bool, deep: bool) -> None:
    ball = f'<body pos="{x} 0.5 0.5"><freejoint/><geom name="ball" size="0.1"/></body>'
    found = lint(mjcf(f'<geom name="tray" type="mesh" mesh="m"/>{ball}', before=asset(TRAY, TRAY_FACES)))
    assert [f.object for f in found if f.code == "MJ506"] == ["geom 'tray'"] * cavity
    penetrations = [f.message for f in found if f.code == "MJ501"]
    assert len(penetrations) == deep
    assert [("fills the cavity" in message) for message in penetrations] == [cavity] * deep


def test_a_hull_may_have_one_and_a_half_times_the_volume_of_its_mesh() -> None:
    for floor, reported in ((0.62, False), (0.56, True)):  # the tray fills 0.2 + 0.8 floor of its box
        vertices = TRAY.copy()
        vertices[vertices[:, 2] == 0.1, 2] = floor
        ball = '<body pos="0.5 0.5 0.8"><freejoint/><geom size="0.1"/></body>'
        world = f'<geom type="mesh" mesh="m"/>{ball}'
        found = lint(mjcf(world, before=asset(vertices, TRAY_FACES)))
        assert ("MJ506" in [f.code for f in found]) == reported
