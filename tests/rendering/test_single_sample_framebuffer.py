"""Ids and depth of a framebuffer without multisampling, against MuJoCo's own renderer and against rays."""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import product

import mujoco
import numpy as np

from mjrun.camera.pose import lens, metric_depth, pose_of
from mjrun.rendering.backend import WorkingBackend
from mjrun.rendering.classic import SingleSampleFramebuffer

SIZE = (64, 48)
SCENE = """
<mujoco>
  <visual><global offwidth="64" offheight="48"/><quality offsamples="{samples}"/></visual>
  <worldbody>
    <light pos="0 -1 3"/>
    <camera name="side" pos="0 -2 .8" xyaxes="1 0 0 0 .3 1"/>
    <geom type="plane" size="0 0 1"/>
    <geom type="box" size=".3 .2 .2" pos="-.4 0 .2" euler="0 0 30"/>
    <geom size=".3" pos=".4 .3 .3"/>
  </worldbody>
</mujoco>
"""


def posed(samples: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(SCENE.format(samples=samples))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


@contextmanager
def drawing(
    model: mujoco.MjModel, data: mujoco.MjData, backend: WorkingBackend
) -> Iterator[tuple[mujoco.MjvScene, mujoco.MjrContext]]:
    """A scene seen by the model's camera, whose flags ask for ids as colours, in an OpenGL context."""
    gl = backend.context(*SIZE)
    context = mujoco.MjrContext(model, 100)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, context)
    scene, camera = mujoco.MjvScene(model, 100), mujoco.MjvCamera()
    camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED.value, 0
    every = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, camera, every, scene)
    for flag in (mujoco.mjtRndFlag.mjRND_SEGMENT, mujoco.mjtRndFlag.mjRND_IDCOLOR):
        scene.flags[flag] = 1
    try:
        yield scene, context
    finally:
        context.free()
        gl.free()


def drawn(samples: int, backend: WorkingBackend, size: tuple[int, int] = SIZE) -> tuple[np.ndarray, np.ndarray]:
    """Segment numbers and OpenGL's depth."""
    with drawing(*posed(samples), backend) as (scene, context):
        buffer = SingleSampleFramebuffer(size)
        colors, depth = (image.copy() for image in buffer.draw(scene, context))
        buffer.free()
    assert not colors[:, :, 1:].any()
    return colors[:, :, 0], depth


def test_ids_and_depth_are_those_of_mujoco_s_renderer_without_multisampling(backend: WorkingBackend) -> None:
    model, data = posed(samples=0)
    with mujoco.Renderer(model, SIZE[1], SIZE[0]) as renderer:
        renderer.update_scene(data, "side")
        renderer.enable_segmentation_rendering()
        segments = renderer.render()
        geoms = np.where(segments[:, :, 1] == mujoco.mjtObj.mjOBJ_GEOM, segments[:, :, 0], -1)
    numbers, _ = drawn(0, backend)
    assert np.array_equal(numbers.astype(int) - 1, geoms)  # geoms of this scene are numbered as in the model
    assert set(np.unique(geoms)) == {-1, 0, 1, 2}


def test_depth_is_that_of_rays(backend: WorkingBackend) -> None:
    model, data = posed(samples=4)
    numbers, buffer = drawn(4, backend)
    with drawing(model, data, backend) as (scene, _):
        pose = pose_of(scene)
    calibration, depths = lens(pose, SIZE), metric_depth(buffer, pose.frustum)
    assert np.array_equal(np.isfinite(depths), numbers > 0)
    flat = numbers == 2  # the box: balls have facets, and the plane ends somewhere
    assert flat.sum() > 100

    def box_depth(row: float, column: float) -> float:
        ray = np.array([column + 0.5 - calibration.cx, row + 0.5 - calibration.cy, 1])
        ray[:2] /= calibration.fx, calibration.fy
        hit = np.zeros(1, np.int32)
        # The ray's vector is one metre deep, so that distances along it are planar depths.
        depth = mujoco.mj_ray(model, data, pose.position, calibration.pose[:3, :3] @ ray, None, 1, -1, hit)
        return depth if hit[0] == 1 else np.nan

    compared = 0
    shift = 0 if backend.software else 1 / 512  # GPUs round corners to 1/256 of a pixel
    for row, column in np.argwhere(flat):
        depth = box_depth(row, column)
        near = [box_depth(row + y, column + x) for x, y in product((-shift, shift), repeat=2)]
        if np.isfinite([depth, *near]).all():
            assert abs(depths[row, column] - depth) <= np.abs(np.array(near) - depth).max() + 1e-5 * depth
            compared += 1
    assert compared > 100


def test_multisampling_of_colours_changes_nothing(backend: WorkingBackend) -> None:
    for image, same in zip(drawn(0, backend), drawn(8, backend), strict=True):
        assert np.array_equal(image, same)


def test_a_framebuffer_has_its_own_size(backend: WorkingBackend) -> None:
    numbers, depth = drawn(4, backend, size=(33, 101))  # rows of a length that OpenGL would pad
    assert numbers.shape == depth.shape == (101, 33)
    assert set(np.unique(numbers)) == {0, 1, 2, 3}


def test_drawing_exactly_leaves_mujoco_s_own_buffer_in_charge(backend: WorkingBackend) -> None:
    model, data = posed(samples=4)
    rect = mujoco.MjrRect(0, 0, *SIZE)
    with drawing(model, data, backend) as (scene, context):
        scene.flags[:] = mujoco.MjvScene(model, 1).flags
        images = []
        for _ in range(2):
            pixels = np.empty((*SIZE[::-1], 3), np.uint8)
            mujoco.mjr_render(rect, scene, context)
            mujoco.mjr_readPixels(pixels, None, rect, context)
            images.append(pixels)
            buffer = SingleSampleFramebuffer((16, 16))
            buffer.draw(scene, context)
            buffer.free()
    assert len(np.unique(images[0])) > 20
    assert np.array_equal(*images)
