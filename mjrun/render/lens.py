"""What a scene was drawn through: the calibrated camera, and depth in metres."""

import mujoco
import numpy as np

from mjrun.model.picture import Lens

ORTHOGRAPHIC = mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC.value


def lens(camera: mujoco.MjvGLCamera, size: tuple[int, int]) -> Lens:
    """The lens of a picture of `size` drawn through `camera`, which `average_camera` gives after mjv_updateScene.

    Right for every camera of MuJoCo: by fovy, with intrinsics of its own, free, orthographic. As mjr_render
    does it: `frustum_width` is half the width of the near plane; zero means that the aspect is the picture's.
    Intrinsics of another aspect than the picture's are stretched: then fx and fy differ.
    """
    width, height = size
    top, bottom = float(camera.frustum_top), float(camera.frustum_bottom)
    halfwidth = float(camera.frustum_width) or (top - bottom) * width / height / 2
    left = float(camera.frustum_center) - halfwidth
    distance = 1.0 if camera.orthographic else float(camera.frustum_near)
    across, down = width / (2 * halfwidth), height / (top - bottom)  # pixels per metre on the near plane
    return Lens(
        size=size,
        fx=across * distance,
        fy=down * distance,
        cx=-left * across,
        cy=top * down,
        pose=_pose(camera),
        near=float(camera.frustum_near),
        far=float(camera.frustum_far),
        perspective=not camera.orthographic,
    )


def average_camera(scene: mujoco.MjvScene) -> mujoco.MjvGLCamera:
    """The camera that a scene without stereo is drawn through: midway between its two eyes."""
    return mujoco.mjv_averageCamera(scene.camera[0], scene.camera[1])


def in_perspective(model: mujoco.MjModel, camera: mujoco.MjvCamera) -> bool:
    """Whether a picture of `model` through `camera` will be in perspective, which some calibration files need."""
    if camera.type == mujoco.mjtCamera.mjCAMERA_FIXED.value:
        return int(model.cam_projection[camera.fixedcamid]) != ORTHOGRAPHIC
    return not camera.orthographic


def metric_depth(buffer: np.ndarray, camera: mujoco.MjvGLCamera) -> np.ndarray:
    """Planar depth `(h, w)` float32 [m] of an OpenGL depth buffer; infinite where nothing was drawn.

    In perspective the relative error is some 1e-6, a few times more where a surface is seen at a grazing angle;
    of an orthographic camera the absolute error is some 1e-7 of the distance between its clipping planes.

    Args:
      buffer: `(h, w)` float32 of a segmentation pass, in which there is no sky, read by mjr_readPixels into
        a context whose `readDepthMap` is mjDEPTH_ZEROFAR: 1 is near, 0 far. Read as MuJoCo's default,
        mjDEPTH_ZERONEAR, it has lost most of its digits.
      camera: as `average_camera` gives it.
    """
    near, far = np.float32(camera.frustum_near), np.float32(camera.frustum_far)
    values = buffer.astype(np.float64)
    if camera.orthographic:
        depth = far - values * (np.float64(far) - near)
    else:
        # glFrustum's matrix, which OpenGL holds in float32, as MuJoCo reverses it: what rounding did to it is
        # undone too. https://registry.khronos.org/OpenGL-Refpages/gl2.1/xhtml/glFrustum.xml
        slope = np.float32(0.5) * ((far + near) / (far - near)) - np.float32(0.5)
        offset = far * near / (far - near)
        with np.errstate(divide="ignore"):  # a far plane so far that it is at infinity
            depth = np.float64(offset) / (values + np.float64(slope))
    return np.where(buffer > 0, depth, np.inf).astype(np.float32)


def _pose(camera: mujoco.MjvGLCamera) -> np.ndarray:
    """World from camera `(4, 4)`, its axes made orthonormal beyond float32."""
    forward = np.array(camera.forward, np.float64)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, np.array(camera.up, np.float64))
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.column_stack([right, np.cross(forward, right), forward, np.array(camera.pos, np.float64)])
    return pose
