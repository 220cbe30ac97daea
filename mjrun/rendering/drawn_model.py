"""The model that is drawn: the simulated one on a stage, and with some of its geoms hidden.

The states of both models are interchangeable, and so are the ids of everything that the simulated model has.
"""

import copy
import itertools
import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import mujoco
import numpy as np

from mjrun.camera.targets import GhostMotion
from mjrun.errors import BrokenModelError, CompiledOverrideError, file_errors, option
from mjrun.model.additions import FLOOR, GROUND, LIGHT, SLANT
from mjrun.model.fields import arrays, is_layout
from mjrun.model.override import Override
from mjrun.model.source import ModelSource
from mjrun.model.state import restore, sizes, widened
from mjrun.options.rendering import SceneOptions

VISUAL, KEPT = re.compile(rb"<visual\b"), re.compile(rb"""\bdiscardvisual\s*=\s*["']false["']""")  # in a URDF
TILES = 3.0  # tiles of the floor per extent of the model
AWAY = 2.0  # distance of the light and reach of its shadows, in extents of the model
COVERED = (
    0.7  # share of the box of a body's colliding geoms that the box of its visual ones covers if they replace them
)
VISIBLE_GROUPS = np.flatnonzero(mujoco.MjvOption().geomgroup)
FAR = 1e6  # [m] beyond which no distance from the floor is measured
HIDDEN_GROUP = mujoco.mjNGROUP - 1
GROUNDS = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)
ADDED = {"nbody": 1, "ngeom": 1, "nlight": 1, "nmat": 1, "ntex": 2, "nsite": 0, "ncam": 0, "nmesh": 0}  # at most
CORNERS = np.array(list(itertools.product((-1, 1), repeat=3)))


def drawn_model(
    options: SceneOptions,
    model: mujoco.MjModel,
    source: ModelSource,
    cameras: Sequence[object] | None = None,
    *,
    is_measured: bool = False,
) -> tuple[mujoco.MjModel, str, bool]:
    """Returns the model to draw, a remark about an unrequested stage, and whether the default camera frames it closely.

    Args:
      source: the source of the model, whose numbers may differ.
      cameras: the cameras that see it; by default, those in the options.
      is_measured: the images measure what exists, and must not show what the simulation lacks unless requested.

    Raises:
      CompiledOverrideError: a stage is requested for a compiled model.
      BrokenModelError: the source has changed, or as `require_finite_extent`.
    """
    require_finite_extent(model, source)
    parts, remark = stage_parts(options, model, cameras, is_measured=is_measured), ""
    staged, is_framed = model, "camera" in parts
    if added := [part for part in parts if part != "camera"]:
        try:
            staged = _with_stage(source, model, added)
        except CompiledOverrideError:
            if "auto" not in options.stage:
                raise
            is_framed = False
        else:
            remark = stage_remark(parts) if "auto" in options.stage else ""
    hidden = source.hidden_groups
    if options.sitegroup is None and "site" in hidden:
        staged = copy.copy(staged)
        staged.site_group[np.isin(staged.site_group, hidden["site"])] = HIDDEN_GROUP
    if options.geomgroup is None:
        staged = _with_geoms(staged, options.geoms, hidden.get("geom", ()) if options.geoms is None else ())
    return staged, remark, is_framed


def require_finite_extent(model: mujoco.MjModel, source: ModelSource) -> None:
    """Raises BrokenModelError if the extent is not finite, from which MuJoCo computes what cameras see."""
    if not math.isfinite(extent := model.stat.extent):
        hint = f"set a length, as in {option('set')} stat.extent=1"
        raise BrokenModelError(Path(source.text), f"stat.extent must be finite for images, not {extent}", hint=hint)


def stage_parts(
    options: SceneOptions,
    model: mujoco.MjModel,
    cameras: Sequence[object] | None = None,
    *,
    is_measured: bool = False,
) -> Sequence[str]:
    """Returns the parts of the stage to add: `floor`, `light`, `sky` and `camera`.

    `auto` adds what a model without a floor and a sky lacks. It omits the floor from images that measure what exists,
    and beneath what would fall through it, and the camera where another one is requested.
    """
    if "none" in options.stage:
        return ()
    if "auto" not in options.stage:
        return options.stage
    planes = np.isin(model.geom_type, GROUNDS)
    added = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, GROUND)
    if planes.sum() > (added >= 0) or np.any(model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX):
        return ()
    falls = added < 0 and np.any(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    is_framed = any(
        str(camera).partition(":")[0] == "auto" for camera in (options.camera if cameras is None else cameras)
    )
    lacks = {"floor": not (is_measured or falls), "light": not model.nlight, "sky": True, "camera": is_framed}
    return [part for part, is_lacking in lacks.items() if is_lacking]


def place_stage(
    model: mujoco.MjModel,
    states: Iterable[np.ndarray],
    ghosts: Iterable[GhostMotion] = (),
) -> None:
    """Adapts a stage to the size of the model, and places its floor under the lowest point of the model and its ghosts.

    Args:
      states: the states that are drawn. Free bodies, which may fall without end, count only in the first.
      ghosts: the ghosts that are drawn with the model.
    """
    material = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_MATERIAL, FLOOR)
    floor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, FLOOR)
    light = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_LIGHT, LIGHT)
    if material >= 0:
        model.mat_texrepeat[material] = 1 / (2 * _tile(model.stat.extent))
    if light >= 0:
        model.light_dir0[light] = SLANT / np.linalg.norm(SLANT)
        model.light_poscom0[light] = -AWAY * model.stat.extent * model.light_dir0[light]
        model.vis.map.shadowclip = AWAY
    if floor >= 0:
        heights = [own := _height_above(model, floor, states)]
        for ghost in ghosts:
            height = own if ghost.states is None else _height_above(model, floor, ghost.states)
            heights.append(ghost.offset[2] + height)
        model.body_pos[model.geom_bodyid[floor], 2] += min(heights)


def _height_above(model: mujoco.MjModel, floor: int, states: Iterable[np.ndarray]) -> float:
    """Returns the height of the lowest point of the model above the floor, as `place_stage` counts states [m]."""
    data = mujoco.MjData(model)
    free = model.jnt_bodyid[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]
    counted = ~np.isin(model.geom_type, GROUNDS)
    lowest = math.inf
    for state in states:
        restore(model, data, widened(model, state))
        mujoco.mj_kinematics(model, data)
        bounds = data.geom_xpos[:, 2] - data.geom_xpos[floor, 2] - model.geom_rbound
        for geom in np.flatnonzero(counted & (bounds < lowest)):
            lowest = min(lowest, mujoco.mj_geomDistance(model, data, floor, geom, FAR, None))
        lowest = min([lowest, *(height - data.geom_xpos[floor, 2] for height in _flex_heights(model, data))])
        counted &= ~np.isin(model.body_rootid[model.geom_bodyid], free)
    return lowest if math.isfinite(lowest) else 0.0


def _with_stage(source: ModelSource, model: mujoco.MjModel, parts: Sequence[str]) -> mujoco.MjModel:
    """Returns a model with a stage and all numbers, textures and materials of `model`, whose files may have changed."""
    staged = source.with_overrides([Override("", part, "stage") for part in parts]).load()
    added = {name: int(getattr(staged, name) - getattr(model, name)) for name in ADDED}
    is_same = sizes(staged) == {**sizes(model), "nbody": staged.nbody} and added["nbody"] == added["ngeom"]
    if not (is_same and all(0 <= count <= most for count, most in zip(added.values(), ADDED.values(), strict=True))):
        raise BrokenModelError(Path(source.text), "it has changed since it was loaded", hint="run the command again")
    for name in arrays():
        old, new = getattr(model, name), getattr(staged, name)
        if not isinstance(old, np.ndarray) or is_layout(name):
            continue
        if name == "geom_matid":  # the stage covers planes that have no material
            covered = (old < 0) & (new[: len(old)] >= model.nmat)
            new[: len(old)] = np.where(covered, new[: len(old)], old)
        else:
            new[: len(old)] = old
    staged.opt, staged.vis, staged.stat = model.opt, model.vis, model.stat
    return staged


def stage_remark(parts: Sequence[str]) -> str:
    """Returns a remark about these parts of a stage, which the user has not requested."""
    *some, last = (f"a {part}" for part in parts)
    added = f"{', '.join(some)} and {last}" if some else last
    return f"{added} added, which the model lacks; {option('stage')} none omits {'them' if some else 'it'}"


def visual_remark(source: ModelSource) -> str:
    """Returns a remark about the visual geoms of a URDF file, which MuJoCo does not read unless the file demands it."""
    path = source.main_file
    if path is None or path.suffix != ".urdf":
        return ""
    with file_errors(path):
        text = path.read_bytes()
    if not VISUAL.search(text) or KEPT.search(text):
        return ""
    keeping = '<mujoco><compiler discardvisual="false"/></mujoco>'
    return f"MuJoCo reads no <visual> of a URDF, unless {keeping} is within its <robot>"


def ground_remark(model: mujoco.MjModel, state: np.ndarray) -> str:
    """Returns a remark about a drawn model without a floor, and the height of one that it would stand on in a state."""
    if np.isin(model.geom_type, GROUNDS).any() or not np.any(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE):
        return ""
    height = math.floor(_lowest(model, state) * 1000) / 1000
    return f"nothing is below the model; {option('ground')} {height:g} adds a floor that it stands on"


def _lowest(model: mujoco.MjModel, state: np.ndarray) -> float:
    """Returns the height of the lowest point of the flexes and of the geoms that collide in a state [m]."""
    data = mujoco.MjData(model)
    restore(model, data, widened(model, state))
    mujoco.mj_kinematics(model, data)
    collides = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    geoms = np.flatnonzero(collides) if collides.any() else np.arange(model.ngeom)
    heights = [data.geom_xpos[geom, 2] - _reach_down(model, data, geom) for geom in geoms.tolist()]
    return min(heights + _flex_heights(model, data), default=0.0)


def _flex_heights(model: mujoco.MjModel, data: mujoco.MjData) -> list[float]:
    """Returns the height of the lowest point around each vertex of flexes [m]; the poses of bodies are computed."""
    mujoco.mj_flex(model, data)
    heights: list[float] = (data.flexvert_xpos[:, 2] - np.repeat(model.flex_radius, model.flex_vertnum)).tolist()
    return heights


def _reach_down(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> float:
    """Returns how far a geom reaches below its centre [m]: the support function of its shape."""
    down, (a, b, c) = -data.geom_xmat[geom].reshape(3, 3)[2], model.geom_size[geom]
    match mujoco.mjtGeom(model.geom_type[geom]):
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            reach = a
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            reach = a + b * abs(down[2])
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            reach = a * np.hypot(down[0], down[1]) + b * abs(down[2])
        case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            reach = np.linalg.norm(down * (a, b, c))
        case mujoco.mjtGeom.mjGEOM_MESH:
            start, count = (int(values[model.geom_dataid[geom]]) for values in (model.mesh_vertadr, model.mesh_vertnum))
            reach = (model.mesh_vert[start : start + count] @ down).max()
        case _:
            center, half = model.geom_aabb[geom].reshape(2, 3)
            reach = center @ down + np.abs(down) @ half
    return float(reach)


def _tile(extent: float) -> float:
    """Returns the side of a tile of the floor [m], 1, 2 or 5 times a power of ten, for a model of this extent [m]."""
    power = 10 ** math.floor(math.log10(extent / TILES))
    # The logarithm of a number just below a power may be rounded to that of the power.
    return max((step * power for step in (1, 2, 5) if step * power <= extent / TILES), default=power)


def _with_geoms(model: mujoco.MjModel, geoms: str | None, omitted: Sequence[int]) -> mujoco.MjModel:
    """Returns the model with only these geoms in groups that are visible by default, without the `omitted` groups."""
    by_default = np.isin(model.geom_group, VISIBLE_GROUPS)
    is_omitted = np.isin(model.geom_group, omitted) & ~np.isin(model.geom_type, GROUNDS)
    visible = visible_geoms(model, geoms) & ~is_omitted
    if np.array_equal(visible, by_default):
        return model
    changed = copy.copy(model)
    changed.geom_group[visible & ~by_default] = VISIBLE_GROUPS[0]
    changed.geom_group[by_default & ~visible] = HIDDEN_GROUP
    return changed


def visible_geoms(model: mujoco.MjModel, geoms: str | None) -> np.ndarray:
    """Returns which geoms are visible, `(ngeom,)`.

    Visual geoms collide with nothing; they replace the colliding ones of their body. `None` hides only colliding geoms
    that have about the same place.
    """
    by_default = np.isin(model.geom_group, VISIBLE_GROUPS)
    colliding = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    colliding[[*model.pair_geom1, *model.pair_geom2]] = True
    if geoms == "collision":
        return colliding
    if geoms == "both":
        return by_default | colliding
    visible = by_default.copy()
    for body in sorted(set(model.geom_bodyid[by_default & ~colliding].tolist())):  # `np.unique` imports numpy.ma first
        own = by_default & (model.geom_bodyid == body)
        if geoms == "visual" or _covers(model, own & ~colliding, own & colliding):
            visible &= ~(own & colliding)
    return visible


def _covers(model: mujoco.MjModel, some: np.ndarray, others: np.ndarray) -> bool:
    """Returns whether the box around some geoms of a body covers most of the box around others."""
    if not others.any() or np.isin(model.geom_type[some | others], GROUNDS).any():
        return False
    (low, high), (other_low, other_high) = _box(model, some), _box(model, others)
    common = np.clip(np.minimum(high, other_high) - np.maximum(low, other_low), 0, None)
    return bool(common.prod() >= COVERED * (other_high - other_low).prod())


def _box(model: mujoco.MjModel, geoms: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the lowest and the highest corner of the box around geoms of one body [m], in its frame."""
    points = []
    for geom in np.flatnonzero(geoms):
        matrix = np.empty(9)
        mujoco.mju_quat2Mat(matrix, model.geom_quat[geom])
        centre, half = model.geom_aabb[geom].reshape(2, 3)
        points.append(model.geom_pos[geom] + (centre + CORNERS * half) @ matrix.reshape(3, 3).T)
    corners = np.concatenate(points)
    return corners.min(axis=0), corners.max(axis=0)
