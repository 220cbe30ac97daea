"""Meshes that are inside out or open, and their surfaces and convex hulls."""

from collections.abc import Iterator
from functools import cached_property

import mujoco
import numpy as np

from mjrun.check.context import CheckContext
from mjrun.check.finding import Violation
from mjrun.check.rule import rule

LEGACY, EXACT = mujoco.mjtMeshInertia.mjMESH_INERTIA_LEGACY, mujoco.mjtMeshInertia.mjMESH_INERTIA_EXACT
CONVEX, SHELL = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX, mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
SPHERE, CAPSULE = int(mujoco.mjtGeom.mjGEOM_SPHERE), int(mujoco.mjtGeom.mjGEOM_CAPSULE)
CYLINDER, ELLIPSOID = int(mujoco.mjtGeom.mjGEOM_CYLINDER), int(mujoco.mjtGeom.mjGEOM_ELLIPSOID)
BOX, MESH = int(mujoco.mjtGeom.mjGEOM_BOX), int(mujoco.mjtGeom.mjGEOM_MESH)


class Surface:
    """A surface of triangles in the frame of a mesh.

    Attributes:
      vertices: their corners, `(n, 3)` [m].
      faces: the rows of the corners of each triangle, `(m, 3)`.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        self.vertices, self.faces = vertices.astype(float), faces

    @classmethod
    def of(cls, model: mujoco.MjModel, mesh: int) -> "Surface":
        """Returns the surface of a mesh."""
        start, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
        return cls(_vertices(model, mesh), model.mesh_face[start : start + count])

    @classmethod
    def hull(cls, model: mujoco.MjModel, mesh: int) -> "Surface | None":
        """Returns the convex hull of a mesh, with which MuJoCo collides; None if it has none."""
        start = int(model.mesh_graphadr[mesh])
        if start < 0:
            return None
        vertices, faces = (int(count) for count in model.mesh_graph[start : start + 2])
        start += 2 + 3 * vertices + 3 * faces  # mjModel.mesh_graph: vert_edgeadr, vert_globalid, edge_localid, faces
        return cls(_vertices(model, mesh), model.mesh_graph[start : start + 3 * faces].reshape(-1, 3))

    @cached_property
    def volumes(self) -> np.ndarray:
        """The signed volumes of the tetrahedra of the triangles and the origin, `(m,)` [m³].

        They are positive where a triangle runs counterclockwise as seen from outside.
        """
        first, second, third = self._corners(np.zeros(3))
        return np.einsum("ij,ij->i", first, np.cross(second, third)) / 6

    @property
    def volume(self) -> float:
        """The signed volume that the surface encloses [m³]."""
        return float(self.volumes.sum())

    @property
    def area(self) -> float:
        """The area of the surface [m²]."""
        first, second, third = self._corners(np.zeros(3))
        return float(np.linalg.norm(np.cross(second - first, third - first), axis=1).sum() / 2)

    def open_edges(self) -> int:
        """Returns the number of edges that do not separate two triangles."""
        _, vertices = np.unique(self.vertices, axis=0, return_inverse=True)
        corners = vertices.reshape(-1)[self.faces]
        edges = np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]), axis=1)
        edges = edges[edges[:, 0] != edges[:, 1]]  # of triangles without area
        _, counts = np.unique(edges[:, 0] * len(self.vertices) + edges[:, 1], return_counts=True)
        return int((counts % 2).sum())

    def encloses(self, point: np.ndarray) -> bool:
        """Returns whether the triangles fill more than half of the view from `point`, by their solid angles."""
        first, second, third = self._corners(point)
        one, two, three = (np.linalg.norm(corner, axis=1) for corner in (first, second, third))
        volume = np.einsum("ij,ij->i", first, np.cross(second, third))
        cosine = one * two * three + (first * second).sum(axis=1) * three
        cosine += (second * third).sum(axis=1) * one + (third * first).sum(axis=1) * two
        return bool(abs(2 * np.arctan2(volume, cosine).sum()) > 2 * np.pi)

    def _corners(self, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns the first, second and third corners of the triangles relative to a point, each `(m, 3)`."""
        first, second, third = (self.vertices[self.faces[:, corner]] - origin for corner in range(3))
        return first, second, third


def _vertices(model: mujoco.MjModel, mesh: int) -> np.ndarray:
    start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    return model.mesh_vert[start : start + count]


@rule("MJ505", "note", "mesh that is inside out or open")
def unsound_meshes(context: CheckContext) -> Iterator[Violation]:
    """Yields meshes that are inside out and collide or give mass, and open ones that give mass.

    MuJoCo collides with the convex hull of a mesh, which is the same if it is open.
    """
    model = context.model
    massive = _meshes_with_mass(context)
    collides = (model.geom_type == MESH) & ((model.geom_contype | model.geom_conaffinity) != 0)
    for mesh in sorted(massive | set(map(int, model.geom_dataid[collides]))):
        surface = Surface.of(model, mesh)
        if surface.volume < -context.thresholds.inverted_volume * np.prod(np.ptp(surface.vertices, axis=0)):
            message = "its triangles face inwards: its volume is negative"
            remedy = "flip its faces, in Blender with Mesh, Normals, Recalculate Outside"
            yield context.violation("mesh", mesh, message, remedy)
        elif mesh in massive and surface.open_edges():
            message = "it gives its body mass, but is not closed, so its volume is uncertain"
            remedy = 'close its holes, or write inertia="convex" for the mesh, or an <inertial> for the body'
            yield context.violation("mesh", mesh, message, remedy)


def _meshes_with_mass(context: CheckContext) -> set[int]:
    """Returns the meshes whose volume determines the mass or the inertia of a moving body."""
    spec, model = context.spec, context.model
    by_volume = {mesh.id for mesh in spec.meshes if mesh.inertia in (LEGACY, EXACT)} if spec else set[int]()
    meshes = set[int]()
    for body in spec.bodies if spec else ():
        if body.explicitinertial or not model.body_weldid[body.id]:
            continue
        for geom in body.geoms:
            if 0 <= geom.id < model.ngeom and model.geom_type[geom.id] == MESH and geom_mass(context, geom):
                meshes.add(int(model.geom_dataid[geom.id]))
    return meshes & by_volume


def geom_mass(context: CheckContext, geom: mujoco.MjsGeom) -> float:
    """Returns the mass that MuJoCo infers from a geom, before it scales all masses of a model [kg]."""
    spec = context.spec
    if spec is None or not spec.compiler.inertiagrouprange[0] <= geom.group <= spec.compiler.inertiagrouprange[1]:
        return 0.0
    return float(geom.density * _volume(context, geom.id) if np.isnan(geom.mass) else geom.mass)


def _volume(context: CheckContext, geom: int) -> float:
    """Returns the volume of a geom as MuJoCo computes it [m³], or the area of a shell [m²]; 0 for an infinite geom."""
    model, spec = context.model, context.spec
    if model.geom_type[geom] == MESH and spec:
        mesh = int(model.geom_dataid[geom])
        method = next((asset.inertia for asset in spec.meshes if asset.id == mesh), LEGACY)
        surface = Surface.hull(model, mesh) if method == CONVEX else Surface.of(model, mesh)
        if method == SHELL or surface is None:
            return surface.area if surface else 0.0
        return float(abs(surface.volumes).sum()) if method == LEGACY else surface.volume
    return primitive_volume(model, geom)


def primitive_volume(model: mujoco.MjModel, geom: int) -> float:
    """Returns the volume of a geom that is neither a mesh nor infinite [m³]; else 0."""
    x, y, z = map(float, model.geom_size[geom])
    cylinder = 2 * np.pi * x * x * y
    ball = 4 / 3 * np.pi * x**3
    volumes = {SPHERE: ball, CAPSULE: ball + cylinder, CYLINDER: cylinder, BOX: 8 * x * y * z}
    return {**volumes, ELLIPSOID: 4 / 3 * np.pi * x * y * z}.get(int(model.geom_type[geom]), 0.0)


def convex_volume(model: mujoco.MjModel, geom: int) -> float:
    """Returns the volume of a geom [m³]; for a mesh that of its hull, or of its box if it has none."""
    if model.geom_type[geom] != MESH:
        return primitive_volume(model, geom)
    hull = Surface.hull(model, int(model.geom_dataid[geom]))
    x, y, z = map(float, model.geom_aabb[geom, 3:])
    return abs(hull.volume) if hull else 8 * x * y * z
