"""Scenes without light, geoms that flicker because they have the same surface, and cameras that see nothing.

Cameras are checked without rendering: bounding spheres against the frustum, planes by rays.
"""

from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from mjrun.check.context import CheckContext
from mjrun.check.finding import Place, Violation
from mjrun.check.rule import rule
from mjrun.check.rules.bodies import INFINITE
from mjrun.errors import option

DIGITS = 6  # of positions and sizes in m that are compared
RAYS = (48, 36)  # across and down
ASPECT = 16 / 9  # of the image, for cameras without a resolution
VISIBLE_GROUPS = 3  # geom groups 0, 1 and 2, which MuJoCo draws by default
DEFAULT_RGBA = np.array([0.5, 0.5, 0.5, 1], np.float32)  # replaced by that of the material
HALF_TURN = np.diag([-1.0, 1.0, -1.0])
PLANE, MESH = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_MESH)
SOLID = ("SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX")
CONVEX = tuple(int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in SOLID)


@rule("MJ602", "note", "no light")
def missing_light(context: CheckContext) -> Iterator[Violation]:
    """Yields models whose images are black: without an active light, and without a headlight."""
    model = context.model
    headlight = model.vis.headlight
    shines = headlight.active and (np.any(headlight.ambient) or np.any(headlight.diffuse))
    if model.ngeom and not shines and not model.light_active.any():
        message = "no light is active, and the headlight is off: images are black"
        remedy = 'add <light pos="0 0 3" dir="0 0 -1"/> to the <worldbody>, or switch the headlight on'
        yield Violation(message, remedy, Place(context.path))


@rule("MJ603", "note", "geoms that flicker")
def coincident_geoms(context: CheckContext) -> Iterator[Violation]:
    """Yields the first visible geom with the same surface as another one of the same body in another colour."""
    model, alpha = context.model, _alpha(context.model)
    seen: dict[tuple[float, ...], int] = {}
    pairs: list[tuple[int, int]] = []
    for geom in range(model.ngeom):
        if model.geom_group[geom] >= VISIBLE_GROUPS or alpha[geom] <= 0:
            continue
        kind = (model.geom_bodyid[geom], model.geom_type[geom], model.geom_dataid[geom])
        shape = (*model.geom_size[geom], *model.geom_pos[geom], *model.geom_quat[geom])
        other = seen.setdefault((*map(int, kind), *(round(float(number), DIGITS) + 0.0 for number in shape)), geom)
        if other != geom and _look(model, other) != _look(model, geom):
            pairs.append((geom, other))
    for geom, other in pairs[:1]:
        more = f" (and {len(pairs) - 1} more pairs)" if len(pairs) > 1 else ""
        message = f"it has the same surface as {context.object('geom', other)}: images show a mixture of both{more}"
        yield context.violation("geom", geom, message, 'hide one of them, such as the one that collides: group="3"')


def _look(model: mujoco.MjModel, geom: int) -> tuple[float, ...]:
    """Returns the material and the colour of a geom."""
    return (int(model.geom_matid[geom]), *map(float, model.geom_rgba[geom]))


class ViewVolume(NamedTuple):
    """The volume that a camera sees.

    Attributes:
      eye: the position of the camera `(3,)` [m].
      axes: its axes as columns `(3, 3)`.
      edges: left, right, bottom and top [m], at a distance of 1 m unless orthographic.
      near, far: the distances of the clipping planes [m].
      orthographic: true for an orthographic projection.
    """

    eye: np.ndarray
    axes: np.ndarray
    edges: tuple[float, float, float, float]
    near: float
    far: float
    orthographic: bool

    def turned(self) -> "ViewVolume":
        """Returns the frustum of a camera that looks in the opposite direction."""
        return self._replace(axes=self.axes @ HALF_TURN)


@rule("MJ601", "warning", "camera that sees nothing")
def cameras_that_see_nothing(context: CheckContext) -> Iterator[Violation]:
    """Yields cameras with nothing visible in their frustum at any start.

    Models without a floor are parts of scenes, which the cameras of their bodies look at.
    """
    model = context.model
    visible = np.flatnonzero(_visible(model))
    is_part = not np.isin(model.geom_type, INFINITE).any()
    for camera in range(model.ncam):
        if is_part and model.cam_bodyid[camera]:
            continue
        if any(_sees(model, context.data_at(start), camera, visible) for start in context.starts):
            continue
        yield context.violation("camera", camera, *_explain(context, camera, visible))


def _explain(context: CheckContext, camera: int, visible: np.ndarray) -> tuple[str, str]:
    """Returns the reason why a camera sees nothing, and a remedy."""
    model, data = context.model, context.data_at(None)
    frustum = _frustum(model, data, camera)
    hidden = np.setdiff1d(np.arange(int(model.ngeom)), visible)
    if in_view := list(_in_view(model, data, frustum, hidden)):
        alpha = _alpha(model)
        return _explain_hidden(context, min(in_view, key=lambda geom: alpha[geom] <= 0))

    around = [int(geom) for geom in visible if _encloses(model, data, frustum, int(geom))]
    where = f"it is inside {context.object('geom', around[0])}, drawn from outside only, and " if around else ""
    turn = "turn it around" if _sees(model, data, camera, visible, turned=True) else "turn or move it"
    remedy = f'{turn}; its axes are x right, y up, −z ahead, and mode="targetbody" looks at a body'
    return f"it sees nothing: {where}no {'other ' * bool(around)}geom is in its frustum", remedy


def _explain_hidden(context: CheckContext, geom: int) -> tuple[str, str]:
    """Returns message and remedy for a camera that sees nothing because a geom in its view is hidden."""
    group, name = int(context.model.geom_group[geom]), context.object("geom", geom)
    if _alpha(context.model)[geom] <= 0:
        return f"it sees nothing: {name} in its view is transparent, with alpha 0", "give it or its material an alpha"
    groups = ",".join(map(str, (*range(VISIBLE_GROUPS), group)))
    remedy = f"draw with {option('geomgroup')} {groups}, or put the geom into group 0, 1 or 2"
    return f"it sees nothing: {name} in its view is in group {group}, which is not drawn by default", remedy


def _sees(model: mujoco.MjModel, data: mujoco.MjData, camera: int, visible: np.ndarray, turned: bool = False) -> bool:
    """Returns whether a camera sees a flex or any of the `visible` geoms; true if in doubt."""
    if model.nskin or not np.isfinite(data.cam_xpos[camera]).all():
        return True
    frustum = _frustum(model, data, camera)
    frustum = frustum.turned() if turned else frustum
    return _sees_flex(model, data, frustum) or next(_in_view(model, data, frustum, visible), None) is not None


def _sees_flex(model: mujoco.MjModel, data: mujoco.MjData, frustum: ViewVolume) -> bool:
    """Returns whether a camera sees a flex: all of it is within the length of its longest edge from a vertex."""
    reach = model.flexedge_length0.max(initial=0.0)
    return bool(_within(frustum, data.flexvert_xpos.reshape(-1, 3), np.full(int(model.nflexvert), reach)).any())


def _in_view(model: mujoco.MjModel, data: mujoco.MjData, frustum: ViewVolume, geoms: np.ndarray) -> Iterator[int]:
    """Yields those of `geoms` that a camera sees at least in part."""
    near = _within(frustum, data.geom_xpos[geoms], model.geom_rbound[geoms]) | (model.geom_type[geoms] == PLANE)
    return (geom for geom in map(int, geoms[near]) if _shows_outside(model, data, frustum, geom))


def _shows_outside(model: mujoco.MjModel, data: mujoco.MjData, frustum: ViewVolume, geom: int) -> bool:
    """Returns whether a geom whose bounding sphere is in view is visible: faces are, from outside only."""
    if model.geom_type[geom] == PLANE:
        return _meets_plane(model, data, frustum, geom)
    close = np.linalg.norm(frustum.eye - data.geom_xpos[geom]) < model.geom_rbound[geom] and not frustum.orthographic
    if close and model.geom_type[geom] == MESH:
        return bool(_within(frustum, *_faces_toward(model, data, frustum, geom)).any())
    return not (close and _encloses(model, data, frustum, geom))


def _frustum(model: mujoco.MjModel, data: mujoco.MjData, camera: int) -> ViewVolume:
    eye, axes = data.cam_xpos[camera], data.cam_xmat[camera].reshape(3, 3)
    near, far = model.vis.map.znear * model.stat.extent, model.vis.map.zfar * model.stat.extent
    orthographic = bool(model.cam_projection[camera] == mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC)
    return ViewVolume(eye, axes, _edges(model, camera, orthographic), near, far, orthographic)


def _edges(model: mujoco.MjModel, camera: int, orthographic: bool) -> tuple[float, float, float, float]:
    """Returns left, right, bottom and top of a camera's image [m], at a distance of 1 m unless orthographic."""
    if model.cam_sensorsize[camera].all():
        fx, fy, cx, cy = model.cam_intrinsic[camera]
        width, height = model.cam_sensorsize[camera] / 2
        # The middle of the image is to the right of the axis by cx, and below it by cy, as in mjv_cameraFrustum.
        return ((cx - width) / fx, (cx + width) / fx, -(cy + height) / fy, (height - cy) / fy)
    fovy = float(model.cam_fovy[camera])
    half = fovy / 2 if orthographic else float(np.tan(np.radians(fovy) / 2))
    pixels = model.cam_resolution[camera]
    aspect = float(pixels[0] / pixels[1]) if pixels.min() > 1 else ASPECT
    return (-half * aspect, half * aspect, -half, half)


def _alpha(model: mujoco.MjModel) -> np.ndarray:
    """Returns the opacity of each geom, `(ngeom,)`: its own, or that of its material if it has none."""
    material = model.mat_rgba[model.geom_matid, 3] if model.nmat else 1.0
    uses_material = (model.geom_matid >= 0) & (model.geom_rgba == DEFAULT_RGBA).all(axis=1)
    return np.where(uses_material, material, model.geom_rgba[:, 3])


def _visible(model: mujoco.MjModel) -> np.ndarray:
    """Returns whether MuJoCo draws each geom by default, `(ngeom,)`."""
    return (_alpha(model) > 0) & (model.geom_group < VISIBLE_GROUPS)


def _encloses(model: mujoco.MjModel, data: mujoco.MjData, frustum: ViewVolume, geom: int) -> bool:
    """Returns whether a camera is in a convex geom, hit by both rays along ±z, or in a mesh without faces toward it."""
    if frustum.orthographic:
        return False
    if model.geom_type[geom] == MESH:
        return not len(_faces_toward(model, data, frustum, geom)[0])
    if model.geom_type[geom] not in CONVEX:
        return False
    quality = model.vis.quality  # curved shapes are drawn as polyhedra, which are smaller by this factor
    inner = float(np.prod([np.cos(np.pi / max(number, 2)) for number in (quality.numslices, quality.numstacks)]))
    pose = data.geom_xpos[geom], data.geom_xmat[geom], model.geom_size[geom] * inner
    directions = (frustum.axes[:, 2].copy(), -frustum.axes[:, 2])
    return all(mujoco.mju_rayGeom(*pose, frustum.eye, ray, model.geom_type[geom]) >= 0 for ray in directions)


def _faces_toward(
    model: mujoco.MjModel, data: mujoco.MjData, frustum: ViewVolume, geom: int
) -> tuple[np.ndarray, np.ndarray]:
    """Returns centres `(n, 3)` and radii `(n,)` [m] of the faces of a mesh whose outside faces the camera."""
    mesh = model.geom_dataid[geom]
    first, faces = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
    vertices = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
    corners = vertices[model.mesh_face[faces : faces + model.mesh_facenum[mesh]]]
    corners = corners @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    corners = corners[((frustum.eye - corners[:, 0]) * outward).sum(axis=1) > 0]
    centres = corners.mean(axis=1)
    return centres, np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1, initial=0.0)


def _within(frustum: ViewVolume, points: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Returns whether each of the spheres around `points` `(n, 3)` reaches into the frustum, `(n,)`."""
    local = (points - frustum.eye) @ frustum.axes
    (left, right, bottom, top), ahead = frustum.edges, -local[:, 2]
    scale = 1.0 if frustum.orthographic else ahead
    inside = (ahead > frustum.near - radii) & (ahead < frustum.far + radii)
    for edge, axis, sign in ((left, 0, 1), (right, 0, -1), (bottom, 1, 1), (top, 1, -1)):
        slope = 1.0 if frustum.orthographic else float(np.hypot(1, edge))  # the distance to a slanted side is shorter
        inside &= sign * (local[:, axis] - edge * scale) / slope > -radii
    return inside


def _meets_plane(model: mujoco.MjModel, data: mujoco.MjData, frustum: ViewVolume, geom: int) -> bool:
    """Returns whether one of a grid of rays through the image hits a plane, which is drawn from both sides."""
    if _within(frustum, data.geom_xpos[geom, None], np.zeros(1)).any():
        return True  # it may be too small for the rays
    origins, directions = _rays(frustum)
    axes = data.geom_xmat[geom].reshape(3, 3)
    origins, directions = (origins - data.geom_xpos[geom]) @ axes, directions @ axes
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = -origins[:, 2] / directions[:, 2]
        hit = abs(origins[:, :2] + depth[:, None] * directions[:, :2])
    half = np.where(model.geom_size[geom, :2] > 0, model.geom_size[geom, :2], np.inf)  # 0 is infinite
    return bool(((depth > frustum.near) & (depth < frustum.far) & (hit <= half).all(axis=1)).any())


def _rays(frustum: ViewVolume) -> tuple[np.ndarray, np.ndarray]:
    """Returns a grid of rays through the image: origins `(n, 3)` [m], and directions `(n, 3)` that are 1 m deep."""
    left, right, bottom, top = frustum.edges
    x, y = np.meshgrid(np.linspace(left, right, RAYS[0]), np.linspace(bottom, top, RAYS[1]))
    through = np.stack([x.ravel(), y.ravel(), np.full(x.size, -1.0)], axis=1)
    if frustum.orthographic:
        return frustum.eye + (through * [1, 1, 0]) @ frustum.axes.T, (through * [0, 0, 1]) @ frustum.axes.T
    return np.broadcast_to(frustum.eye, through.shape), through @ frustum.axes.T
