"""Rigs whose names have been found in a model, and that can tell a camera's pose at any instant of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import mujoco
import numpy as np

from mjrun.camera.easing import EASINGS, ramped
from mjrun.camera.path import PLACE, Curve, Odometer, centripetal, orbital, orbital_lengths
from mjrun.camera.pose import Frustum, Pose, around, heading, pose_of, rotation, turn
from mjrun.camera.script import AroundRig, LookRig, ModelRig, PathRig, Ramp, Rig, Waypoint
from mjrun.camera.targets import Spot, spot
from mjrun.errors import BadValueError, UnknownNameError, UsageError
from mjrun.model.names import identify

CURVES = ("spline", "linear")
PACES = ("constant", "time")


@dataclass(frozen=True)
class Moment:
    """An instant of a shot.

    Attributes:
      time: simulated [s].
      elapsed: since the shot began [s], never less than 0 nor more than it lasts.
      phase: the same from 0 to 1.
    """

    time: float
    elapsed: float
    phase: float


class BoundRig(Protocol):
    """Anything that can tell a camera's pose."""

    @property
    def frustum(self) -> Frustum:
        """What it sees, if nothing opens it further."""
        ...

    def pose(self, data: mujoco.MjData, moment: Moment) -> Pose:
        """The pose at a moment; positions in `data` are those of it."""
        ...


class Viewer:
    """What MuJoCo's own cameras see: a scene without geoms.

    Attributes:
      data: the model's initial state, with positions computed.
      free: MuJoCo's free camera.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model, self.data, self.free = model, mujoco.MjData(model), mujoco.MjvCamera()
        place(model, self.data)
        mujoco.mjv_defaultFreeCamera(model, self.free)
        self._scene = mujoco.MjvScene(model, 1)
        self.frustum = self.pose(self.data, self.free).frustum

    def pose(self, data: mujoco.MjData, camera: mujoco.MjvCamera) -> Pose:
        """The pose of `camera`, as MuJoCo has it, in float32."""
        mujoco.mjv_updateCamera(self.model, data, camera, self._scene)
        return pose_of(self._scene)


def place(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Computes where everything is that a camera can follow, or be on."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)


def aim(rig: Rig, viewer: Viewer, where: str) -> BoundRig:
    """`rig` with its names found in a model.

    Args:
      where: what is to be named in errors.

    Raises:
      UnknownNameError: a name is not there; the message lists those that are.
      BadValueError: a number is out of its range.
      UsageError: settings do not go together.
    """
    if isinstance(rig, ModelRig):
        return BoundModelRig(viewer, identify(viewer.model, "camera", rig.camera))
    if isinstance(rig, AroundRig):
        return _around(rig, viewer, where)
    if isinstance(rig, LookRig):
        if rig.eye == rig.target:
            raise UsageError(f"{where}: the camera cannot look at where it is")
        return BoundLookRig(spot(rig.eye, viewer.model), spot(rig.target, viewer.model), viewer.frustum, where)
    return BoundPathRig(rig, viewer, where)


def check_ramp(ramp: Ramp, where: str, low: float = -np.inf, high: float = np.inf, expected: str = "finite") -> None:
    """Raises unless `ramp` stays between `low` and `high`, by a known ease; ends are excluded."""
    if ramp.ease not in EASINGS:
        raise UnknownNameError("ease", ramp.ease, list(EASINGS), where=where)
    for value in (ramp.start, ramp.end):
        if not low < value < high:
            raise BadValueError(where, f"{value:g}", expected)


class BoundModelRig:
    """A camera declared in the model. It looks as far as to the point of its axis nearest to the model's centre."""

    def __init__(self, viewer: Viewer, camera: int) -> None:
        self._viewer, self._camera = viewer, mujoco.MjvCamera()
        self._camera.type, self._camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED.value, camera
        self.frustum = viewer.pose(viewer.data, self._camera).frustum

    def pose(self, data: mujoco.MjData, moment: Moment) -> Pose:
        pose, size = self._viewer.pose(data, self._camera), self._viewer.model.stat
        distance = max(float(pose.forward @ (size.center - pose.position)), 0.1 * size.extent)
        return Pose(pose.position, pose.rotation, pose.frustum, distance)


@dataclass(frozen=True)
class BoundAroundRig:
    """MuJoCo's free camera around something."""

    target: Spot
    rig: AroundRig
    distance: Ramp
    azimuth: Ramp
    elevation: Ramp
    frustum: Frustum

    def pose(self, data: mujoco.MjData, moment: Moment) -> Pose:
        yaw = self.target.yaw(data) if self.rig.heading else 0.0
        distance, azimuth, elevation = (ramped(r, moment.phase) for r in (self.distance, self.azimuth, self.elevation))
        lookat = self.target.position(data) + turn(2, yaw) @ self.rig.offset
        return around(lookat, distance, azimuth + yaw, elevation, self.frustum)


def _around(rig: AroundRig, viewer: Viewer, where: str) -> BoundAroundRig:
    if rig.heading and not isinstance(rig.target, str):
        raise UsageError(f"{where}: heading needs an object whose heading it is")
    free = viewer.free
    x, y, z = map(float, free.lookat)
    target = spot((x, y, z) if rig.target is None else rig.target, viewer.model)
    usual = Ramp(free.azimuth, free.azimuth + 360, rig.turn) if rig.turn else Ramp.still(free.azimuth)
    distance, azimuth = rig.distance or Ramp.still(free.distance), rig.azimuth or usual
    elevation = rig.elevation or Ramp.still(free.elevation)
    check_ramp(distance, f"{where}: distance", low=0.0, expected="a positive number of metres")
    check_ramp(azimuth, f"{where}: azimuth")
    check_ramp(elevation, f"{where}: elevation")
    return BoundAroundRig(target, rig, distance, azimuth, elevation, viewer.frustum)


@dataclass(frozen=True)
class BoundLookRig:
    """From one place at another, upright."""

    eye: Spot
    target: Spot
    frustum: Frustum
    where: str

    def pose(self, data: mujoco.MjData, moment: Moment) -> Pose:
        return _looking(self.eye.position(data), self.target.position(data), self.frustum, self.where, moment)


def _looking(eye: np.ndarray, target: np.ndarray, frustum: Frustum, where: str, moment: Moment) -> Pose:
    distance = float(np.linalg.norm(target - eye))
    if distance < PLACE:
        raise UsageError(f"{where}: at {moment.time:.9g} s the camera is at the very point that it looks at")
    return Pose(eye, rotation(*heading(target - eye)), frustum, distance)


class BoundPathRig:
    """Along a path.

    The speed is constant as seen in the model's initial state: where the path leads around objects that move,
    it is so relative to them.
    """

    def __init__(self, rig: PathRig, viewer: Viewer, where: str) -> None:
        _check_path(rig, where)
        self._rig, self._where, self.frustum = rig, where, viewer.frustum
        self._around = rig.waypoints[0].eye is None
        self._lookats = _lookats(rig, viewer.model, self._around, where)
        points = np.array([_coordinates(point) for point in rig.waypoints], float)
        knots = _knots(rig) if rig.pace == "time" else self._centripetal(points, viewer.data)
        self._straight = rig.curve == "linear"
        self._curve = Curve(knots, points, self._straight, bounded=(0,) if self._around else ())
        self._odometer = None if rig.pace == "time" else Odometer(knots, lambda x: self._eyes(x, viewer.data))
        if not self._lookats and (points == points[0]).all():
            raise UsageError(f"{where}: what does the camera look at? the path leads nowhere, and has no lookat")

    def _centripetal(self, points: np.ndarray, data: mujoco.MjData) -> np.ndarray:
        lengths = orbital_lengths(points) if self._around else np.linalg.norm(np.diff(points, axis=0), axis=1)
        if self._around:
            targets = np.array([target.position(data) for target in self._lookats])
            lengths = np.hypot(lengths, np.linalg.norm(np.diff(targets, axis=0), axis=1))
        least = PLACE * np.abs(points[:, :1] if self._around else points).max()
        for i, length in enumerate(lengths, 1):
            if length <= least:
                raise UsageError(
                    f"{self._where}: waypoints {i} and {i + 1} are at the same place, where a camera of constant "
                    "speed cannot stay; say when it is where, with pace: time"
                )
        return centripetal(lengths)

    def _targets(self, x: np.ndarray, data: mujoco.MjData) -> np.ndarray:
        """What is looked at `(m, 3)` [m]."""
        points = np.array([target.position(data) for target in self._lookats])
        return Curve(self._curve.knots, points, self._straight).at(x)

    def _eyes(self, x: np.ndarray, data: mujoco.MjData) -> np.ndarray:
        """Where the camera is `(m, 3)` [m]."""
        points = self._curve.at(x)
        return self._targets(x, data) + orbital(points) if self._around else points

    def pose(self, data: mujoco.MjData, moment: Moment) -> Pose:
        x = self._odometer.after(EASINGS[self._rig.ease](moment.phase)) if self._odometer else moment.elapsed
        here = np.array([x])
        if self._around:
            distance, azimuth, elevation = self._curve.at(here)[0]
            return around(self._targets(here, data)[0], float(distance), azimuth, elevation, self.frustum)
        eye = self._curve.at(here)[0]
        if not self._lookats:
            return Pose(eye, rotation(*heading(self._curve.direction(x))), self.frustum)
        return _looking(eye, self._targets(here, data)[0], self.frustum, self._where, moment)


def _coordinates(point: Waypoint) -> Sequence[float]:
    if point.eye is not None:
        return point.eye
    assert point.distance is not None
    assert point.azimuth is not None
    assert point.elevation is not None
    return point.distance, point.azimuth, point.elevation


def _knots(rig: PathRig) -> np.ndarray:
    return np.array([point.at for point in rig.waypoints], float)


def _lookats(rig: PathRig, model: mujoco.MjModel, needed: bool, where: str) -> list[Spot]:
    """What is looked at from each waypoint; empty if the camera looks where the path leads."""
    places = [rig.lookat if point.lookat is None else point.lookat for point in rig.waypoints]
    if not needed and all(place is None for place in places):
        return []
    for i, found in enumerate(places, 1):
        if found is None:
            raise UsageError(f"{where}: waypoint {i}: what does it look at? give it a lookat, or the path")
    return [spot(found, model) for found in places if found is not None]


def _check_path(rig: PathRig, where: str) -> None:
    for kind, name, valid in (("curve", rig.curve, CURVES), ("pace", rig.pace, PACES), ("ease", rig.ease, EASINGS)):
        if name not in valid:
            raise UnknownNameError(kind, name, list(valid), where=where)
    if len(rig.waypoints) < 2:
        raise UsageError(f"{where}: a path needs two waypoints or more")
    if rig.pace == "time" and rig.ease != "linear":
        raise UsageError(f"{where}: ease is for a path of constant speed; this one has times")
    for i, point in enumerate(rig.waypoints, 1):
        _check_waypoint(point, f"{where}: waypoint {i}")
        if (point.at is None) == (rig.pace == "time"):
            raise UsageError(f"{where}: waypoint {i}: `at` goes with pace: time, all through a path")
    if len({point.eye is None for point in rig.waypoints}) > 1:
        raise UsageError(f"{where}: waypoints are either all given by eye, or all by distance, azimuth and elevation")
    times = [point.at for point in rig.waypoints if point.at is not None]
    for i, (before, after) in enumerate(pairwise(times), 2):
        if not before < after:
            raise BadValueError(f"{where}: waypoint {i}: at", f"{after:g}", f"later than {before:g} s")


def _check_waypoint(point: Waypoint, where: str) -> None:
    numbers = (point.distance, point.azimuth, point.elevation)
    given = [number for number in numbers if number is not None]
    if point.eye is not None and given:
        raise UsageError(f"{where}: give it an eye, or distance, azimuth and elevation, not both")
    if point.eye is None and len(given) < 3:
        raise UsageError(f"{where}: give it an eye, or distance, azimuth and elevation")
    if not np.isfinite([*(point.eye or given), point.at or 0.0]).all():
        raise BadValueError(where, ", ".join(f"{v:g}" for v in (point.eye or given)), "made of finite numbers")
    if point.distance is not None and point.distance <= 0:
        raise BadValueError(f"{where}: distance", f"{point.distance:g}", "a positive number of metres")
