"""The motion of a camera: a camera script bound to a model, and a pose for every frame."""

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby

import mujoco
import numpy as np

from mjrun.camera.pose import EMPTY_FRUSTUM, CameraPose, Frustum, fitted, rotation
from mjrun.camera.rigs.auto import BoundAutoRig, OutermostPoints
from mjrun.camera.rigs.rig import BoundRig, MujocoCameras, ShakeNoise, ShotTime, blend_weight, compute_positions
from mjrun.camera.script import CameraScript, Shot
from mjrun.camera.targets import BoundingBoxes, GhostMotion, object_bounds
from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, ModelError, UsageError, clean, concerning, option
from mjrun.model.state import restore

Span = tuple[float, float]

ROLL = 5.0  # [deg] between the turns of a rolling camera at which the motion is kept in view; a margin covers the rest


class BoundCameraScript:
    """A camera script with every name resolved in a model.

    Args:
      size: width and height of the images [pixels], for shots that fit objects.
      is_framed: whether the default camera frames the model closely.

    Raises:
      UnknownNameError: a name is unknown; the message lists the valid ones.
      BadValueError: a number is out of its range.
      UsageError: settings contradict each other.
    """

    def __init__(
        self, script: CameraScript, model: mujoco.MjModel, size: tuple[int, int], *, is_framed: bool = False
    ) -> None:
        self.script, self._model, self._size = script, model, size
        self._data = mujoco.MjData(model)
        cameras = MujocoCameras(model, is_framed=is_framed)
        self._shots = [self._bind(i, shot, cameras) for i, shot in enumerate(script.shots)]
        self._shakes = [ShakeNoise(shot.shake) if shot.shake else None for shot in script.shots]
        for i, shot in enumerate(script.shots):
            if shot.blend and len({shot.rig.frustum.orthographic for shot in self._shots[i - 1 : i + 1]}) > 1:
                raise UsageError(
                    f"{self._where(i)}: a camera with perspective and one without cannot be blended\n"
                    "cut from one to the other"
                )

    @property
    def perspective(self) -> bool:
        """True if all shots have perspective, which some calibration files require."""
        return not any(shot.rig.frustum.orthographic for shot in self._shots)

    def poses(
        self,
        states: Iterable[np.ndarray],
        times: Sequence[float],
        video_times: Sequence[float],
        spans: Sequence[Span],
    ) -> Iterator[CameraPose]:
        """Yields the pose of each frame, in order. The frames of a blend are read before its first pose is yielded.

        Args:
          states: integration states, read once.
          times: ascending simulated times of the frames [s].
          video_times: times of the frames in the video [s].
          spans: simulated start and end of each shot [s], one after the other.

        Raises:
          UsageError: the camera coincides with the point that it looks at, at some time.
        """
        assert len(spans) == len(self._shots)
        weights = (self._weights(time, spans) for time in times)
        frames = zip(states, times, video_times, weights, strict=True)
        for mixed, run in groupby(frames, lambda frame: len(_visible(frame[3])) > 1):
            views = (self._view(*frame, spans) for frame in run)
            if not mixed:
                yield from (self._shaken(next(iter(view.poses.values())), view) for view in views)
                continue
            views = list(views)
            for pose, view in zip(self._blended(views, spans), views, strict=True):
                yield self._shaken(pose, view)

    def aim_at_motion(
        self,
        states: Iterable[np.ndarray],
        times: Sequence[float],
        spans: Sequence[Span],
        ghosts: Sequence[GhostMotion] = (),
    ) -> list[str]:
        """Moves the cameras that show the whole motion, before `poses`; returns remarks about those that move.

        Args:
          states, times, spans: as in `poses`.
          ghosts: the ghosts that are drawn with the model.
        """
        collections = {
            i: outermost for i, shot in enumerate(self._shots) if (outermost := shot.outermost_points(self._size))
        }
        if not collections:
            return []
        for index, (state, time) in enumerate(zip(states, times, strict=True)):
            seen = [collections[i] for i in collections.keys() & set(_visible(self._weights(time, spans)))]
            restore(self._model, self._data, state)
            compute_positions(self._model, self._data)
            for outermost in seen:
                outermost.add(self._data)
            for ghost in ghosts:
                posed = state if ghost.states is None else ghost.states[min(index, len(ghost.states) - 1)]
                restore(self._model, self._data, posed)
                compute_positions(self._model, self._data)
                for outermost in seen:
                    outermost.add_ghost(self._data, ghost.offset)
        remarks = [self._shots[i].aim_at_motion(outermost) for i, outermost in collections.items()]
        return [f"{text}; {option('camera')} free stays where MuJoCo puts it" for text in remarks if text]

    def pose(self, state: np.ndarray) -> CameraPose:
        """Returns the pose for one state, at the beginning of the first shot."""
        later = [(np.inf, np.inf)] * (len(self._shots) - 1)
        return next(self.poses([state], [0.0], [0.0], [(0.0, 0.0), *later]))

    def _weights(self, time: float, spans: Sequence[Span]) -> list[float]:
        """Returns the weight of each shot over all those before it."""
        later = zip(self.script.shots[1:], spans[1:], strict=True)
        return [1.0, *(blend_weight(shot.blend, time - start) for shot, (start, _) in later)]

    def _view(
        self, state: np.ndarray, time: float, video_time: float, weights: list[float], spans: Sequence[Span]
    ) -> "_FrameView":
        restore(self._model, self._data, state)
        compute_positions(self._model, self._data)
        poses = {i: self._shots[i].pose(self._data, _shot_time(time, spans[i]), self._size) for i in _visible(weights)}
        return _FrameView(time, video_time, weights, poses)

    def _blended(self, views: Sequence["_FrameView"], spans: Sequence[Span]) -> list[CameraPose]:
        """Blends the poses of frames that several shots contribute to: each shot into those before it."""
        poses = [view.poses.get(0) for view in views]
        for i in range(1, len(spans)):
            poses = [p if v.weights[i] < 1 else v.poses.get(i) for p, v in zip(poses, views, strict=True)]
            both = [k for k, view in enumerate(views) if i in view.poses and view.weights[i] < 1]
            if both:
                before, after = [p for k in both if (p := poses[k])], [views[k].poses[i] for k in both]
                weights = np.array([views[k].weights[i] for k in both])
                join = int(np.argmin([abs(views[k].time - spans[i][0]) for k in both]))
                for k, pose in zip(both, _crossfade(before, after, weights, join, self._size), strict=True):
                    poses[k] = pose
        return [pose for pose in poses if pose]

    def _shaken(self, pose: CameraPose, view: "_FrameView") -> CameraPose:
        if not any(self._shakes):
            return pose
        angles = np.zeros(2)
        for noise, share in zip(self._shakes, view.weights, strict=True):
            angles += share * ((noise.at(view.video_time) if noise else 0.0) - angles)
        return pose.panned(*angles) if angles.any() else pose

    def _bind(self, i: int, shot: Shot, cameras: MujocoCameras) -> "_BoundShot":
        try:
            with concerning("shots", i):
                return _bound_shot(shot, cameras, self._where(i))
        except UsageError as error:
            if self._where(i) not in str(error):
                error.add_note(f"in {self._where(i)}")
            raise

    def _where(self, i: int) -> str:
        """Returns the name of a shot in errors."""
        return f"camera {clean(self.script.name)}" + (f": shot {i + 1}" if len(self.script.shots) > 1 else "")


@dataclass(frozen=True)
class _BoundShot:
    """A shot with its names resolved in a model."""

    shot: Shot
    rig: BoundRig
    bounds: BoundingBoxes | None

    def outermost_points(self, size: tuple[int, int]) -> OutermostPoints | None:
        """Returns an empty collection of points for a camera that shows all of it; None for other cameras."""
        if not isinstance(self.rig, BoundAutoRig):
            return None
        fovy, frustum, roll = self.shot.fovy, self.rig.frustum, self.shot.roll
        narrowest = frustum.opened(min(fovy.start, fovy.end)) if fovy else frustum
        turn = float(np.clip(roll.end - roll.start, -360, 360))  # the same images return after a whole one
        rolls = roll.start + np.linspace(0, turn, 1 + math.ceil(abs(turn) / ROLL))
        return self.rig.outermost_points(narrowest, size, rolls.tolist())

    def aim_at_motion(self, outermost: OutermostPoints) -> str:
        """Moves the camera so that the surveyed motion is in view; returns a remark if it was not."""
        return self.rig.aim_at_motion(outermost) if isinstance(self.rig, BoundAutoRig) else ""

    def pose(self, data: mujoco.MjData, at: ShotTime, size: tuple[int, int]) -> CameraPose:
        pose = self.rig.pose(data, at)
        if self.shot.fovy:
            pose = pose.opened(self.shot.fovy.at(at.phase))
        if roll := self.shot.roll.at(at.phase):
            pose = pose.rolled(roll)
        if self.shot.fit and self.bounds:
            pose = fitted(pose, self.bounds.points(data), size, self.shot.fit.margin)
        return pose


@dataclass(frozen=True)
class _FrameView:
    """A frame as seen by its shots: the poses of those that contribute to it, by index."""

    time: float
    video_time: float
    weights: list[float]
    poses: dict[int, CameraPose]


def _bound_shot(shot: Shot, cameras: MujocoCameras, where: str) -> _BoundShot:
    with concerning(shot.rig.kind):
        rig = shot.rig.bind(cameras, where)
    if shot.fovy and not rig.frustum.orthographic:
        for angle in (shot.fovy.start, shot.fovy.end):
            if angle >= 180:
                raise BadValueError(f"{where}: fovy", f"{angle:g}", "an angle between 0 and 180 degrees")
    elif not shot.fovy and rig.frustum.is_empty:
        raise ModelError(f"{where} has an empty view: {EMPTY_FRUSTUM}")
    with concerning("fit", "target"):
        return _BoundShot(shot, rig, object_bounds(shot.fit.target, cameras.model) if shot.fit else None)


def _shot_time(time: float, span: Span) -> ShotTime:
    start, end = span
    elapsed = min(max(time - start, 0.0), end - start)
    return ShotTime(time, elapsed, elapsed / (end - start) if end > start else float(time > start))


def _visible(weights: Sequence[float]) -> list[int]:
    """Returns the shots that contribute to a frame: from the last one that covers all before it."""
    first = max(i for i, share in enumerate(weights) if share == 1)
    return [first, *(i for i in range(first + 1, len(weights)) if weights[i] > 0)]


def _crossfade(
    before: Sequence[CameraPose], after: Sequence[CameraPose], weights: np.ndarray, join: int, size: tuple[int, int]
) -> list[CameraPose]:
    """Blends poses into others by `weights`, linear in target, distance, angles and tangents of the frustum.

    Angles take the short way at the frame `join`. From there they continue without jumps, so that a camera that is
    still turning while it is blended out does not reverse.
    """
    starts, ends = (_continued(np.array([p.angles for p in poses]), join) for poses in (before, after))
    ends -= 360 * np.rint((ends[join] - starts[join]) / 360)
    angles = starts + weights[:, None] * (ends - starts)
    poses = list[CameraPose]()
    for a, b, share, (azimuth, elevation, roll) in zip(before, after, weights, angles, strict=True):
        turn = rotation(azimuth, elevation, roll)
        distance = a.distance + share * (b.distance - a.distance)
        lookat = a.lookat + share * (b.lookat - a.lookat)
        frustum = _between(a.frustum, b.frustum, share, size)
        poses.append(CameraPose(lookat + distance * turn[:, 2], turn, frustum, distance))
    return poses


def _continued(angles: np.ndarray, middle: int) -> np.ndarray:
    """Returns azimuths, elevations and rolls `(n, 3)` [deg] unwrapped from `middle` both ways."""
    continued = angles.copy()
    for k in range(middle + 1, len(continued)):
        continued[k] = _nearest(continued[k], continued[k - 1])
    for k in range(middle - 1, -1, -1):
        continued[k] = _nearest(continued[k], continued[k + 1])
    return continued


def _nearest(angles: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Returns the angles of the same direction nearest to `other`: whole turns away, or over the pole."""
    over = np.array([angles[0] + 180, 180 - angles[1], angles[2] + 180])
    plain, over = (other + (a - other + 180) % 360 - 180 for a in (angles, over))
    return over if 2 * np.abs(over - other).sum() < np.abs(plain - other).sum() else plain


def _between(a: Frustum, b: Frustum, share: float, size: tuple[int, int]) -> Frustum:
    """Interpolates distances of the clipping planes and tangents of the view linearly; lengths [m] if orthographic."""
    if a is b or a == b:
        return a
    if a.orthographic != b.orthographic:  # two shots other than the blended one
        return b if share > 0.5 else a

    def mixed(first: float, second: float) -> float:
        return float(first + share * (second - first))

    near = mixed(a.near, b.near)
    per_a, per_b, of = (1.0, 1.0, 1.0) if a.orthographic else (a.near, b.near, near)
    wide = bool(a.width or b.width)
    return Frustum(
        center=of * mixed(a.center / per_a, b.center / per_b),
        width=of * mixed(a.halfwidth(size) / per_a, b.halfwidth(size) / per_b) if wide else 0.0,
        bottom=of * mixed(a.bottom / per_a, b.bottom / per_b),
        top=of * mixed(a.top / per_a, b.top / per_b),
        near=near,
        far=mixed(a.far, b.far),
        orthographic=a.orthographic,
    )
