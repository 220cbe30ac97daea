"""Geoms added to a scene: trails of objects, and ghosts of the whole model."""

from collections.abc import Iterable, Sequence

import mujoco
import numpy as np

from mjrun.camera.targets import ObjectTrajectory, object_paths
from mjrun.model.names import enum_members
from mjrun.model.state import restore
from mjrun.rendering.visual import Visual

DECOR = mujoco.mjtCatBit.mjCAT_DECOR.value
DYNAMIC = mujoco.mjtCatBit.mjCAT_DYNAMIC.value
CAPSULE = mujoco.mjtGeom.mjGEOM_CAPSULE.value
UNKNOWN = mujoco.mjtObj.mjOBJ_UNKNOWN.value

# Slow to fast, at equal steps: azure, teal, yellow, orange, red.
RAMP = np.array([(0.22, 0.42, 0.94), (0.12, 0.74, 0.78), (0.98, 0.84, 0.30), (0.98, 0.52, 0.16), (0.90, 0.14, 0.16)])
WIDTH = 0.003  # radius of a trail where it is slowest, as a share of the model's extent
NARROW = 0.008  # the same as a share of the path's extent, used if that is less
WIDENING = 4  # radius at the fastest part of a trail, as a multiple of that at the slowest
FINE = 12  # candidates for the end of a capsule per interval of the path
SAG = 1 / 6  # how far a capsule may stray from the path, as a share of the trail's width
SHADE = 1 / 32  # how much of the colour ramp one capsule may span
LIMIT = 600  # capsules; each takes a third of a millisecond or more to draw in software
TINT = np.array((0.80, 0.90, 1.0))  # mixed half and half with the colours of the model in a ghost
CATENARY = 100  # maximum number of geoms of a slack tendon
CRANK = 4  # maximum number of geoms of an actuator
SHAPE = ("type", "dataid", "texcoord", "size", "pos", "mat", "emission", "specular", "shininess", "modelrbound")
SHARED = (mujoco.mjtGeom.mjGEOM_FLEX.value, mujoco.mjtGeom.mjGEOM_SKIN.value)  # types with one geom per scene


class Decoration:
    """An addition to colour images: geoms in the scene, or a drawing over frames.

    It can be pickled, also after it has added some geoms.
    """

    @property
    def geoms(self) -> int:
        """The maximum number of geoms that `add` adds."""
        return 0

    def add(self, scene: mujoco.MjvScene, index: int) -> None:
        """Adds the geoms of frame `index` of the video to `scene`, after mjv_updateScene.

        Each is detached from the model with `detach`. Geoms that do not fit in the scene are omitted.
        """

    def draw(self, frame: np.ndarray, index: int) -> None:
        """Draws over the panels of frame `index`, `(h, w, 3)` uint8."""


class Trail(Decoration):
    """The path of an object up to the current instant, wider and warmer in colour where the object was faster.

    It is rendered as capsules, more of them where the path bends and where the speed changes. They end at the same
    points in every frame, so that the trail does not shimmer as it grows.

    Args:
      path: trajectory of the object, sampled at each frame of the video or, for fast turns, more often.
      width: radius of the slowest parts [m]; the fastest are `WIDENING` times as wide.
      instants: times of the frames [s]; those of the path when None.
      fastest: the speed with the maximum width [m/s]; the path's highest when None.
      span: the length of the past that is shown [s], tapering off; all of it when None.
      limit: the maximum number of capsules; a path that needs more is rendered more coarsely.
    """

    def __init__(
        self,
        path: ObjectTrajectory,
        width: float,
        instants: np.ndarray | None = None,
        fastest: float | None = None,
        span: float | None = None,
        limit: int = LIMIT,
    ) -> None:
        self.path, self.width, self.span, self.limit = path, width, span, limit
        highest = float(np.linalg.norm(path.velocities, axis=1).max()) if fastest is None else fastest
        self._fastest = max(highest, np.finfo(float).tiny)
        self._instants = path.times if instants is None else instants
        self._joints = self._capsule_ends()

    @property
    def geoms(self) -> int:
        return self.limit

    def add(self, scene: mujoco.MjvScene, index: int) -> None:
        now = self._instants[index]
        start = self._start(now)
        first, last = np.searchsorted(self._joints, [start, now], side="right")
        times = np.concatenate([[start], self._joints[first:last], [now]])
        points = self.path.at(times)

        middle = (times[1:] + times[:-1]) / 2
        pace = self._pace(middle)
        radii = self._radii(pace)
        if self.span is not None:
            radii *= np.sqrt(((middle - now) / self.span + 1).clip(0, 1))
        rgba = np.column_stack([ramp(pace), np.ones(len(pace))]).astype(np.float32)

        visible = np.flatnonzero(np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-3 * self.width)
        geoms, room = scene.geoms, scene.maxgeom - scene.ngeom
        for k in visible[max(0, len(visible) - room) :]:
            geom = geoms[scene.ngeom]
            mujoco.mjv_initGeom(geom, CAPSULE, np.zeros(3), np.zeros(3), np.zeros(9), rgba[k])
            mujoco.mjv_connector(geom, CAPSULE, radii[k], points[k], points[k + 1])
            detach(geom)
            geom.emission, geom.specular = 0.1, 0.1
            scene.ngeom += 1

    def _start(self, now: float) -> float:
        return self.path.times[0] if self.span is None else max(self.path.times[0], now - self.span)

    def _pace(self, times: np.ndarray) -> np.ndarray:
        """Returns the speeds at `times` relative to the fastest, 0 to 1."""
        return (self.path.speeds(times) / self._fastest).clip(0, 1)

    def _radii(self, pace: np.ndarray) -> np.ndarray:
        return self.width * (1 + (WIDENING - 1) * pace)

    def _capsule_ends(self) -> np.ndarray:
        """Returns the times at which one capsule ends and the next begins.

        An arc of length L and curvature κ strays κL²/8 from its chord, so a path needs √(κ/8s) capsules per
        metre to stay within s of them; and one more for every `SHADE` of change in colour and width.
        """
        frames = len(self.path.times)
        times = np.interp(np.arange((frames - 1) * FINE + 1) / FINE, np.arange(frames), self.path.times)

        steps = np.diff(self.path.at(times), axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        crossed = np.linalg.norm(np.cross(steps[1:], steps[:-1]), axis=1)
        turns = np.arctan2(crossed, (steps[1:] * steps[:-1]).sum(axis=1))
        pace = self._pace(times)

        needed = np.abs(np.diff(pace)) / SHADE
        needed[1:] += np.sqrt(turns * (lengths[1:] + lengths[:-1]) / 2 / (8 * SAG * self._radii(pace)[1:-1]))
        if self.span is not None:
            needed += np.diff(times) / (self.span * SHADE)

        count = np.concatenate([[0], needed.cumsum()])
        earliest = np.searchsorted(times, [self._start(now) for now in times])
        spacing = max(1.0, (count - count[earliest]).max() / (self.limit - 3))
        return times[np.unique(np.searchsorted(count, np.arange(spacing, count[-1], spacing)))]


class Ghost(Decoration):
    """A second copy of the model: translucent, in pale colours without textures, displaced.

    Skins and flexes are left out, since a scene has room for only one of each.

    Args:
      states: integration states of the ghost by frame, the last of which remains; when None, it moves with the
        model.
      offset: displacement from the model [m].
      opacity: 1 is opaque.
      visual: the groups that are shown.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        states: Sequence[np.ndarray] | None = None,
        offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
        opacity: float = 0.35,
        visual: Visual | None = None,
    ) -> None:
        self.model, self.states, self.opacity = model, states, opacity
        self.visual = visual or Visual()
        self.offset = np.array(offset)
        self._data: mujoco.MjData | None = None
        self._options: mujoco.MjvOption | None = None

    def __getstate__(self) -> dict[str, object]:
        """Omits MuJoCo's structures, one of which cannot be pickled; `add` creates them again."""
        return {**vars(self), "_data": None, "_options": None}

    @property
    def geoms(self) -> int:
        model = self.model
        return model.ngeom + model.nsite + 2 * model.nwrap + CATENARY * model.ntendon + CRANK * model.nu

    def add(self, scene: mujoco.MjvScene, index: int) -> None:
        first = scene.ngeom
        if self.states is None:
            self._copy(scene)
        else:
            self._pose(scene, self.states[min(index, len(self.states) - 1)])
        for geom in scene.geoms[first : scene.ngeom]:
            geom.pos = geom.pos + self.offset
            geom.rgba = [*((geom.rgba[:3] + TINT) / 2), geom.rgba[3] * self.opacity]
            geom.matid = geom.texid = -1
            geom.reflectance = 0
            detach(geom)

    def _copy(self, scene: mujoco.MjvScene) -> None:
        """Adds copies of the scene's geoms that can move."""
        geoms = scene.geoms
        for original in geoms[: scene.ngeom]:
            if original.category != DYNAMIC or original.type in SHARED:
                continue
            if scene.ngeom == scene.maxgeom:
                return
            geom = geoms[scene.ngeom]
            mujoco.mjv_initGeom(geom, original.type, np.zeros(3), np.zeros(3), np.zeros(9), original.rgba)
            for name in SHAPE:
                setattr(geom, name, getattr(original, name))
            scene.ngeom += 1

    def _pose(self, scene: mujoco.MjvScene, state: np.ndarray) -> None:
        """Adds the geoms that can move, posed in another state."""
        self._data = data = self._data or mujoco.MjData(self.model)
        self._options = options = self._options or _ghost_options(self.visual)

        restore(self.model, data, state)
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        mujoco.mj_tendon(self.model, data)

        mujoco.mjv_addGeoms(self.model, data, options, mujoco.MjvPerturb(), DYNAMIC, scene)


def _ghost_options(visual: Visual) -> mujoco.MjvOption:
    """Returns the options of a ghost: the groups and flags of `visual`, without frames, labels, flexes and skins."""
    options = visual.options()
    options.frame, options.label = mujoco.mjtFrame.mjFRAME_NONE, mujoco.mjtLabel.mjLABEL_NONE
    for flag, value in enum_members(mujoco.mjtVisFlag).items():
        if flag.startswith(("flex", "skin")):
            options.flags[value] = 0
    return options


def trails(
    model: mujoco.MjModel,
    objects: Sequence[tuple[str, int]],
    states: Iterable[np.ndarray],
    instants: np.ndarray | None = None,
    span: float | None = None,
    limit: int = LIMIT,
) -> list[Trail]:
    """Returns trails of `objects`, pairs of kind and id, through integration `states`, at least one per frame.

    They share one scale, so that equal colours and widths mean equal speeds. Their width follows the model's extent,
    or the extent of the longest path if that is much smaller.

    Args:
      instants, span, limit: as in `Trail`.
    """
    paths = object_paths(model, objects, states)
    fastest = max(float(np.linalg.norm(path.velocities, axis=1).max()) for path in paths)
    room = max(float(np.linalg.norm(np.ptp(path.positions, axis=0))) for path in paths)
    widest = WIDTH * model.stat.extent
    width = min(widest, max(NARROW * room, widest / 4))
    return [Trail(path, width, instants, fastest, span, limit) for path in paths]


def ramp(pace: np.ndarray) -> np.ndarray:
    """Returns colours `(n, 3)`, 0 to 1, of speeds `(n,)` relative to the fastest, 0 to 1."""
    return np.column_stack([np.interp(pace, np.linspace(0, 1, len(RAMP)), channel) for channel in RAMP.T])


def detach(geom: mujoco.MjvGeom) -> None:
    """Detaches a geom from the model, so that it has no segment, label or shadow."""
    geom.category, geom.objtype, geom.objid, geom.segid = DECOR, UNKNOWN, -1, -1
    geom.label, geom.castshadow = "", 0
