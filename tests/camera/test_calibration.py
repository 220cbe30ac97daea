"""Lenses and depths, against what OpenGL drew and what rays hit."""

from dataclasses import dataclass
from itertools import product

import mujoco
import numpy as np
import pytest

from mjrun.camera.pose import Frustum, lens, metric_depth, pose_of
from mjrun.errors import ModelError
from mjrun.model.camera_images import CameraCalibration
from mjrun.rendering.backend import WorkingBackend

FRAME = 'pos=".3 -3 1.2" xyaxes="1 .1 0 -.05 .3 1"'
SENSOR = 'resolution="320 240" sensorsize=".0064 .0048"'
CAMERAS = {
    "fovy": f'<camera name="fovy" {FRAME} fovy="40"/>',
    "focal": f'<camera name="focal" {FRAME} {SENSOR} focal=".008 .009" principal=".0004 -.0003"/>',
    "pixels": f'<camera name="pixels" {FRAME} {SENSOR} focalpixel="350 380" principalpixel="-20 15"/>',
    "orthographic": f'<camera name="orthographic" {FRAME} projection="orthographic" fovy="3"/>',
    "free": "",
}
SCENE = """
<mujoco>
  <statistic center="0 0 .5" extent="2"/>
  <visual><global orthographic="{orthographic}" fovy="45"/><map {planes}/><quality offsamples="0"/></visual>
  <worldbody>
    {camera}
    <geom name="box" type="box" size=".4 .3 .2" pos=".1 0 .5" euler="20 30 40"/>
    {others}
  </worldbody>
</mujoco>
"""
OTHERS = """
<geom name="floor" type="plane" size="9 9 1"/>
<geom name="slab" type="box" size=".3 .1 .4" pos="-.6 .5 .3" euler="0 20 50"/>
<geom name="far" type="box" size="1 1 1" pos="4 40 3"/>
"""
ROUNDED = 10  # times larger are errors of depth on a GPU, which rounds corners to 1/256 of a pixel
SIZES = [(101, 77), (64, 130)]


@dataclass(frozen=True)
class Drawn:
    """What OpenGL made of a camera: geom ids (−1: nothing) and the depth buffer, rows downward."""

    model: mujoco.MjModel
    data: mujoco.MjData
    frustum: Frustum
    lens: CameraCalibration
    ids: np.ndarray
    buffer: np.ndarray


def draw(
    backend: WorkingBackend,
    camera: str,
    size: tuple[int, int],
    others: str = "",
    orthographic: bool = False,
    planes: str = "",
) -> Drawn:
    settings = {"others": others, "orthographic": str(orthographic).lower(), "planes": planes}
    text = SCENE.format(camera=CAMERAS[camera], **settings)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    width, height = size
    model.vis.global_.offwidth, model.vis.global_.offheight = size
    view = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, view)
    if camera != "free":
        view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED.value, 0
    scene = mujoco.MjvScene(model, 50)
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, view, mujoco.mjtCatBit.mjCAT_ALL.value, scene)
    scene.flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = scene.flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 1
    context = backend.context(width, height)
    drawing = mujoco.MjrContext(model, 100)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, drawing)
    drawing.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR.value
    colors, buffer = np.empty((height, width, 3), np.uint8), np.empty((height, width), np.float32)
    rect = mujoco.MjrRect(0, 0, width, height)
    mujoco.mjr_render(rect, scene, drawing)
    mujoco.mjr_readPixels(colors, buffer, rect, drawing)
    drawing.free()
    context.free()
    geoms = np.array([-1, *(geom.objid for geom in scene.geoms[: scene.ngeom])])
    ids = geoms[colors[::-1].astype(np.int32) @ np.array([1, 2**8, 2**16], np.int32)]
    seen = pose_of(scene)
    return Drawn(model, data, seen.frustum, lens(seen, size), ids, buffer[::-1])


def corners(drawn: Drawn) -> np.ndarray:
    """The corners of the box `(8, 3)`, in the world."""
    offsets = np.array(list(product((-1, 1), repeat=3))) * drawn.model.geom_size[0]
    return offsets @ drawn.data.geom_xmat[0].reshape(3, 3).T + drawn.data.geom_xpos[0]


def outside(pixels: np.ndarray, points: np.ndarray) -> np.ndarray:
    """How far each of `pixels` `(n, 2)` lies outside the convex hull of `points` `(m, 2)`; inside it is negative."""
    farthest = np.full(len(pixels), -np.inf)
    for a, b in product(points, repeat=2):
        side = np.array([b[1] - a[1], a[0] - b[0]])
        length = np.linalg.norm(side)
        if length > 1e-6 and ((points - a) @ side / length < 1e-6).all():  # an edge of the hull
            farthest = np.maximum(farthest, (pixels - a) @ side / length)
    return farthest


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("camera", CAMERAS)
def test_the_projected_corners_of_a_box_are_the_outline_of_its_pixels(
    backend: WorkingBackend, camera: str, size: tuple[int, int]
) -> None:
    drawn = draw(backend, camera, size)
    hull = drawn.lens.project(corners(drawn))[:, :2]
    u, v = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    distance = outside(np.stack([u.ravel(), v.ravel()], axis=1), hull).reshape(u.shape)
    clear = np.abs(distance) > 0.02
    assert 0.01 < (drawn.ids == 0).mean() < 0.6
    assert np.array_equal((drawn.ids == 0)[clear], (distance < 0)[clear])


def rays(drawn: Drawn) -> tuple[np.ndarray, np.ndarray]:
    """What MuJoCo's rays through the centres of a grid of pixels hit: geom ids and planar depths [m]."""
    width, height = drawn.lens.size
    ends, starts = (drawn.lens.unproject(np.full((height, width), depth)) for depth in (1.0, 0.0))
    hits, depths = np.full((height, width), -2), np.full((height, width), np.nan)
    for v, u in product(range(3, height, 9), range(3, width, 9)):
        hit = np.empty(1, np.int32)
        ray = ends[v, u] - starts[v, u]  # one metre of depth
        depth = mujoco.mj_ray(drawn.model, drawn.data, starts[v, u], ray, None, 1, -1, hit, None)
        hits[v, u], depths[v, u] = hit[0], depth
    return hits, depths


@pytest.mark.parametrize("camera", CAMERAS)
def test_depth_and_object_of_a_pixel_are_those_that_a_ray_through_its_centre_meets(
    backend: WorkingBackend, camera: str
) -> None:
    drawn = draw(backend, camera, (101, 77), OTHERS)
    depth = metric_depth(drawn.buffer, drawn.frustum)
    hits, expected = rays(drawn)
    looked = hits > -2
    assert depth.dtype == np.float32
    assert np.array_equal(drawn.ids[looked], hits[looked])
    assert np.array_equal(np.isinf(depth), drawn.ids < 0)
    seen = hits >= 0
    assert seen.sum() > 50
    resolution = 0 if drawn.lens.perspective else 2e-7 * drawn.lens.far
    error = 2e-5 if backend.software else ROUNDED * 2e-5
    assert np.all(np.abs(depth - expected)[seen] < error * expected[seen] + resolution)


@pytest.mark.parametrize("planes", ["", 'znear=".0005" zfar="400"', 'znear=".0001" zfar="10000"'])
def test_the_depth_of_something_far_away_is_right_wherever_the_clipping_planes_are(
    backend: WorkingBackend, planes: str
) -> None:
    drawn = draw(backend, "fovy", (101, 77), OTHERS.replace("40 3", "39 3"), planes=planes)
    far = drawn.ids == 3
    points = drawn.lens.unproject(np.where(far, metric_depth(drawn.buffer, drawn.frustum), np.nan))[far]
    assert len(points) > 10
    error = 2e-6 if backend.software else ROUNDED * 2e-6
    assert points[:, 1] + 3 == pytest.approx(41, rel=error)  # its near face is 41 m before the camera


def test_intrinsics_of_a_camera_are_kept_to_the_picture_s_size(backend: WorkingBackend) -> None:
    of = {camera: draw(backend, camera, (640, 480)).lens for camera in CAMERAS}
    focal = 480 / (2 * np.tan(np.deg2rad(40) / 2))
    assert (of["fovy"].fx, of["fovy"].fy) == pytest.approx((focal, focal))
    assert (of["fovy"].cx, of["fovy"].cy) == pytest.approx((320, 240))
    pixel = 0.0064 / 640  # [m], on the sensor
    assert (of["focal"].fx, of["focal"].fy) == pytest.approx((0.008 / pixel, 0.009 / pixel))
    assert (of["focal"].cx, of["focal"].cy) == pytest.approx((320 - 0.0004 / pixel, 240 + 0.0003 / pixel))
    assert (of["pixels"].fx, of["pixels"].fy) == pytest.approx((2 * 350, 2 * 380))  # said for half the size
    assert (of["pixels"].cx, of["pixels"].cy) == pytest.approx((320 + 2 * 20, 240 - 2 * 15))
    assert (of["orthographic"].fx, of["orthographic"].fy) == pytest.approx((480 / 3, 480 / 3))
    assert of["free"].fy == pytest.approx(480 / (2 * np.tan(np.deg2rad(45) / 2)))


def test_a_sensor_of_another_aspect_is_stretched_over_the_picture_as_mujoco_does(backend: WorkingBackend) -> None:
    seen = draw(backend, "pixels", (64, 120)).lens
    assert (seen.fx, seen.fy) == pytest.approx((350 / 5, 380 / 2))
    assert (seen.cx, seen.cy) == pytest.approx((32 + 20 / 5, 60 - 15 / 2))


@pytest.mark.parametrize("camera", ["fovy", "orthographic"])
def test_the_pose_is_the_camera_s_own_with_y_down_and_z_forward(backend: WorkingBackend, camera: str) -> None:
    drawn = draw(backend, camera, (64, 48))
    pose = drawn.lens.pose
    assert pose[:3, 3] == pytest.approx(drawn.data.cam_xpos[0])
    assert pose[:3, :3] == pytest.approx(drawn.data.cam_xmat[0].reshape(3, 3) @ np.diag([1, -1, -1]), abs=1e-6)
    assert pose[:3, :3] @ pose[:3, :3].T == pytest.approx(np.eye(3), abs=1e-14)
    assert np.linalg.det(pose) == pytest.approx(1)
    assert list(pose[3]) == [0, 0, 0, 1]


def test_the_clipping_planes_are_the_model_s(backend: WorkingBackend) -> None:
    drawn = draw(backend, "fovy", (64, 48))
    planes = drawn.model.vis.map
    assert (drawn.lens.near, drawn.lens.far) == pytest.approx((planes.znear * 2, planes.zfar * 2))


def test_a_free_camera_may_be_orthographic(backend: WorkingBackend) -> None:
    drawn = draw(backend, "free", (101, 77), orthographic=True)
    assert not drawn.lens.perspective
    assert (drawn.lens.fx, drawn.lens.fy) == pytest.approx((77 / 45, 77 / 45))  # fovy is a length


@pytest.mark.parametrize("orthographic", [False, True])
def test_projecting_undoes_unprojecting(backend: WorkingBackend, orthographic: bool) -> None:
    seen = draw(backend, "orthographic" if orthographic else "focal", (64, 48)).lens
    depth = np.random.default_rng(0).uniform(0.5, 9, (48, 64))
    back = seen.project(seen.unproject(depth).reshape(-1, 3))
    u, v = np.meshgrid(np.arange(64) + 0.5, np.arange(48) + 0.5)
    assert back == pytest.approx(np.stack([u.ravel(), v.ravel(), depth.ravel()], axis=1))


def test_a_camera_without_a_field_of_view_is_reported() -> None:
    spec = mujoco.MjSpec.from_string("<mujoco><worldbody><camera fovy='0'/></worldbody></mujoco>")
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    scene = mujoco.MjvScene(model, 10)
    camera = mujoco.MjvCamera()
    camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, camera, mujoco.mjtCatBit.mjCAT_ALL, scene)
    with pytest.raises(ModelError, match="field of view or near plane is 0"):
        lens(pose_of(scene), SIZES[0])
