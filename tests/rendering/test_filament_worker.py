"""Filament's process as its parent talks to it, and its depth against the projections of OpenGL and Vulkan."""

from contextlib import closing

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.camera.pose import Frustum
from mjrun.camera.script import parse_camera
from mjrun.camera.script_poses import BoundCameraScript
from mjrun.model.state import save
from mjrun.rendering.backend import WorkingBackend
from mjrun.rendering.filament_worker import planar_depth
from mjrun.rendering.visual import SegmentationIds, Visual
from mjrun.worker import Worker

SIZE = (48, 32)
MODEL = """
<mujoco><worldbody>
  <camera name="above" pos="0 0 2" fovy="60"/>
  <geom name="floor" type="plane" size="0 0 1"/>
  <body name="box" pos="0 0 .2"><freejoint/><geom name="box" type="box" size=".2 .2 .2"/></body>
</worldbody></mujoco>
"""


@given(st.floats(1e-3, 1.0), st.floats(1.1, 1e4), st.floats(0, 1), st.booleans())
def test_depth_is_what_the_projection_maps_to_the_buffer(
    near: float, ratio: float, share: float, orthographic: bool
) -> None:
    far = ratio * near
    depth = near + share * (far - near)
    # Reversed from glFrustum and glOrtho, with depth from 1 to 0.
    buffer = (far - depth) / (far - near) if orthographic else near * (far - depth) / (depth * (far - near))
    found = planar_depth(np.array([[buffer, 0.0]]), Frustum(0, 0, -1, 1, near, far, orthographic))
    assert found.dtype == np.float32
    assert found[0, 0] == (pytest.approx(depth, rel=1e-5) if buffer > 0 else np.inf)
    assert found[0, 1] == np.inf


def test_a_state_is_drawn_as_rays_meet_it(vulkan: WorkingBackend) -> None:
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    data.qpos[:3] = 0.3, 0.2, 0.2
    mujoco.mj_forward(model, data)
    state, segmentation = save(model, data), SegmentationIds(model)
    pose = BoundCameraScript(parse_camera("above", model), model, SIZE).pose(state)

    with closing(
        Worker("mjrun.rendering.filament_worker:FilamentServer", environment={"MUJOCO_GL": "disable"})
    ) as worker:
        worker.ask("open", model, SIZE, Visual(), segmentation, [])
        worker.ask("set_state", state, 0)
        picture = worker.ask("render", pose, ("depth", "seg"))

    assert not picture.legend  # the parent has it
    assert picture.rgb is None
    agree = 0
    for row, column in np.ndindex(SIZE[::-1]):
        local = np.array(
            [
                (column + 0.5 - picture.calibration.cx) / picture.calibration.fx,
                (row + 0.5 - picture.calibration.cy) / picture.calibration.fy,
                1.0,
            ]
        )
        hit = np.zeros(1, np.int32)
        # The ray's vector is one metre deep, so that distances along it are planar depths.
        depth = mujoco.mj_ray(model, data, pose.position, picture.calibration.pose[:3, :3] @ local, None, 1, -1, hit)
        agree += picture.ids[row, column] == hit[0] and picture.depth[row, column] == pytest.approx(depth, rel=1e-4)
    assert agree >= 0.95 * SIZE[0] * SIZE[1]  # the rest are edges
    assert set(np.unique(picture.ids)) == {0, 1}
