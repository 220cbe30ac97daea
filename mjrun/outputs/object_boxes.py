"""Boxes around objects in their frames, exact for single bodies."""

import itertools
from collections.abc import Sequence
from enum import IntEnum

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.model.flex_and_skin_bodies import flex_owners, skin_owners
from mjrun.rendering.drawn_model import VISIBLE_GROUPS

CORNERS = np.array(list(itertools.product((-1, 1), repeat=3)), float)


class _GeomType(IntEnum):
    """The types of geoms, which patterns can name."""

    PLANE = mujoco.mjtGeom.mjGEOM_PLANE.value
    SPHERE = mujoco.mjtGeom.mjGEOM_SPHERE.value
    CAPSULE = mujoco.mjtGeom.mjGEOM_CAPSULE.value
    ELLIPSOID = mujoco.mjtGeom.mjGEOM_ELLIPSOID.value
    CYLINDER = mujoco.mjtGeom.mjGEOM_CYLINDER.value
    BOX = mujoco.mjtGeom.mjGEOM_BOX.value
    MESH = mujoco.mjtGeom.mjGEOM_MESH.value
    SDF = mujoco.mjtGeom.mjGEOM_SDF.value


@dataclass(frozen=True)
class ObjectBox:
    """A box in the frame of an object.

    Attributes:
      center: `(3,)` [m].
      size: its whole sides `(3,)` [m].
    """

    center: np.ndarray
    size: np.ndarray

    def corners(self, pose: np.ndarray) -> np.ndarray:
        """Returns its corners `(8, 3)` [m], moved by `pose` `(4, 4)`."""
        points = self.center + CORNERS * self.size / 2
        moved: np.ndarray = points @ pose[:3, :3].T + pose[:3, 3]
        return moved


class ObjectBoxes:
    """The boxes around the visible geoms, the flexes and the skins of objects.

    They are exact for geoms of the object's own body; other geoms are as large as their own boxes.

    Args:
      roots: the body of each object.
      owners: the object that each body belongs to `(nbody,)`, −1 for none.
      visible: a flag for each geom, true if it is visible `(ngeom,)`.
    """

    def __init__(self, model: mujoco.MjModel, roots: Sequence[int], owners: np.ndarray, visible: np.ndarray) -> None:
        self._parts: dict[int, list[tuple[int, np.ndarray]]] = {}  # by object: bodies, and corners in their frames
        bounded = (model.geom_type != _GeomType.PLANE) | (model.geom_size[:, :2] > 0).all(axis=1)
        for geom in np.flatnonzero(visible & bounded):
            body = int(model.geom_bodyid[geom])
            if (owner := int(owners[body])) >= 0:
                corners = (_exact_corners if body == roots[owner] else _own_corners)(model, int(geom))
                self._parts.setdefault(owner, []).append((body, corners))
        self._flexes = _vertex_owners(owners, flex_owners(model), model.flex_group, model.flex_vertnum)
        self._skins = _vertex_owners(owners, skin_owners(model), model.skin_group, model.skin_vertnum)
        self._model, self._scene = model, mujoco.MjvScene(model, 1)  # which computes the vertices of skins

    def box(self, index: int, pose: np.ndarray, data: mujoco.MjData) -> ObjectBox:
        """Returns the box around an object at `pose` `(4, 4)`, world from object; empty if nothing is visible."""
        points = [
            data.xpos[body] + corners @ data.xmat[body].reshape(3, 3).T for body, corners in self._parts.get(index, ())
        ]
        points.append(data.flexvert_xpos[self._flexes == index])
        if index in self._skins:
            mujoco.mjv_updateScene(self._model, data, mujoco.MjvOption(), None, mujoco.MjvCamera(), 0, self._scene)
            points.append(self._scene.skinvert.reshape(-1, 3)[self._skins == index])
        if not any(map(len, points)):
            return ObjectBox(np.zeros(3), np.zeros(3))
        local = (np.concatenate(points) - pose[:3, 3]) @ pose[:3, :3]
        low, high = local.min(axis=0), local.max(axis=0)
        return ObjectBox((low + high) / 2, high - low)


def _vertex_owners(owners: np.ndarray, bodies: np.ndarray, groups: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Returns the object of each vertex of flexes or skins, −1 for none.

    Args:
      owners: the object that each body belongs to.
      bodies, groups, counts: the body, the group and the number of vertices of each flex or skin.
    """
    visible = np.isin(groups, VISIBLE_GROUPS)
    return np.repeat(np.where(visible, np.append(owners, -1)[bodies], -1), counts)


def _own_corners(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Returns the corners of the box around a geom along its own axes, in the frame of its body `(8, 3)` [m]."""
    center, half = model.geom_aabb[geom].reshape(2, 3)
    if model.geom_type[geom] == _GeomType.PLANE:  # whose box is infinite
        center, half = np.zeros(3), model.geom_size[geom] * [1, 1, 0]
    corners: np.ndarray = model.geom_pos[geom] + (center + CORNERS * half) @ _turn(model, geom).T
    return corners


def _exact_corners(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Returns the corners of the smallest box around a geom along the axes of its body, in its frame `(8, 3)` [m]."""
    turn, place = _turn(model, geom), model.geom_pos[geom]
    size, axis = model.geom_size[geom], turn[:, 2]
    match model.geom_type[geom]:
        case _GeomType.MESH | _GeomType.SDF:
            mesh = model.geom_dataid[geom]
            first = model.mesh_vertadr[mesh]
            points = place + model.mesh_vert[first : first + model.mesh_vertnum[mesh]] @ turn.T
            low, high = points.min(axis=0), points.max(axis=0)
            return (low + high) / 2 + CORNERS * (high - low) / 2
        case _GeomType.SPHERE:
            half = np.full(3, size[0])
        case _GeomType.CAPSULE:
            half = np.abs(axis) * size[1] + size[0]
        case _GeomType.CYLINDER:
            half = np.abs(axis) * size[1] + size[0] * np.sqrt(np.maximum(1 - axis**2, 0))
        case _GeomType.ELLIPSOID:
            half = np.sqrt(((turn * size) ** 2).sum(axis=1))
        case _GeomType.BOX:
            half = np.abs(turn) @ size
        case _:  # a height field or a plane
            return _own_corners(model, geom)
    return place + CORNERS * half


def _turn(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Returns the rotation `(3, 3)`, body from geom."""
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, model.geom_quat[geom])
    return matrix.reshape(3, 3)
