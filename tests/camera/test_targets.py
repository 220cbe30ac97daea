"""Objects that cameras look at: where they are, which way they face, and how large they are."""

import mujoco
import numpy as np
import pytest

from mjrun.camera.targets import BoundObjectOrPoint, find_target, identify_objects, moving_parts, object_bounds
from mjrun.errors import MjrunError
from tests.cases import mjcf

MODEL = mujoco.MjModel.from_xml_string(mjcf("targets"))


@pytest.fixture
def data() -> mujoco.MjData:
    found = mujoco.MjData(MODEL)
    found.qpos[:3] = [4, 5, 6]
    mujoco.mj_forward(MODEL, found)
    return found


def test_a_spot_is_where_mujoco_has_the_object(data: mujoco.MjData) -> None:
    assert np.array_equal(find_target("hand", MODEL).position(data), data.body("hand").xpos)
    assert np.array_equal(find_target("geom:edge", MODEL).position(data), data.geom("edge").xpos)
    assert np.array_equal(find_target("rod", MODEL).position(data), data.site("rod").xpos)
    assert np.array_equal(find_target((1, 2, 3), MODEL).position(data), [1, 2, 3])


def test_a_subtree_is_the_centre_of_mass_of_all_that_hangs_on_a_body(data: mujoco.MjData) -> None:
    masses = [MODEL.body(name).mass[0] for name in ("arm", "hand")]
    centers = [data.body(name).xipos for name in ("arm", "hand")]
    expected = np.average(centers, axis=0, weights=masses)
    assert find_target("subtree:arm", MODEL).position(data) == pytest.approx(expected)
    assert find_target("subtree:1", MODEL) == find_target("subtree:arm", MODEL)


@pytest.mark.parametrize("name", ["arm", "geom:edge", "site:can", "subtree:arm"])
def test_the_yaw_is_that_of_the_x_axis_seen_from_above(name: str, data: mujoco.MjData) -> None:
    matrix = data.geom("edge").xmat if name == "geom:edge" else data.body("arm").xmat
    x, y = matrix.reshape(3, 3)[:2, 0]
    yaw = np.radians(find_target(name, MODEL).yaw(data))
    assert np.array([np.cos(yaw), np.sin(yaw)]) * np.hypot(x, y) == pytest.approx(np.array([x, y]))


def test_a_point_faces_nowhere_in_particular(data: mujoco.MjData) -> None:
    assert BoundObjectOrPoint(point=(1, 2, 3)).yaw(data) == 0


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("subtree:arn", "no body 'arn' (did you mean 'arm' or 'air'?)\nbodies: world, arm, hand, air"),
        ("hnad", "no object 'hnad' (did you mean 'hand'?)"),
        ((0, 1, float("nan")), "'0, 1, nan' is not a point"),
    ],
)
def test_a_spot_that_is_not_there_is_refused(name: str | tuple[float, float, float], message: str) -> None:
    with pytest.raises(MjrunError) as caught:
        find_target(name, MODEL)
    assert caught.value.exit_code == 2
    assert message in str(caught.value)


def test_a_subtree_leaves_no_trail() -> None:
    with pytest.raises(MjrunError, match="no object 'subtree:arm'"):
        identify_objects("subtree:arm", MODEL)


def box(center: np.ndarray, matrix: np.ndarray, halves: list[float]) -> np.ndarray:
    """The corners of a box, one by one."""
    rows = [np.array([a, b, c]) * halves for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]
    return np.array([center + matrix.reshape(3, 3) @ row for row in rows])


def same_points(one: np.ndarray, other: np.ndarray) -> bool:
    apart = np.linalg.norm(one[:, None] - other[None], axis=2)
    return len(one) == len(other) and bool((apart.min(axis=0) < 1e-12).all() and (apart.min(axis=1) < 1e-12).all())


def test_the_bounds_of_a_box_are_its_corners(data: mujoco.MjData) -> None:
    geom = data.geom("edge")
    assert same_points(object_bounds("edge", MODEL).points(data), box(geom.xpos, geom.xmat, [0.1, 0.2, 0.3]))


def test_the_bounds_of_a_body_hold_all_that_hangs_on_it(data: mujoco.MjData) -> None:
    points = object_bounds("arm", MODEL).points(data)
    assert np.array_equal(points[:8], object_bounds("edge", MODEL).points(data))
    assert np.array_equal(points[8:], object_bounds("hand", MODEL).points(data))
    assert np.array_equal(object_bounds("subtree:arm", MODEL).points(data), points)


def test_a_mesh_lies_within_its_bounds_and_touches_each_side(data: mujoco.MjData) -> None:
    matrix = data.geom("wedge").xmat.reshape(3, 3)
    corners = object_bounds("geom:wedge", MODEL).points(data) @ matrix
    vertices = (MODEL.mesh_vert @ matrix.T + data.geom("wedge").xpos) @ matrix
    assert corners.min(axis=0) == pytest.approx(vertices.min(axis=0), abs=1e-5)
    assert corners.max(axis=0) == pytest.approx(vertices.max(axis=0), abs=1e-5)


@pytest.mark.parametrize(
    ("name", "halves"),
    [("ball", [0.2, 0.2, 0.2]), ("rod", [0.1, 0.1, 0.5]), ("can", [0.1, 0.1, 0.4]), ("egg", [0.1, 0.2, 0.3])],
)
def test_a_site_is_as_large_as_its_type_and_size_say(name: str, halves: list[float], data: mujoco.MjData) -> None:
    site = data.site(name)
    assert same_points(object_bounds(name, MODEL).points(data), box(site.xpos, site.xmat, halves))


def test_a_plane_is_as_large_as_it_is_drawn_and_nothing_if_it_has_no_end(data: mujoco.MjData) -> None:
    points = object_bounds("floor", MODEL).points(data)
    assert points.min(axis=0) == pytest.approx(np.array([-2, -1, -1]))
    assert points.max(axis=0) == pytest.approx(np.array([2, 1, -1]))
    world = object_bounds("world", MODEL)
    assert sorted(world.ids) == [MODEL.geom(name).id for name in ("floor", "edge", "wedge")]


@pytest.mark.parametrize("name", ["air", "earth"])
def test_what_has_no_bounds_cannot_be_fitted(name: str) -> None:
    with pytest.raises(MjrunError, match=f"{name} cannot be fitted into an image") as caught:
        object_bounds(name, MODEL)
    assert caught.value.exit_code == 2


SKINNED = """<mujoco><worldbody>
    <body name="a" pos="1 0 0" euler="20 30 0"><freejoint/><geom size=".01"/></body>
    <body name="b" pos="2 0 1" euler="0 10 40"><freejoint/><geom size=".01"/></body></worldbody>
  <deformable><skin name="s" inflate=".05" {look} vertex="0 0 0 2 0 0 0 2 0 2 2 1" face="0 1 2 1 3 2">
    <bone body="a" bindpos="0 .1 0" bindquat="1 .2 0 0" vertid="0 1 2" vertweight="1 .5 .3"/>
    <bone body="b" bindpos="2 0 0" bindquat="1 0 .3 0" vertid="1 2 3" vertweight=".5 .7 1"/>
  </skin></deformable></mujoco>"""


def test_a_skin_lies_within_the_points_of_what_moves() -> None:
    model = mujoco.MjModel.from_xml_string(SKINNED.format(look=""))
    data = mujoco.MjData(model)
    scene = mujoco.MjvScene(model, 10)
    for seed in range(5):
        data.qpos[:] = np.random.default_rng(seed).normal(size=model.nq)
        mujoco.mj_forward(model, data)
        mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, mujoco.MjvCamera(), 7, scene)
        shown = scene.skinvert.reshape(-1, 3)
        parts = moving_parts(model)
        assert parts
        points = parts.points(data)
        assert (points.min(axis=0) <= shown.min(axis=0) + 1e-6).all()
        assert (points.max(axis=0) >= shown.max(axis=0) - 1e-6).all()
        assert np.ptp(points, axis=0).max() < 4 * np.ptp(shown, axis=0).max()


@pytest.mark.parametrize("look", ['rgba="1 1 1 0"', 'group="4"'])
def test_a_skin_that_is_not_drawn_does_not_count(look: str) -> None:
    model = mujoco.MjModel.from_xml_string(SKINNED.format(look=look))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    parts = moving_parts(model)
    assert parts
    assert len(parts.points(data)) == 2 * 8
