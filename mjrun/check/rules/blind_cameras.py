"""Cameras that see nothing, told without drawing: what may be drawn as spheres in the frustum, planes by rays."""

from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from mjrun.check.context import LintContext
from mjrun.check.finding import Sighting

RAYS = (48, 36)  # across and down
ASPECT = 16 / 9  # of the picture, when the camera says nothing of it
SHOWN = 3  # groups that MuJoCo draws, from 0 on
PLAIN = np.array([0.5, 0.5, 0.5, 1], np.float32)  # the rgba that gives way to that of a material
TURN = np.diag([-1.0, 1.0, -1.0])
PLANE, MESH = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_MESH)
SOLID = ("SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX")
CONVEX = tuple(int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in SOLID)


class Opening(NamedTuple):
    """What a camera looks through.

    Attributes:
      eye: where it is `(3,)` [m].
      axes: its axes as columns `(3, 3)`.
      edges: left, right, bottom and top, at a distance of 1; anywhere if `parallel` [m].
      near, far: where the frustum begins and ends [m].
      parallel: whether it is orthographic.
    """

    eye: np.ndarray
    axes: np.ndarray
    edges: tuple[float, float, float, float]
    near: float
    far: float
    parallel: bool

    def turned(self) -> "Opening":
        """As seen by a camera that looks the other way."""
        return self._replace(axes=self.axes @ TURN)


def blind(subject: LintContext) -> Iterator[Sighting]:
    """Cameras before which there is nothing that is drawn, at none of the starts."""
    model = subject.model
    shown = np.flatnonzero(_drawn(model))
    for camera in range(model.ncam):
        if any(_sees(model, subject.at(start), camera, shown) for start in subject.starts):
            continue
        message, remedy = _why(subject, camera, shown)
        yield Sighting(message, remedy, subject.object("camera", camera), subject.place("camera", camera))


def _why(subject: LintContext, camera: int, shown: np.ndarray) -> tuple[str, str]:
    """Why a camera sees nothing, and what to do about it."""
    model, data = subject.model, subject.at(None)
    opening, hidden = _opening(model, data, camera), np.setdiff1d(np.arange(model.ngeom), shown)
    if before := list(_before(model, data, opening, hidden)):
        alpha = _alpha(model)
        return _unveiled(subject, min(before, key=lambda geom: alpha[geom] <= 0))
    around = [int(geom) for geom in shown if _encloses(model, data, opening, int(geom))]
    where = f"it lies inside {subject.object('geom', around[0])}, drawn from outside only, and " if around else ""
    turn = "turn it round" if _sees(model, data, camera, shown, turned=True) else "turn or move it"
    remedy = f'{turn}; its axes are x right, y up, −z ahead, and mode="targetbody" looks at a body'
    return f"it sees nothing: {where}no {'other ' * bool(around)}geom is in its frustum", remedy


def _unveiled(subject: LintContext, geom: int) -> tuple[str, str]:
    """What to say of a hidden geom before a camera that sees nothing."""
    group, name = int(subject.model.geom_group[geom]), subject.object("geom", geom)
    if _alpha(subject.model)[geom] <= 0:
        return f"it sees nothing: {name} before it is transparent, with alpha 0", "give it or its material an alpha"
    remedy = f"draw with --geomgroup {','.join(map(str, range(SHOWN)))},{group}, or put the geom into group 0, 1 or 2"
    return f"it sees nothing: {name} before it is in group {group}, which is not drawn by default", remedy


def _sees(model: mujoco.MjModel, data: mujoco.MjData, camera: int, shown: np.ndarray, turned: bool = False) -> bool:
    """Whether any of the geoms `shown` is before a camera, or a flex; rather yes than no where it cannot be told."""
    if model.nskin or not np.isfinite(data.cam_xpos[camera]).all():
        return True
    opening = _opening(model, data, camera)
    opening = opening.turned() if turned else opening
    return _sees_flex(model, data, opening) or next(_before(model, data, opening, shown), None) is not None


def _sees_flex(model: mujoco.MjModel, data: mujoco.MjData, opening: Opening) -> bool:
    """Whether a flex is before a camera: something of it lies around its vertices, as far as its longest edge."""
    reach = model.flexedge_length0.max(initial=0.0)
    return bool(_within(opening, data.flexvert_xpos.reshape(-1, 3), np.full(model.nflexvert, reach)).any())


def _before(model: mujoco.MjModel, data: mujoco.MjData, opening: Opening, geoms: np.ndarray) -> Iterator[int]:
    """Those of `geoms` of which something is before a camera."""
    near = _within(opening, data.geom_xpos[geoms], model.geom_rbound[geoms]) | (model.geom_type[geoms] == PLANE)
    return (geom for geom in map(int, geoms[near]) if _shows(model, data, opening, geom))


def _shows(model: mujoco.MjModel, data: mujoco.MjData, opening: Opening, geom: int) -> bool:
    """Whether something of a geom whose bounding sphere is before a camera is drawn: faces are, from outside only."""
    if model.geom_type[geom] == PLANE:
        return _meets_plane(model, data, opening, geom)
    close = np.linalg.norm(opening.eye - data.geom_xpos[geom]) < model.geom_rbound[geom] and not opening.parallel
    if close and model.geom_type[geom] == MESH:
        return bool(_within(opening, *_faces_before(model, data, opening, geom)).any())
    return not (close and _encloses(model, data, opening, geom))


def _opening(model: mujoco.MjModel, data: mujoco.MjData, camera: int) -> Opening:
    eye, axes = data.cam_xpos[camera], data.cam_xmat[camera].reshape(3, 3)
    near, far = model.vis.map.znear * model.stat.extent, model.vis.map.zfar * model.stat.extent
    parallel = bool(model.cam_projection[camera] == mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC)
    return Opening(eye, axes, _edges(model, camera, parallel), near, far, parallel)


def _edges(model: mujoco.MjModel, camera: int, parallel: bool) -> tuple[float, float, float, float]:
    """The sides of a camera's picture, left, right, bottom and top, at a distance of 1 [m]."""
    if model.cam_sensorsize[camera].all():
        fx, fy, cx, cy = model.cam_intrinsic[camera]
        width, height = model.cam_sensorsize[camera] / 2
        return ((cx - width) / fx, (cx + width) / fx, (cy - height) / fy, (cy + height) / fy)
    fovy = float(model.cam_fovy[camera])
    half = fovy / 2 if parallel else float(np.tan(np.radians(fovy) / 2))
    pixels = model.cam_resolution[camera]
    aspect = float(pixels[0] / pixels[1]) if pixels.min() > 1 else ASPECT
    return (-half * aspect, half * aspect, -half, half)


def _alpha(model: mujoco.MjModel) -> np.ndarray:
    """The opacity of each geom, `(ngeom,)`: its own, or that of its material if it says none."""
    material = model.mat_rgba[model.geom_matid, 3] if model.nmat else 1.0
    of_material = (model.geom_matid >= 0) & (model.geom_rgba == PLAIN).all(axis=1)
    return np.where(of_material, material, model.geom_rgba[:, 3])


def _drawn(model: mujoco.MjModel) -> np.ndarray:
    """Whether MuJoCo draws each geom, `(ngeom,)`."""
    return (_alpha(model) > 0) & (model.geom_group < SHOWN)


def _encloses(model: mujoco.MjModel, data: mujoco.MjData, opening: Opening, geom: int) -> bool:
    """Whether a camera lies inside a convex geom, so that both ways along a line there is a wall, or inside a mesh."""
    if opening.parallel:
        return False
    if model.geom_type[geom] == MESH:
        return not len(_faces_before(model, data, opening, geom)[0])
    if model.geom_type[geom] not in CONVEX:
        return False
    quality = model.vis.quality  # round things are drawn as polyhedra, which are that much smaller
    inner = float(np.prod([np.cos(np.pi / max(number, 2)) for number in (quality.numslices, quality.numstacks)]))
    pose = data.geom_xpos[geom], data.geom_xmat[geom], model.geom_size[geom] * inner
    ways = (opening.axes[:, 2].copy(), -opening.axes[:, 2])
    return all(mujoco.mju_rayGeom(*pose, opening.eye, way, model.geom_type[geom]) >= 0 for way in ways)


def _faces_before(
    model: mujoco.MjModel, data: mujoco.MjData, opening: Opening, geom: int
) -> tuple[np.ndarray, np.ndarray]:
    """Centres `(n, 3)` and radii `(n,)` [m] of the faces of a mesh that turn their outside to a camera."""
    mesh = model.geom_dataid[geom]
    first, faces = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
    vertices = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
    corners = vertices[model.mesh_face[faces : faces + model.mesh_facenum[mesh]]]
    corners = corners @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    corners = corners[((opening.eye - corners[:, 0]) * outward).sum(axis=1) > 0]
    centres = corners.mean(axis=1)
    return centres, np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1, initial=0.0)


def _within(opening: Opening, points: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Whether each of the spheres around `points` `(n, 3)` reaches into the frustum, `(n,)`."""
    local = (points - opening.eye) @ opening.axes
    (left, right, bottom, top), ahead = opening.edges, -local[:, 2]
    scale = 1.0 if opening.parallel else ahead
    found = (ahead > opening.near - radii) & (ahead < opening.far + radii)
    for edge, axis, sign in ((left, 0, 1), (right, 0, -1), (bottom, 1, 1), (top, 1, -1)):
        slope = 1.0 if opening.parallel else float(np.hypot(1, edge))  # the distance to a slanted side is shorter
        found &= sign * (local[:, axis] - edge * scale) / slope > -radii
    return found


def _meets_plane(model: mujoco.MjModel, data: mujoco.MjData, opening: Opening, geom: int) -> bool:
    """Whether one of a grid of rays through the picture meets a plane, which is drawn from both sides."""
    if _within(opening, data.geom_xpos[geom, None], np.zeros(1)).any():
        return True  # it may be too small for the rays
    starts, ways = _rays(opening)
    axes = data.geom_xmat[geom].reshape(3, 3)
    starts, ways = (starts - data.geom_xpos[geom]) @ axes, ways @ axes
    with np.errstate(divide="ignore", invalid="ignore"):
        along = -starts[:, 2] / ways[:, 2]  # of a depth of 1
        met = abs(starts[:, :2] + along[:, None] * ways[:, :2])
    half = np.where(model.geom_size[geom, :2] > 0, model.geom_size[geom, :2], np.inf)  # 0 is endless
    return bool(((along > opening.near) & (along < opening.far) & (met <= half).all(axis=1)).any())


def _rays(opening: Opening) -> tuple[np.ndarray, np.ndarray]:
    """Where a grid of rays through the picture starts, and how far each goes in a depth of 1, both `(n, 3)` [m]."""
    left, right, bottom, top = opening.edges
    x, y = np.meshgrid(np.linspace(left, right, RAYS[0]), np.linspace(bottom, top, RAYS[1]))
    flat = np.stack([x.ravel(), y.ravel(), np.full(x.size, -1.0)], axis=1)
    if opening.parallel:
        return opening.eye + (flat * [1, 1, 0]) @ opening.axes.T, (flat * [0, 0, 1]) @ opening.axes.T
    return np.broadcast_to(opening.eye, flat.shape), flat @ opening.axes.T
