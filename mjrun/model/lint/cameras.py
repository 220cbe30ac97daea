"""Cameras that see nothing, told without drawing: rays through the picture, and bounding spheres for what is small."""

from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from mjrun.model.lint.finding import Sighting
from mjrun.model.lint.subject import Subject

RAYS = (48, 36)  # across and down
ASPECT = 16 / 9  # of the picture, when the camera says nothing of it
SHOWN = np.array([1, 1, 1, 0, 0, 0], np.uint8)  # the groups that MuJoCo draws


class Opening(NamedTuple):
    """What a camera looks through.

    Attributes:
      edges: left, right, bottom and top, at a distance of 1; anywhere if `parallel` [m].
      near, far: where the frustum begins and ends [m].
      parallel: whether it is orthographic.
    """

    edges: tuple[float, float, float, float]
    near: float
    far: float
    parallel: bool


def blind(subject: Subject) -> Iterator[Sighting]:
    """Cameras before which there is nothing, at none of the starts."""
    for camera in range(subject.model.ncam):
        if any(_sees(subject.model, subject.at(start), camera) for start in subject.starts):
            continue
        turn = "turn it round" if _sees_behind(subject, camera) else "turn or move it"
        message = "it sees nothing: no geom is in its frustum"
        remedy = f'{turn}; its axes are x right, y up, −z ahead, and mode="targetbody" looks at a body'
        yield Sighting(message, remedy, subject.object("camera", camera), subject.place("camera", camera))


def _sees_behind(subject: Subject, camera: int) -> bool:
    return _sees(subject.model, subject.at(None), camera, turned=True)


def _sees(model: mujoco.MjModel, data: mujoco.MjData, camera: int, turned: bool = False) -> bool:
    """Whether anything that MuJoCo draws is before a camera; rather yes than no where it cannot be told."""
    if model.nskin or not np.isfinite(data.cam_xpos[camera]).all():
        return True
    axes = data.cam_xmat[camera].reshape(3, 3)
    if turned:
        axes = axes @ np.diag([-1.0, 1.0, -1.0])
    opening = _opening(model, camera)
    local = (_points(model, data) - data.cam_xpos[camera]) @ axes
    if _inside(opening, local, _radii(model)):
        return True
    return _hits(model, data, data.cam_xpos[camera], axes, opening)


def _opening(model: mujoco.MjModel, camera: int) -> Opening:
    near, far = model.vis.map.znear * model.stat.extent, model.vis.map.zfar * model.stat.extent
    parallel = model.cam_projection[camera] == mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC
    if model.cam_sensorsize[camera].all():
        fx, fy, cx, cy = model.cam_intrinsic[camera]
        width, height = model.cam_sensorsize[camera] / 2
        edges = ((cx - width) / fx, (cx + width) / fx, (cy - height) / fy, (cy + height) / fy)
        return Opening(edges, near, far, parallel)
    fovy = float(model.cam_fovy[camera])
    half = fovy / 2 if parallel else float(np.tan(np.radians(fovy) / 2))
    pixels = model.cam_resolution[camera]
    aspect = pixels[0] / pixels[1] if pixels.min() > 1 else ASPECT
    return Opening((-half * aspect, half * aspect, -half, half), near, far, parallel)


def _drawn(model: mujoco.MjModel) -> np.ndarray:
    """The geoms that MuJoCo draws."""
    material = model.mat_rgba[model.geom_matid, 3] if model.nmat else 1.0
    alpha = np.where(model.geom_matid >= 0, material, model.geom_rgba[:, 3])
    return np.flatnonzero((alpha > 0) & (model.geom_group < SHOWN.sum()) & (model.geom_rbound > 0))


def _points(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Centres of the bounding spheres of geoms, and vertices of flexes, `(n, 3)`."""
    return np.concatenate([data.geom_xpos[_drawn(model)], data.flexvert_xpos.reshape(-1, 3)])


def _radii(model: mujoco.MjModel) -> np.ndarray:
    return np.concatenate([model.geom_rbound[_drawn(model)], np.zeros(model.nflexvert)])


def _inside(opening: Opening, local: np.ndarray, radii: np.ndarray) -> bool:
    """Whether a sphere around a point in camera axes reaches into the frustum."""
    (left, right, bottom, top), ahead = opening.edges, -local[:, 2]
    scale = 1.0 if opening.parallel else ahead
    found = (ahead > opening.near - radii) & (ahead < opening.far + radii)
    for edge, axis, sign in ((left, 0, 1), (right, 0, -1), (bottom, 1, 1), (top, 1, -1)):
        slope = 1.0 if opening.parallel else float(np.hypot(1, edge))  # the distance to a slanted side is shorter
        found &= sign * (local[:, axis] - edge * scale) / slope > -radii
    return bool(found.any())


def _hits(model: mujoco.MjModel, data: mujoco.MjData, eye: np.ndarray, axes: np.ndarray, opening: Opening) -> bool:
    """Whether one of a grid of rays through the picture meets a geom."""
    left, right, bottom, top = opening.edges
    x, y = np.meshgrid(np.linspace(left, right, RAYS[0]), np.linspace(bottom, top, RAYS[1]))
    flat = np.stack([x.ravel(), y.ravel(), np.full(x.size, -1.0)], axis=1)
    if opening.parallel:
        starts = eye + (flat * [1, 1, 0]) @ axes.T
        ahead = -axes[:, 2]
        lengths = np.array([mujoco.mj_ray(model, data, s, ahead, SHOWN, True, -1, None) for s in starts])
    else:
        lengths = np.full(len(flat), -1.0)
        rays = (flat @ axes.T).ravel()
        ids = np.full(len(flat), -1, np.int32)
        mujoco.mj_multiRay(model, data, eye, rays, SHOWN, True, -1, ids, lengths, None, len(flat), opening.far)
    return bool(((lengths > opening.near) & (lengths < opening.far)).any())
