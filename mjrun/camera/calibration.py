"""The calibration of a rendered image: its camera, and depth in metres."""

import numpy as np

from mjrun.camera.pose import EMPTY_FRUSTUM, Frustum, Pose
from mjrun.errors import ModelError
from mjrun.model.rendered_image import CameraCalibration


def lens(pose: Pose, size: tuple[int, int]) -> CameraCalibration:
    """Returns the calibrated camera of an image of `size` rendered from `pose`.

    Valid for every camera of MuJoCo: by fovy, with explicit intrinsics, free, orthographic. As in mjr_render, a
    frustum's `width` is half the width of the near plane; zero means that the aspect is the image's. Intrinsics with an
    aspect other than the image's are stretched: then fx and fy differ.

    Raises:
      ModelError: the camera's field of view is empty.
    """
    (width, height), seen = size, pose.frustum
    if seen.is_empty:
        raise ModelError(f"a camera has an empty view: {EMPTY_FRUSTUM}")
    halfwidth = seen.width or (seen.top - seen.bottom) * width / height / 2
    left = seen.center - halfwidth
    distance = 1.0 if seen.orthographic else seen.near
    across, down = width / (2 * halfwidth), height / (seen.top - seen.bottom)  # pixels per metre on the near plane
    world = np.eye(4)
    world[:3] = np.column_stack([pose.rotation * [1, -1, -1], pose.position])
    return CameraCalibration(
        size=size,
        fx=across * distance,
        fy=down * distance,
        cx=-left * across,
        cy=seen.top * down,
        pose=world,
        near=seen.near,
        far=seen.far,
        perspective=not seen.orthographic,
    )


def metric_depth(buffer: np.ndarray, frustum: Frustum) -> np.ndarray:
    """Converts an OpenGL depth buffer to planar depth `(h, w)` float32 [m], infinite for the background.

    In perspective the relative error is some 1e-6, a few times more on surfaces at a grazing angle; for an orthographic
    camera the absolute error is some 1e-7 of the distance between its clipping planes.

    Args:
      buffer: `(h, w)` float32 of a segmentation pass, which has no sky, read by mjr_readPixels into a context whose
        `readDepthMap` is mjDEPTH_ZEROFAR: 1 is near, 0 far. MuJoCo's default, mjDEPTH_ZERONEAR, loses most of the
        digits.
      frustum: the frustum of the image.
    """
    near, far = np.float32(frustum.near), np.float32(frustum.far)
    values = buffer.astype(np.float64)
    if frustum.orthographic:
        depth = far - values * (np.float64(far) - near)
    else:
        # glFrustum's matrix, which OpenGL holds in float32, as MuJoCo reverses it: the effect of its rounding is undone
        # too. https://registry.khronos.org/OpenGL-Refpages/gl2.1/xhtml/glFrustum.xml
        slope = np.float32(0.5) * ((far + near) / (far - near)) - np.float32(0.5)
        offset = far * near / (far - near)
        with np.errstate(divide="ignore"):  # the far plane may be at infinity
            depth = np.float64(offset) / (values + np.float64(slope))
    return np.where(buffer > 0, depth, np.inf).astype(np.float32)
