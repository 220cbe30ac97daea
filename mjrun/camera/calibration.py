"""What a scene was drawn through: the calibrated camera, and depth in metres."""

import numpy as np

from mjrun.camera.pose import EMPTY_FRUSTUM, Frustum, Pose
from mjrun.errors import ModelError
from mjrun.model.rendered_view import CameraCalibration


def lens(pose: Pose, size: tuple[int, int]) -> CameraCalibration:
    """The lens of an image of `size` that is drawn from `pose`.

    Right for every camera of MuJoCo: by fovy, with intrinsics of its own, free, orthographic. As mjr_render
    does it: a frustum's `width` is half the width of the near plane; zero means that the aspect is the image's.
    Intrinsics of another aspect than the image's are stretched: then fx and fy differ.

    Raises:
      ModelError: the camera's field of view is empty.
    """
    (width, height), seen = size, pose.frustum
    if seen.is_empty:
        raise ModelError(f"a camera sees nothing: {EMPTY_FRUSTUM}")
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
    """Planar depth `(h, w)` float32 [m] of an OpenGL depth buffer; infinite where nothing was drawn.

    In perspective the relative error is some 1e-6, a few times more where a surface is seen at a grazing angle;
    of an orthographic camera the absolute error is some 1e-7 of the distance between its clipping planes.

    Args:
      buffer: `(h, w)` float32 of a segmentation pass, in which there is no sky, read by mjr_readPixels into
        a context whose `readDepthMap` is mjDEPTH_ZEROFAR: 1 is near, 0 far. Read as MuJoCo's default,
        mjDEPTH_ZERONEAR, it has lost most of its digits.
      frustum: that it was drawn with.
    """
    near, far = np.float32(frustum.near), np.float32(frustum.far)
    values = buffer.astype(np.float64)
    if frustum.orthographic:
        depth = far - values * (np.float64(far) - near)
    else:
        # glFrustum's matrix, which OpenGL holds in float32, as MuJoCo reverses it: what rounding did to it is
        # undone too. https://registry.khronos.org/OpenGL-Refpages/gl2.1/xhtml/glFrustum.xml
        slope = np.float32(0.5) * ((far + near) / (far - near)) - np.float32(0.5)
        offset = far * near / (far - near)
        with np.errstate(divide="ignore"):  # a far plane so far that it is at infinity
            depth = np.float64(offset) / (values + np.float64(slope))
    return np.where(buffer > 0, depth, np.inf).astype(np.float32)
