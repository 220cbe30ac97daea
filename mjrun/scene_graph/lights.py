"""Lights in physical units, with the brightness that MuJoCo's renderers give them."""

import math

import mujoco
import numpy as np

from mjrun.model.names import enum_name
from mjrun.scene_graph.graph import SceneLight, Vector

KINDS = ("directional", "point", "spot")
DAYLIGHT = 80_000.0  # illuminance of a bright surface where lights have intensities [lx]


def light_of(model: mujoco.MjModel, data: mujoco.MjData, index: int) -> SceneLight | None:
    """Returns a light of the model; None if it is dark or only surrounds the scene.

    Lights of the classic renderer do not get weaker with distance. Here those with a place have the brightness of their
    diffuse colour on the surface that they light at first, and follow the inverse square law elsewhere.
    """
    kind = enum_name(mujoco.mjtLightType, model.light_type[index])
    color = np.clip(model.light_diffuse[index].astype(float), 0, None)
    if kind not in KINDS or not model.light_active[index] or not color.any():
        return None
    lux = math.pi * float(color.max())
    if kind == "directional":
        intensity = lux
    elif model.light_intensity[index] > 0:
        intensity = math.pi * float(model.light_intensity[index]) / DAYLIGHT
    else:
        intensity = lux * lit_distance(model, data, index) ** 2
    red, green, blue = (float(part) for part in color / color.max())
    hue: Vector = (red, green, blue)
    cutoff = math.radians(float(model.light_cutoff[index])) if kind == "spot" else 0.0
    return SceneLight(kind, hue, intensity, cutoff=cutoff)


def lit_distance(model: mujoco.MjModel, data: mujoco.MjData, light: int) -> float:
    """Returns the distance from a light to what it lights [m]: the model's centre, or what its axis hits beyond it."""
    start, body, hit = data.light_xpos[light], int(model.light_bodyid[light]), np.zeros(1, np.int32)
    centre = float(np.linalg.norm(model.stat.center - start))
    ahead = mujoco.mj_ray(model, data, start, data.light_xdir[light], None, 1, body or -1, hit)  # -1 for nothing
    return max(centre, min(ahead, 2 * (centre + model.stat.extent)))  # a floor may be hit at the horizon
