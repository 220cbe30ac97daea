"""Visible objects that change their shape: flexes and skins as surfaces, tendons and ropes as segments."""

import copy
from collections.abc import Sequence

import mujoco
import numpy as np

from mjrun.dataclass import dataclass

ALL = mujoco.mjtCatBit.mjCAT_ALL.value
FLEX, SKIN = int(mujoco.mjtGeom.mjGEOM_FLEX), int(mujoco.mjtGeom.mjGEOM_SKIN)
CAPSULE, TENDON = int(mujoco.mjtGeom.mjGEOM_CAPSULE), int(mujoco.mjtObj.mjOBJ_TENDON)
GEOMS = 10_000  # segments of tendons, at most
Rgba = tuple[float, float, float, float]


@dataclass(frozen=True, eq=False)
class TriangleSurface:
    """A surface of triangles.

    Attributes:
      points: vertices in the world, `(n, 3)` [m].
      faces: indices of the vertices, `(m, 3)`.
      rgba: colour and opacity, from 0 to 1.
    """

    points: np.ndarray
    faces: np.ndarray
    rgba: Rgba


@dataclass(frozen=True, eq=False)
class LineSegments:
    """Thick straight lines.

    Attributes:
      ends: both ends of each line in the world, `(n, 2, 3)` [m].
      width: diameter of the lines [m].
      rgba: colour and opacity, from 0 to 1.
    """

    ends: np.ndarray
    width: float
    rgba: Rgba


class SoftShapes:
    """The flexes, skins and tendons of a model that MuJoCo's visualizer shows with these options."""

    def __init__(self, model: mujoco.MjModel, options: mujoco.MjvOption) -> None:
        self._model = model
        self._options = copy.copy(options)
        self._options.geomgroup[:] = self._options.sitegroup[:] = 0
        self._scene = mujoco.MjvScene(model, GEOMS)
        self._camera = mujoco.MjvCamera()

    @staticmethod
    def exist_in(model: mujoco.MjModel) -> bool:
        """Returns whether a model has such objects, visible or not."""
        return model.nflex + model.nskin + model.ntendon > 0

    def at(self, data: mujoco.MjData) -> list[TriangleSurface | LineSegments]:
        """Returns the shapes of an instant, whose positions are computed."""
        scene = self._scene
        mujoco.mjv_updateScene(self._model, data, self._options, None, self._camera, ALL, scene)
        shapes = list[TriangleSurface | LineSegments]()
        tendons: dict[int, list[mujoco.MjvGeom]] = {}
        for geom in scene.geoms[: scene.ngeom]:
            if geom.type == FLEX:
                shapes.append(self._flex(data, int(geom.objid), _rgba(geom)))
            elif geom.type == SKIN:
                shapes.append(self._skin(int(geom.objid), _rgba(geom)))
            elif geom.objtype == TENDON and geom.type == CAPSULE:
                tendons.setdefault(int(geom.objid), []).append(geom)
        return [*shapes, *map(_tendon, tendons.values())]

    def _flex(self, data: mujoco.MjData, flex: int, rgba: Rgba) -> TriangleSurface | LineSegments:
        model = self._model
        start = model.flex_vertadr[flex]
        points = data.flexvert_xpos[start : start + model.flex_vertnum[flex]].copy()
        if model.flex_dim[flex] == 1:
            first = model.flex_edgeadr[flex]
            edges = model.flex_edge[first : first + model.flex_edgenum[flex]]
            return LineSegments(points[edges], 2 * float(model.flex_radius[flex]), rgba)
        if model.flex_dim[flex] == 2:
            first, count, vertices = model.flex_elemdataadr[flex], model.flex_elemnum[flex], model.flex_elem
        else:
            first, count, vertices = model.flex_shelldataadr[flex], model.flex_shellnum[flex], model.flex_shell
        return TriangleSurface(points, vertices[first : first + 3 * count].reshape(-1, 3), rgba)

    def _skin(self, skin: int, rgba: Rgba) -> TriangleSurface:
        model = self._model
        start, first = model.skin_vertadr[skin], model.skin_faceadr[skin]
        points = self._scene.skinvert.reshape(-1, 3)[start : start + model.skin_vertnum[skin]].copy()
        return TriangleSurface(points, model.skin_face[first : first + model.skin_facenum[skin]], rgba)


def _tendon(geoms: Sequence[mujoco.MjvGeom]) -> LineSegments:
    """Returns the segments that the visualizer draws as capsules."""
    centers = np.array([geom.pos for geom in geoms])
    halves = np.array([geom.size[2] * geom.mat[:, 2] for geom in geoms])
    ends = np.stack([centers - halves, centers + halves], axis=1)
    return LineSegments(ends, 2 * float(geoms[0].size[0]), _rgba(geoms[0]))


def _rgba(geom: mujoco.MjvGeom) -> Rgba:
    red, green, blue, opacity = (float(part) for part in geom.rgba)
    return red, green, blue, opacity
