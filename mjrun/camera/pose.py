"""The poses of cameras: position, rotation, frustum and calibration as plain values, and compact arrays of them."""

import math
from array import array
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import overload

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import ModelError
from mjrun.model.camera_images import CameraCalibration

EMPTY_FRUSTUM = (
    "its field of view or near plane is 0 or not a number\n"
    "set camera/NAME.fovy, vis.global.fovy [degrees] or vis.map.znear to a positive number"
)
LEVEL = 1e-6  # length of the horizontal part of a unit vector below which float32 makes it meaningless
NUMBERS = 3 + 9 + 1 + 7  # of a pose: position, rotation, distance, frustum


@dataclass(frozen=True)
class Frustum:
    """The view of a camera, in the terms of MuJoCo's MjvGLCamera.

    Attributes:
      center, bottom, top: position of the view on the near plane, from the axis [m]; on all planes if orthographic.
      width: half of its width there [m]; 0 means that the image's aspect determines it.
      near, far: distances of the clipping planes [m].
      orthographic: whether the camera has no perspective.
    """

    center: float
    width: float
    bottom: float
    top: float
    near: float
    far: float
    orthographic: bool = False

    @property
    def is_empty(self) -> bool:
        """True if the view is empty, as with a field of view of 0 or NaN in the model."""
        return not self.top > self.bottom

    @property
    def fovy(self) -> float:
        """The vertical field of view [deg]; its height [m] if orthographic."""
        if self.orthographic:
            return self.top - self.bottom
        return math.degrees(math.atan2(self.top, self.near) - math.atan2(self.bottom, self.near))

    def opened(self, fovy: float) -> "Frustum":
        """Returns the frustum with another vertical field of view [deg], centred and with the image's aspect."""
        half = fovy / 2 if self.orthographic else self.near * math.tan(math.radians(fovy) / 2)
        return replace(self, center=0.0, width=0.0, bottom=-half, top=half)

    def halfwidth(self, size: tuple[int, int]) -> float:
        """Returns half the width of an image of `size` on the near plane [m]."""
        return self.width or (self.top - self.bottom) * size[0] / size[1] / 2


@dataclass(frozen=True)
class CameraPose:
    """The position and view of a camera.

    Attributes:
      position: `(3,)` [m], in the world.
      rotation: `(3, 3)`, world from camera, with MuJoCo's axes: right, up, and back towards the viewer.
      frustum: the view.
      distance: distance along the axis to the target [m], for cameras that move from one pose to another.
    """

    position: np.ndarray
    rotation: np.ndarray
    frustum: Frustum
    distance: float = 1.0

    @property
    def forward(self) -> np.ndarray:
        """The direction of view `(3,)`."""
        return -self.rotation[:, 2]

    @property
    def up(self) -> np.ndarray:
        """The upward direction in the image `(3,)`."""
        return self.rotation[:, 1]

    @property
    def lookat(self) -> np.ndarray:
        """The point that the camera looks at `(3,)` [m]."""
        return self.position + self.distance * self.forward

    @property
    def angles(self) -> tuple[float, float, float]:
        """Azimuth, elevation and roll [deg], as MuJoCo's free camera counts them; roll turns clockwise."""
        x, y, z = self.forward
        elevation = math.atan2(z, math.hypot(x, y))
        if math.hypot(x, y) < LEVEL:  # straight up or down: the azimuth follows from up alone, and there is no roll
            x, y = -math.copysign(1.0, z) * self.up[:2]
        azimuth = math.atan2(y, x)
        level = rotation(math.degrees(azimuth), math.degrees(elevation))
        roll = math.atan2(float(self.up @ level[:, 0]), float(self.up @ level[:, 1]))
        return math.degrees(azimuth), math.degrees(elevation), math.degrees(roll)

    def opened(self, fovy: float) -> "CameraPose":
        """Returns the pose with another vertical field of view [deg]; [m] if orthographic."""
        return replace(self, frustum=self.frustum.opened(fovy))

    def rolled(self, roll: float) -> "CameraPose":
        """Returns the pose turned clockwise around the axis of view [deg]."""
        return replace(self, rotation=self.rotation @ turn(2, -roll))

    def panned(self, pan: float, tilt: float) -> "CameraPose":
        """Returns the pose turned to the left by `pan` and then up by `tilt` [deg], about the camera's axes."""
        return replace(self, rotation=self.rotation @ turn(1, pan) @ turn(0, tilt))

    def place(self, scene: mujoco.MjvScene) -> None:
        """Makes this the camera of `scene`, which then must be updated with `user_camera`."""
        seen = self.frustum
        for camera in (scene.camera[0], scene.camera[1]):
            camera.pos, camera.forward, camera.up = self.position, self.forward, self.up
            camera.frustum_center, camera.frustum_width = seen.center, seen.width
            camera.frustum_bottom, camera.frustum_top = seen.bottom, seen.top
            camera.frustum_near, camera.frustum_far = seen.near, seen.far
            camera.orthographic = seen.orthographic


def rotation(azimuth: float, elevation: float, roll: float = 0.0) -> np.ndarray:
    """Returns the rotation `(3, 3)`, world from camera, of MuJoCo's free camera at angles [deg]; roll is clockwise."""
    a, e, r = map(math.radians, (azimuth, elevation, roll))
    forward = np.array([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])
    level = np.array([math.sin(a), -math.cos(a), 0.0])
    upright = _cross(level, forward)
    right = math.cos(r) * level - math.sin(r) * upright
    return np.array([right, _cross(right, forward), -forward]).T.copy()


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns the cross product of two vectors `(3,)`, as `np.cross` does, but faster."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def heading(direction: np.ndarray) -> tuple[float, float]:
    """Returns azimuth and elevation [deg] of a direction `(3,)` of any length but 0.

    Straight up and down the azimuth is 90: looking down, x points right and y up, as on a map.
    """
    x, y, z = direction / np.linalg.norm(direction)
    across = math.hypot(x, y)
    azimuth = math.degrees(math.atan2(y, x)) if across >= LEVEL else 90.0
    return azimuth, math.degrees(math.atan2(z, across))


def around(lookat: np.ndarray, distance: float, azimuth: float, elevation: float, frustum: Frustum) -> CameraPose:
    """Returns the pose of MuJoCo's free camera, as in mjv_updateCamera, in float64 (lengths [m], angles [deg])."""
    turn = rotation(azimuth, elevation)
    return CameraPose(lookat + distance * turn[:, 2], turn, frustum, distance)


def fitted(pose: CameraPose, points: np.ndarray, size: tuple[int, int], margin: float) -> CameraPose:
    """Moves `pose` until `points` `(n, 3)` [m] just fit into an image of `size`, in the same direction of view.

    The middle of the box around them is in the middle of the image, which is `margin` times as large as they
    need. Without perspective, distance has no effect: the frustum is changed instead.
    """
    center = (points.min(axis=0) + points.max(axis=0)) / 2
    local = (points - center) @ pose.rotation
    sides, depths = local[:, :2], -local[:, 2]
    seen = pose.frustum
    clear = seen.near * (1 + 1e-6) - depths.min()
    if seen.orthographic:
        half = margin * np.abs(sides * [size[1] / size[0], 1]).max()
        distance = max(pose.distance, clear)
        return CameraPose(center - distance * pose.forward, pose.rotation, seen.opened(2 * half), distance)
    # On the plane at depth 1, the image is `middle` ± `half`, which may lie beside the axis.
    middle = np.array([seen.center, (seen.top + seen.bottom) / 2]) / seen.near
    half = np.array([seen.halfwidth(size), (seen.top - seen.bottom) / 2]) / seen.near / margin
    needed = np.abs(sides - depths[:, None] * middle) / half - depths[:, None]
    distance = max(float(needed.max()), clear)
    toward = pose.rotation @ [*middle, -1]
    return CameraPose(center - distance * toward, pose.rotation, seen, distance)


def contains(pose: CameraPose, points: np.ndarray, size: tuple[int, int]) -> bool:
    """Returns whether all of `points` `(n, 3)` [m] are inside an image of `size`, between the clipping planes."""
    local = (points - pose.position) @ pose.rotation
    seen, depths = pose.frustum, -local[:, 2]
    scale = np.ones(len(depths)) if seen.orthographic else depths / seen.near
    across = np.abs(local[:, 0] - seen.center * scale) <= seen.halfwidth(size) * scale
    down = (seen.bottom * scale <= local[:, 1]) & (local[:, 1] <= seen.top * scale)
    return bool(np.all(across & down & (depths >= seen.near) & (depths <= seen.far)))


def pose_of(scene: mujoco.MjvScene) -> CameraPose:
    """Returns the pose of the camera in `scene` without stereo: midway between its two eyes."""
    camera = mujoco.mjv_averageCamera(scene.camera[0], scene.camera[1])
    forward = np.array(camera.forward, np.float64)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, np.array(camera.up, np.float64))
    right /= np.linalg.norm(right)
    frustum = Frustum(
        center=float(camera.frustum_center),
        width=float(camera.frustum_width),
        bottom=float(camera.frustum_bottom),
        top=float(camera.frustum_top),
        near=float(camera.frustum_near),
        far=float(camera.frustum_far),
        orthographic=bool(camera.orthographic),
    )
    return CameraPose(
        np.array(camera.pos, np.float64), np.column_stack([right, np.cross(right, forward), -forward]), frustum
    )


def turn(axis: int, angle: float) -> np.ndarray:
    """Returns the rotation `(3, 3)` about a coordinate axis, 0 to 2, by an angle [deg]."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix, cosine, sine = np.eye(3), math.cos(math.radians(angle)), math.sin(math.radians(angle))
    matrix[i, i], matrix[j, j], matrix[i, j], matrix[j, i] = cosine, cosine, -sine, sine
    return matrix


def user_camera() -> mujoco.MjvCamera:
    """Returns the camera for updating scenes whose camera is already placed."""
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_USER.value
    return camera


class CameraPoseArray(Sequence[tuple[CameraPose, ...]]):
    """The pose of each camera for each frame, stored as numbers: the objects of a long video would fill the memory.

    Args:
      cameras: the poses of each camera, in the order of frames; equally many of each.
    """

    def __init__(self, cameras: Iterable[Iterable[CameraPose]]) -> None:
        self._tracks = [_Track(poses) for poses in cameras]

    def __len__(self) -> int:
        return min(map(len, self._tracks))

    @overload
    def __getitem__(self, index: int) -> tuple[CameraPose, ...]: ...

    @overload
    def __getitem__(self, index: slice) -> list[tuple[CameraPose, ...]]: ...

    def __getitem__(self, index: int | slice) -> tuple[CameraPose, ...] | list[tuple[CameraPose, ...]]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        return tuple(track[index] for track in self._tracks)


class _Track:
    """The poses of one camera; repeated poses are stored once."""

    def __init__(self, poses: Iterable[CameraPose]) -> None:
        self._numbers, self._rows = array("d"), array("l")
        last = b""
        for pose in poses:
            seen = pose.frustum
            sides = (seen.center, seen.width, seen.bottom, seen.top, seen.near, seen.far, seen.orthographic)
            numbers = array("d", (*pose.position.tolist(), *pose.rotation.ravel().tolist(), pose.distance, *sides))
            if (content := numbers.tobytes()) != last:
                self._numbers.frombytes(content)
                last = content
            self._rows.append(len(self._numbers) // NUMBERS - 1)

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, index: int) -> CameraPose:
        start = NUMBERS * self._rows[index]
        numbers = np.array(self._numbers[start : start + NUMBERS])
        distance, *frustum, orthographic = numbers[12:].tolist()
        seen = Frustum(*frustum, orthographic=bool(orthographic))
        return CameraPose(numbers[:3], numbers[3:12].reshape(3, 3), seen, distance)


def lens(pose: CameraPose, size: tuple[int, int]) -> CameraCalibration:
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
