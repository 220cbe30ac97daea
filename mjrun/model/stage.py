"""Additions to bare models, by MjSpec: a ground that collides, and a floor, a light and a sky for images.

All of them come last in the model, so that the ids of everything else stay the same.
"""

import mujoco
import numpy as np

from mjrun.errors import UsageError, clean, option

GROUND, FLOOR, LIGHT, SKY = "ground", "stage floor", "stage light", "stage sky"
UP, DOWN = (0.45, 0.56, 0.70), (0.86, 0.89, 0.92)  # colours of the sky
TILES = (0.50, 0.53, 0.57), (0.44, 0.47, 0.51)  # colours of the floor
SAME = 1e-6  # [m] between the heights of two planes that are one
PIXELS = 512  # width of the sky and of the floor's texture
SLANT = np.array((-0.25, 0.3, -1.0))  # direction of the light


def add_ground(spec: mujoco.MjSpec, height: str) -> None:
    """Adds a static body with a horizontal plane at `height` [m] that collides with everything that can collide.

    Raises:
      UsageError: the model already has a body or a geom of its name, or a floor at this height, whose contacts would
        count twice.
    """
    if spec.body(GROUND) or spec.geom(GROUND):
        raise UsageError(f"{option('ground')}: the model already has a body or a geom called {GROUND}")
    if floor := next((geom for geom in spec.worldbody.geoms if _is_floor(geom, float(height))), None):
        name = clean(floor.name or "a plane")
        raise UsageError(f"{option('ground')} is not needed: the model has a floor at this height already, {name}")
    body = spec.worldbody.add_body(name=GROUND, pos=(0, 0, float(height)))
    body.add_geom(name=GROUND, type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0, 0, 0.05))


def _is_floor(geom: mujoco.MjsGeom, height: float) -> bool:
    """Returns whether a geom of the world is a horizontal plane at this height [m]."""
    is_plane = geom.type == mujoco.mjtGeom.mjGEOM_PLANE
    is_level = geom.alt.type == mujoco.mjtOrientation.mjORIENTATION_QUAT and np.isclose(abs(geom.quat[0]), 1)
    return bool(is_plane and is_level and abs(geom.pos[2] - height) < SAME)


def add_to_stage(spec: mujoco.MjSpec, part: str) -> None:
    """Adds a part of a stage that physics does not notice: `floor`, `light` or `sky`."""
    _reduce(spec)
    {"floor": _add_floor, "light": _add_light, "sky": _add_sky}[part](spec)


def _reduce(spec: mujoco.MjSpec) -> None:
    """Fuses static bodies and discards visual geoms now, if the compiler would, so that it keeps what is added next."""
    if spec.compiler.fusestatic or spec.compiler.discardvisual:
        spec.compile()
        spec.compiler.fusestatic = spec.compiler.discardvisual = False


def _add_floor(spec: mujoco.MjSpec) -> None:
    """Adds a horizontal plane that collides with nothing, with tiles; a ground that the model has gets the tiles."""
    first, second = TILES
    spec.add_texture(
        name=FLOOR,
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=first,
        rgb2=second,
        width=PIXELS,
        height=PIXELS,
    )
    material = spec.add_material(name=FLOOR, texuniform=True)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = FLOOR
    if ground := spec.geom(GROUND):
        ground.material = FLOOR
        return
    spec.worldbody.add_body(name=FLOOR).add_geom(
        name=FLOOR,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=(0, 0, 0.05),
        material=FLOOR,
        contype=0,
        conaffinity=0,
        group=0,
    )


def _add_light(spec: mujoco.MjSpec) -> None:
    """Adds a directional light that follows the first body; `place` sets its direction and its distance."""
    body = spec.worldbody.first_body() or spec.worldbody
    body.add_light(
        name=LIGHT,
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        mode=mujoco.mjtCamLight.mjCAMLIGHT_TRACKCOM,
        diffuse=(0.6, 0.6, 0.6),
        ambient=(0.2, 0.2, 0.2),
        specular=(0.2, 0.2, 0.2),
    )


def _add_sky(spec: mujoco.MjSpec) -> None:
    spec.add_texture(
        name=SKY,
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=UP,
        rgb2=DOWN,
        width=PIXELS,
        height=6 * PIXELS,
    )
