"""The default camera: MuJoCo's free camera, moved to keep the motion in view; of a bare model it is closer."""

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import mujoco
import numpy as np

from mjrun.camera.pose import CameraPose, Frustum, around, contains, fitted
from mjrun.camera.rigs.free_camera import AZIMUTH, ELEVATION
from mjrun.camera.rigs.rig import MujocoCameras, Rig, ShotTime
from mjrun.camera.targets import MovingParts, moving_parts
from mjrun.options.kinds import optional
from mjrun.options.number_kinds import RealKind
from mjrun.options.option import option, positional_options

MARGIN = 1.1  # size of the image relative to the motion
FREE_VIEW = (90.0, -45.0)  # MuJoCo's azimuth and elevation for models that state none [deg]
CLOSE_VIEW = (140.0, -20.0)  # those of the camera of a bare model: robots look along x
FARTHEST = 3.0  # distance of a still camera, in distances of MuJoCo's free camera; beyond, the camera follows


@positional_options
class AutoRig(Rig):
    """MuJoCo's free camera, moved back where the motion would leave the view; it follows what goes far away."""

    kind: ClassVar[str] = "auto"
    help: ClassVar[str] = "MuJoCo's free camera, moved so that the whole motion is in view."

    azimuth: float | None = option(converter=optional(RealKind(least=None)), default=None, help=AZIMUTH)
    elevation: float | None = option(converter=optional(RealKind(least=None)), default=None, help=ELEVATION)

    def bind(self, cameras: MujocoCameras, where: str) -> "BoundAutoRig":
        free, direction = cameras.free, (cameras.free.azimuth, cameras.free.elevation)
        if cameras.is_framed and direction == FREE_VIEW:
            direction = CLOSE_VIEW
        azimuth = direction[0] if self.azimuth is None else self.azimuth
        elevation = direction[1] if self.elevation is None else self.elevation
        pose = around(np.array(free.lookat), free.distance, azimuth, elevation, cameras.frustum)
        return BoundAutoRig(cameras.model, pose, is_framed=cameras.is_framed)


class BoundAutoRig:
    """MuJoCo's free camera until `aim_at_motion` has moved it.

    Args:
      pose: the pose of MuJoCo's free camera.
      is_framed: whether the camera frames the whole model, moving or not, as closely as possible.
    """

    def __init__(self, model: mujoco.MjModel, pose: CameraPose, *, is_framed: bool) -> None:
        self._free, self._pose, self._is_framed = pose, pose, is_framed
        self._parts = self._shown = moving_parts(model)
        if is_framed:
            self._shown = moving_parts(model, with_still=True)
            self._parts = self._parts or self._shown
        self._followed: np.ndarray | None = None  # the centre of mass that `_pose` is for, if the camera follows it

    @property
    def frustum(self) -> Frustum:
        return self._free.frustum

    def pose(self, data: mujoco.MjData, at: ShotTime) -> CameraPose:
        if self._followed is None or self._parts is None:
            return self._pose
        return replace(self._pose, position=self._pose.position + self._parts.center(data) - self._followed)

    def outermost_points(
        self, frustum: Frustum, size: tuple[int, int], rolls: Sequence[float]
    ) -> "OutermostPoints | None":
        """Returns an empty collection of points for images of `size` with this frustum; None if nothing can move.

        Args:
          rolls: the turns around the axis of view at which images show all of it [deg], as in `CameraPose.rolled`.
        """
        if self._parts is None or self._shown is None:
            return None
        free, least = replace(self._free, frustum=frustum), 0.0 if self._is_framed else 1.0
        return OutermostPoints(self._parts, self._shown, free, size, least, rolls)

    def aim_at_motion(self, outermost: "OutermostPoints") -> str:
        """Moves the camera so that the surveyed motion is in view; returns a remark if it was not."""
        if outermost.fits() and not self._is_framed:
            return ""
        if still := outermost.still():
            self._pose = still
            return "" if self._is_framed else "the camera is moved so that the whole motion is in view"
        self._pose, self._followed = outermost.following(), outermost.start
        return "the camera follows the model, since the whole motion is too large for one view"


class OutermostPoints:
    """The outermost points of what is to be seen, over the instants that are added.

    Only the points that are farthest in the directions of the sides of the image matter, and the nearest to the camera
    and the farthest from it.

    Args:
      parts: what a camera that follows keeps in view.
      shown: what a still camera keeps in view.
      least: the least scale of the view, in that of the free camera.
      rolls: the turns of the camera around its axis of view [deg].

    Attributes:
      start: the centre of mass at the first instant `(3,)` [m]; None before it.
    """

    def __init__(
        self,
        parts: MovingParts,
        shown: MovingParts,
        free: CameraPose,
        size: tuple[int, int],
        least: float,
        rolls: Sequence[float],
    ) -> None:
        self._parts, self._shown, self._free, self._size, self._least = parts, shown, free, size, least
        self._rolled = [free.rolled(roll) for roll in rolls]
        self._directions = np.concatenate([_directions(pose, size) for pose in self._rolled])
        self._still = np.full((len(self._directions), 3), np.nan)
        self._following = self._still.copy()
        self.start: np.ndarray | None = None
        self._moved = np.zeros(3)  # the displacement of the centre of mass at the last instant

    def add(self, data: mujoco.MjData) -> None:
        """Adds an instant, whose positions `data` holds."""
        center = self._parts.center(data)
        if self.start is None:
            self.start = center
        self._moved = center - self.start
        shown = self._outermost(self._shown.points(data))
        moving = shown if self._parts is self._shown else self._outermost(self._parts.points(data))
        self._still = self._farther(self._still, shown)
        self._following = self._farther(self._following, moving - self._moved)

    def add_ghost(self, data: mujoco.MjData, offset: np.ndarray) -> None:
        """Adds the parts that can move, displaced, at the instant that was added last."""
        points = self._outermost(self._parts.points(data) + offset)
        self._still = self._farther(self._still, points)
        self._following = self._farther(self._following, points - self._moved)

    def fits(self) -> bool:
        """Returns whether MuJoCo's free camera sees everything."""
        return self.start is None or all(contains(pose, self._still, self._size) for pose in self._rolled)

    def still(self) -> CameraPose | None:
        """Returns a pose from which everything stays in view; None if that is too far away."""
        return self._framed(self._still)

    def following(self) -> CameraPose:
        """Returns a pose for the first instant that shows everything if it moves with the centre of mass.

        Parts that move away from each other can still leave the view.
        """
        return self._framed(self._following) or self._at_scale(self._free, FARTHEST)

    def _framed(self, points: np.ndarray) -> CameraPose | None:
        poses = [fitted(pose, points, self._size, MARGIN) for pose in self._rolled]  # all with the same middle
        needed = max(map(_shown_length, poses))
        scale = max(needed / _shown_length(self._free), self._least)
        level = replace(poses[0], rotation=self._free.rotation)
        return _seeing_to(self._at_scale(level, scale), points) if scale <= FARTHEST else None

    def _at_scale(self, pose: CameraPose, scale: float) -> CameraPose:
        """Returns a pose with the same middle that shows `scale` times as much as the free camera."""
        if pose.frustum.orthographic:
            return pose.opened(scale * self._free.frustum.fovy)
        distance = scale * self._free.distance
        return replace(pose, position=pose.lookat - distance * pose.forward, distance=distance)

    def _outermost(self, points: np.ndarray) -> np.ndarray:
        """Returns, for each direction, the point that is farthest in it."""
        return points[(points @ self._directions.T).argmax(axis=0)]

    def _farther(self, points: np.ndarray, others: np.ndarray) -> np.ndarray:
        """Returns, for each direction, the point that is farther in it."""
        old, new = ((each * self._directions).sum(axis=1) for each in (points, others))
        return np.where((new > old) | np.isnan(old), others.T, points.T).T


def _shown_length(pose: CameraPose) -> float:
    """Returns the length that what a camera shows is proportional to [m]: its distance; its height if orthographic."""
    return pose.frustum.fovy if pose.frustum.orthographic else pose.distance


def _seeing_to(pose: CameraPose, points: np.ndarray) -> CameraPose:
    """Returns the pose with its far clipping plane beyond all `points` `(n, 3)` [m]."""
    farthest = MARGIN * float(((points - pose.position) @ pose.forward).max())
    return replace(pose, frustum=replace(pose.frustum, far=max(pose.frustum.far, farthest)))


def _directions(pose: CameraPose, size: tuple[int, int]) -> np.ndarray:
    """Returns the outward normals of the sides of an image with a margin, then back and forward `(6, 3)`."""
    right, up, back = pose.rotation.T
    frustum = pose.frustum
    half = np.array([frustum.halfwidth(size), (frustum.top - frustum.bottom) / 2]) / MARGIN
    across, down = np.zeros(2) if frustum.orthographic else half / frustum.near
    return np.array([right + across * back, -right + across * back, up + down * back, -up + down * back, back, -back])
