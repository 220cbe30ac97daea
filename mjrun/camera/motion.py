"""The course of a camera: a script found in a model, and a pose for every frame."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import mujoco
import numpy as np

from mjrun.camera.easing import BLENDS, Tremor, ramped, weight
from mjrun.camera.pose import Frustum, Pose, fitted, rotation
from mjrun.camera.rigs import BoundRig, Moment, Viewer, aim, check_ramp, place
from mjrun.camera.script import Script, Shot
from mjrun.camera.targets import Bounds, bounds
from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean
from mjrun.model.state import restore

Span = tuple[float, float]


class CameraMotion:
    """A script with every name found in a model.

    Args:
      size: width and height of the pictures [pixels], for what is to fit into them.

    Raises:
      UnknownNameError: a name is not there; the message lists those that are.
      BadValueError: a number is out of its range.
      UsageError: settings do not go together.
    """

    def __init__(self, script: Script, model: mujoco.MjModel, size: tuple[int, int]) -> None:
        if not script.shots:
            raise UsageError(f"camera {clean(script.name)}: there are no shots")
        self.script, self._model, self._size = script, model, size
        self._data = mujoco.MjData(model)
        viewer = Viewer(model)
        self._takes = [self._found(i, shot, viewer) for i, shot in enumerate(script.shots)]
        self._tremors = [Tremor(shot.shake) if shot.shake else None for shot in script.shots]
        for i, shot in enumerate(script.shots):
            self._check_blend(i, shot)

    @property
    def perspective(self) -> bool:
        """Whether all of it is in perspective, which some calibration files need."""
        return not any(take.aim.frustum.orthographic for take in self._takes)

    def poses(
        self,
        states: Iterable[np.ndarray],
        times: Sequence[float],
        films: Sequence[float],
        spans: Sequence[Span],
    ) -> Iterator[Pose]:
        """The pose of each frame, in order. While a blend lasts its frames are read before the first is given.

        Args:
          states: integration states, read once.
          times: of the frames, ascending [s], simulated.
          films: of the frames [s], of film.
          spans: start and end of each shot [s], simulated, one after the other.

        Raises:
          UsageError: at some time a camera is where it is to look.
        """
        assert len(spans) == len(self._takes)
        weights = (self._weights(time, spans) for time in times)
        frames = zip(states, times, films, weights, strict=True)
        for mixed, run in groupby(frames, lambda frame: len(_seen(frame[3])) > 1):
            views = (self._view(*frame, spans) for frame in run)
            if not mixed:
                yield from (self._shaken(next(iter(view.poses.values())), view) for view in views)
                continue
            views = list(views)
            for pose, view in zip(self._blended(views, spans), views, strict=True):
                yield self._shaken(pose, view)

    def pose(self, state: np.ndarray) -> Pose:
        """The pose for one state, at the beginning of the first shot."""
        later = [(np.inf, np.inf)] * (len(self._takes) - 1)
        return next(self.poses([state], [0.0], [0.0], [(0.0, 0.0), *later]))

    def _weights(self, time: float, spans: Sequence[Span]) -> list[float]:
        """How far each shot has taken over from all before it."""
        later = zip(self.script.shots[1:], spans[1:], strict=True)
        return [1.0, *(weight(shot.blend, time - start) for shot, (start, _) in later)]

    def _view(
        self, state: np.ndarray, time: float, film: float, weights: list[float], spans: Sequence[Span]
    ) -> "_View":
        restore(self._model, self._data, state)
        place(self._model, self._data)
        poses = {i: self._takes[i].pose(self._data, _moment(time, spans[i]), self._size) for i in _seen(weights)}
        return _View(time, film, weights, poses)

    def _blended(self, views: Sequence["_View"], spans: Sequence[Span]) -> list[Pose]:
        """The poses of frames that several shots have a share in: each shot blended into those before it."""
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

    def _shaken(self, pose: Pose, view: "_View") -> Pose:
        if not any(self._tremors):
            return pose
        angles = np.zeros(2)
        for tremor, share in zip(self._tremors, view.weights, strict=True):
            angles += share * ((tremor.at(view.film) if tremor else 0.0) - angles)
        return pose.panned(*angles) if angles.any() else pose

    def _found(self, i: int, shot: Shot, viewer: Viewer) -> "_Take":
        try:
            return _take(shot, viewer, self._where(i))
        except UsageError as error:
            if self._where(i) not in str(error):
                error.add_note(f"in {self._where(i)}")
            raise

    def _where(self, i: int) -> str:
        """What is to be named in errors."""
        return f"camera {clean(self.script.name)}" + (f": shot {i + 1}" if len(self.script.shots) > 1 else "")

    def _check_blend(self, i: int, shot: Shot) -> None:
        if shot.blend is None:
            return
        if i == 0:
            raise UsageError(f"{self._where(i)}: there is nothing before it that it could be blended with")
        if shot.blend.shape not in BLENDS:
            raise UnknownNameError("blend", shot.blend.shape, list(BLENDS), where=self._where(i))
        if not 0 < shot.blend.width < np.inf:
            raise BadValueError(f"{self._where(i)}: width", f"{shot.blend.width:g}", "a positive number of seconds")
        if len({take.aim.frustum.orthographic for take in self._takes[i - 1 : i + 1]}) > 1:
            raise UsageError(
                f"{self._where(i)}: a camera with perspective and one without cannot be blended\n"
                "cut from one to the other"
            )


@dataclass(frozen=True)
class _Take:
    """A shot with its names found."""

    shot: Shot
    aim: BoundRig
    bounds: Bounds | None

    def pose(self, data: mujoco.MjData, moment: Moment, size: tuple[int, int]) -> Pose:
        pose = self.aim.pose(data, moment)
        if self.shot.fovy:
            pose = pose.opened(ramped(self.shot.fovy, moment.phase))
        if roll := ramped(self.shot.roll, moment.phase):
            pose = pose.rolled(roll)
        if self.shot.fit and self.bounds:
            pose = fitted(pose, self.bounds.points(data), size, self.shot.fit.margin)
        return pose


@dataclass(frozen=True)
class _View:
    """A frame as its shots see it: the poses of those that have a share in it."""

    time: float
    film: float
    weights: list[float]
    poses: dict[int, Pose]


def _take(shot: Shot, viewer: Viewer, where: str) -> _Take:
    found = aim(shot.rig, viewer, where)
    check_ramp(shot.roll, f"{where}: roll")
    if shot.fovy and found.frustum.orthographic:
        check_ramp(shot.fovy, f"{where}: fovy", 0.0, expected="a positive number of metres")
    elif shot.fovy:
        check_ramp(shot.fovy, f"{where}: fovy", 0.0, 180.0, "an angle between 0 and 180 degrees")
    if shot.shake and not 0 <= shot.shake.angle < np.inf:
        raise BadValueError(f"{where}: shake: angle", f"{shot.shake.angle:g}", "0 or more degrees")
    if shot.shake and not 0 < shot.shake.frequency < np.inf:
        raise BadValueError(f"{where}: shake: frequency", f"{shot.shake.frequency:g}", "a positive number of hertz")
    if shot.shake and shot.shake.seed < 0:
        raise BadValueError(f"{where}: shake: seed", shot.shake.seed, "0 or more")
    if shot.fit and not 1 <= shot.fit.margin < np.inf:
        raise BadValueError(f"{where}: fit: margin", f"{shot.fit.margin:g}", "1 or more")
    return _Take(shot, found, bounds(shot.fit.target, viewer.model) if shot.fit else None)


def _moment(time: float, span: Span) -> Moment:
    start, end = span
    elapsed = min(max(time - start, 0.0), end - start)
    return Moment(time, elapsed, elapsed / (end - start) if end > start else float(time > start))


def _seen(weights: Sequence[float]) -> list[int]:
    """The shots that have a share in a frame: those from the last that hides all before it."""
    first = max(i for i, share in enumerate(weights) if share == 1)
    return [first, *(i for i in range(first + 1, len(weights)) if weights[i] > 0)]


def _crossfade(
    before: Sequence[Pose], after: Sequence[Pose], weights: np.ndarray, join: int, size: tuple[int, int]
) -> list[Pose]:
    """From poses to others by `weights`, linear in what is looked at, distance, angles and tangents of the frustum.

    Angles go the short way at the frame `join`. From there they are followed without jumps, so that a camera
    that goes on turning while it is blended out does not change its mind.
    """
    starts, ends = (_continued(np.array([p.angles for p in poses]), join) for poses in (before, after))
    ends -= 360 * np.round((ends[join] - starts[join]) / 360)
    angles = starts + weights[:, None] * (ends - starts)
    found = []
    for a, b, share, (azimuth, elevation, roll) in zip(before, after, weights, angles, strict=True):
        turn = rotation(azimuth, elevation, roll)
        distance = a.distance + share * (b.distance - a.distance)
        lookat = a.lookat + share * (b.lookat - a.lookat)
        frustum = _between(a.frustum, b.frustum, share, size)
        found.append(Pose(lookat + distance * turn[:, 2], turn, frustum, distance))
    return found


def _continued(angles: np.ndarray, middle: int) -> np.ndarray:
    """Azimuths, elevations and rolls `(n, 3)` [deg] without jumps, followed from `middle` both ways."""
    found = angles.copy()
    for k in range(middle + 1, len(found)):
        found[k] = _nearest(found[k], found[k - 1])
    for k in range(middle - 1, -1, -1):
        found[k] = _nearest(found[k], found[k + 1])
    return found


def _nearest(angles: np.ndarray, other: np.ndarray) -> np.ndarray:
    """The angles of the same direction nearest to `other`: whole turns away, or over the pole."""
    over = np.array([angles[0] + 180, 180 - angles[1], angles[2] + 180])
    plain, over = (other + (a - other + 180) % 360 - 180 for a in (angles, over))
    return over if 2 * np.abs(over - other).sum() < np.abs(plain - other).sum() else plain


def _between(a: Frustum, b: Frustum, share: float, size: tuple[int, int]) -> Frustum:
    """Linear in distances of the clipping planes, and in tangents of what is seen; in metres if orthographic."""
    if a is b or a == b:
        return a
    if a.orthographic != b.orthographic:  # of two shots beyond the one that is blended
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
