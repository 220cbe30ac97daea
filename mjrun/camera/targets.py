"""Objects that a camera looks at or follows: their names, their bounds, and their paths over a recording."""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean
from mjrun.model.names import PLACES, PLURALS, identify, names
from mjrun.model.state import restore

Vector = tuple[float, float, float]
ObjectOrPoint = str | Vector  # an object, `box`, `geom:edge`, `site:tip`, `subtree:torso`, or a point [m]


class GhostMotion(NamedTuple):
    """The motion of a ghost, which cameras keep in view.

    Attributes:
      states: its states, the last of which remains; None if it moves with the model.
      offset: its displacement [m].
    """

    states: Sequence[np.ndarray] | None
    offset: np.ndarray


FRAMES = {
    "body": mujoco.mjtObj.mjOBJ_XBODY,  # mjOBJ_BODY would be its centre of mass
    "geom": mujoco.mjtObj.mjOBJ_GEOM,
    "site": mujoco.mjtObj.mjOBJ_SITE,
}
# Valid places to look at; a subtree's centre of mass has no velocity, and thus no trail.
POSITIONS = {**PLACES, "subtree": "subtree_com"}
ROTATIONS = {"body": "xmat", "geom": "geom_xmat", "site": "site_xmat", "subtree": "xmat"}

PLANE = mujoco.mjtGeom.mjGEOM_PLANE
VISIBLE_GROUPS = np.array(mujoco.MjvOption().geomgroup, bool)
VISIBLE_SKIN_GROUPS = np.array(mujoco.MjvOption().skingroup, bool)
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)


def identify_object(text: str, model: mujoco.MjModel) -> tuple[str, int]:
    """Returns kind and id of the body, else geom, else site called `text`; `geom:NAME` and `site:NAME` select a kind.

    Raises:
      UnknownNameError: no object has that name; the message lists the valid ones.
    """
    kind, colon, name = text.partition(":")
    if colon and kind in PLACES:
        return kind, identify(model, kind, name)
    for kind in PLACES:
        if text in names(model, kind):
            return kind, identify(model, kind, text)
    valid = {kind: [n for n in names(model, kind) if not n.startswith(f"{kind}:")] for kind in PLACES}
    everything = list(dict.fromkeys(name for known in valid.values() for name in known))
    raise UnknownNameError("object", text, everything, plural=f"{PLURALS['body']}, geoms and sites")


@dataclass(frozen=True)
class BoundObjectOrPoint:
    """An object, resolved in a model, or a point, whose kind is empty: where a camera is, or where it looks.

    Attributes:
      kind, id: the kind and the id of the object; a `subtree` has the id of its body.
      point: [m], in the world.
    """

    kind: str = ""
    id: int = -1
    point: Vector = (0.0, 0.0, 0.0)

    def position(self, data: mujoco.MjData) -> np.ndarray:
        """Returns its current position `(3,)` [m]."""
        return np.array(getattr(data, POSITIONS[self.kind])[self.id] if self.kind else self.point)

    def yaw(self, data: mujoco.MjData) -> float:
        """Returns the direction of its x axis [deg], seen from above; of a subtree, its body's; of a point, 0."""
        if not self.kind:
            return 0.0
        matrix = getattr(data, ROTATIONS[self.kind])[self.id]
        return math.degrees(math.atan2(matrix[3], matrix[0]))


def find_target(place: ObjectOrPoint, model: mujoco.MjModel) -> BoundObjectOrPoint:
    """Resolves a point, an object as in `identify_object`, or `subtree:BODY`, which is its centre of mass.

    Raises:
      UnknownNameError: the object is unknown.
      BadValueError: the point is not finite.
    """
    if not isinstance(place, str):
        x, y, z = map(float, place)
        if not all(map(math.isfinite, (x, y, z))):
            raise BadValueError("place", f"{x:g}, {y:g}, {z:g}", "a point with finite coordinates")
        return BoundObjectOrPoint(point=(x, y, z))
    kind, colon, name = place.partition(":")
    if colon and kind == "subtree":
        return BoundObjectOrPoint("subtree", identify(model, "body", name))
    return BoundObjectOrPoint(*identify_object(place, model))


@dataclass(frozen=True)
class BoundingBoxes:
    """The boxes around the geoms of an object, around one site, or around what the bones of skins move.

    Attributes:
      kind: `geom`, `site`, or `body` for bones.
      ids: `(n,)`.
      corners: `(n, 8, 3)` [m], in the frame of each.
    """

    kind: str
    ids: np.ndarray
    corners: np.ndarray

    def points(self, data: mujoco.MjData) -> np.ndarray:
        """Returns the current corners of all boxes `(8 n, 3)` [m], in the world."""
        turns = getattr(data, ROTATIONS[self.kind])[self.ids].reshape(-1, 3, 3)
        places = getattr(data, POSITIONS[self.kind])[self.ids]
        return (self.corners @ turns.transpose(0, 2, 1) + places[:, None]).reshape(-1, 3)


def object_bounds(text: str, model: mujoco.MjModel) -> BoundingBoxes:
    """Returns the bounds of the object called `text`: of a body with everything attached, without infinite planes.

    Raises:
      UnknownNameError: the object is unknown.
      UsageError: the object has no bounds.
    """
    target = find_target(text, model)
    if target.kind == "site":
        half = _site_halves(model, target.id)
        return BoundingBoxes("site", np.array([target.id]), (CORNERS * half)[None])
    ids = np.flatnonzero(_inside(model, target.id)[model.geom_bodyid])
    if target.kind == "geom":
        ids = np.array([target.id])
    bounds = _geom_bounds(model, ids)
    if bounds is None:
        raise UsageError(f"{clean(text)} cannot be fitted into an image: it has no geoms of finite size")
    return bounds


@dataclass(frozen=True)
class MovingParts:
    """Everything that joints or mocap can move, or everything, as far as images show it by default.

    Attributes:
      bounds: the boxes around its geoms, and around what the bones of its skins move.
      shares: the share of each body in its mass `(nbody,)`.
    """

    model: mujoco.MjModel
    bounds: Sequence[BoundingBoxes]
    shares: np.ndarray

    def points(self, data: mujoco.MjData) -> np.ndarray:
        """Returns the current corners of the boxes, and the vertices of flexes `(n, 3)` [m]."""
        if self.model.nflex:
            mujoco.mj_flex(self.model, data)
        return np.concatenate([*(bounds.points(data) for bounds in self.bounds), data.flexvert_xpos])

    def center(self, data: mujoco.MjData) -> np.ndarray:
        """Returns its centre of mass `(3,)` [m]; the mean position of its bodies if it has no mass."""
        center: np.ndarray = self.shares @ data.xipos
        return center


def moving_parts(model: mujoco.MjModel, *, with_still: bool = False) -> MovingParts | None:
    """Returns what moves in a model, and `with_still` also what does not; None if nothing of it is visible."""
    moving = (model.body_weldid != 0) | (model.body_mocapid[model.body_rootid] >= 0) | with_still
    visible = VISIBLE_GROUPS[model.geom_group] & (model.geom_rgba[:, 3] > 0)
    geoms = _geom_bounds(model, np.flatnonzero(moving[model.geom_bodyid] & visible))
    bounds = [each for each in (geoms, _skin_bounds(model, moving)) if each]
    if not bounds and not model.nflex:
        return None
    masses = model.body_mass * moving
    weights = masses if masses.any() else np.maximum(moving, not moving.any())
    return MovingParts(model, bounds, weights / weights.sum())


def _geom_bounds(model: mujoco.MjModel, ids: np.ndarray) -> BoundingBoxes | None:
    """Returns the bounds of these geoms, without infinite planes; None if no geom is finite."""
    centers, halves = model.geom_aabb[ids, :3].copy(), model.geom_aabb[ids, 3:].copy()
    planes = model.geom_type[ids] == PLANE  # whose boxes are infinite even if the visible part is not
    centers[planes], halves[planes] = 0.0, model.geom_size[ids[planes]] * [1, 1, 0]
    finite = ~planes | (model.geom_size[ids, :2] > 0).all(axis=1)
    if not finite.any():
        return None
    return BoundingBoxes("geom", ids[finite], (centers[:, None] + halves[:, None] * CORNERS)[finite])


def _skin_bounds(model: mujoco.MjModel, moving: np.ndarray) -> BoundingBoxes | None:
    """Returns the bounds of visible skins, a box for each bone on a moving body; None without any.

    A vertex is a weighted mean of the places to which its bones would move it (mjv_updateSkin): it lies between the
    boxes around the vertices of each bone.

    Args:
      moving: whether each body moves `(nbody,)`.
    """
    bodies, corners = list[int](), list[np.ndarray]()
    turn = np.empty(9)
    for skin in np.flatnonzero(VISIBLE_SKIN_GROUPS[model.skin_group] & (model.skin_rgba[:, 3] > 0)):
        vertices = model.skin_vert[model.skin_vertadr[skin] :]
        first, bones = model.skin_boneadr[skin], model.skin_bonenum[skin]
        for bone in range(first, first + bones):
            start, count = model.skin_bonevertadr[bone], model.skin_bonevertnum[bone]
            if count and moving[model.skin_bonebodyid[bone]]:
                mujoco.mju_quat2Mat(turn, model.skin_bonebindquat[bone].astype(float))
                moved = vertices[model.skin_bonevertid[start : start + count]] - model.skin_bonebindpos[bone]
                placed = moved @ turn.reshape(3, 3)
                least, most = placed.min(axis=0), placed.max(axis=0)
                bodies.append(int(model.skin_bonebodyid[bone]))
                corners.append((least + most) / 2 + CORNERS * ((most - least) / 2 + model.skin_inflate[skin]))
    return BoundingBoxes("body", np.array(bodies), np.array(corners)) if bodies else None


def _inside(model: mujoco.MjModel, root: int) -> np.ndarray:
    """Returns for each body whether it is `root` or attached to it `(nbody,)`."""
    inside = np.arange(int(model.nbody)) == root
    for body in range(1, model.nbody):  # parents come first
        inside[body] |= inside[model.body_parentid[body]]
    return inside


def _site_halves(model: mujoco.MjModel, site: int) -> np.ndarray:
    """Returns half the sizes of the box around a site `(3,)` [m]."""
    kind, (x, y, z) = mujoco.mjtGeom(model.site_type[site]), model.site_size[site]
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return np.array([x, x, x])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return np.array([x, x, x + y])
    return np.array([x, x, y] if kind == mujoco.mjtGeom.mjGEOM_CYLINDER else [x, y, z])


def identify_objects(text: str, model: mujoco.MjModel) -> list[tuple[str, int]]:
    """Returns kinds and ids of the objects in `text`, `OBJECT[,OBJECT…]`, without duplicates.

    Raises:
      UnknownNameError: an object is unknown.
    """
    return list(dict.fromkeys(identify_object(part, model) for part in text.split(",")))


@dataclass(frozen=True)
class ObjectTrajectory:
    """The positions and velocities of an object at the instants of a recording.

    Attributes:
      times: `(n,)` since the recording began [s], in order.
      positions: `(n, 3)` [m], of the body's frame, the geom's or the site's.
      velocities: `(n, 3)` [m/s], in the world.
    """

    times: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray

    def at(self, times: np.ndarray) -> np.ndarray:
        """Returns positions `(m, 3)` at `times` `(m,)`: cubic Hermite arcs through positions and velocities.

        Between the frames of a video, a few hundredths of a second apart, straight lines would be visible.
        """
        last = len(self.times) - 1
        if not last:
            return np.repeat(self.positions, len(times), axis=0)
        i = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, last - 1)
        span = self.times[i + 1] - self.times[i]
        u = ((times - self.times[i]) / np.where(span > 0, span, 1))[:, None].clip(0, 1)
        start, end = self.positions[i], self.positions[i + 1]
        leaving, arriving = (self.velocities[k] * span[:, None] for k in (i, i + 1))
        return (
            (1 + 2 * u) * (1 - u) ** 2 * start
            + u * (1 - u) ** 2 * leaving
            + u**2 * (3 - 2 * u) * end
            + u**2 * (u - 1) * arriving
        )

    def speeds(self, times: np.ndarray) -> np.ndarray:
        """Returns speeds `(m,)` [m/s] at `times` `(m,)`, linear in between."""
        speeds: np.ndarray = np.linalg.norm(self.velocities, axis=1)
        return np.interp(times, self.times, speeds)


def object_paths(
    model: mujoco.MjModel, objects: Sequence[tuple[str, int]], states: Iterable[np.ndarray]
) -> list[ObjectTrajectory]:
    """Returns the path of each of `objects`, as kind and id, through integration `states`, which are read once.

    Velocities are MuJoCo's (mj_objectVelocity), computed for each instant alone, so that states may be any time
    apart. Those of mocap bodies, which have none, are zero.
    """
    data = mujoco.MjData(model)
    times: list[float] = []
    points: list[list[np.ndarray]] = []
    velocity = np.empty(6)  # rotation first
    for state in states:
        restore(model, data, state)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        times.append(data.time)
        row = list[np.ndarray]()
        for kind, index in objects:
            mujoco.mj_objectVelocity(model, data, FRAMES[kind].value, index, velocity, 0)
            row.append(np.concatenate([getattr(data, PLACES[kind])[index], velocity[3:]]))
        points.append(row)
    paths = np.array(points).reshape(len(times), len(objects), 6)
    since = np.array(times) - times[0]  # the clock of a replayed recording may have begun at any time
    return [ObjectTrajectory(since, paths[:, k, :3], paths[:, k, 3:]) for k in range(len(objects))]
