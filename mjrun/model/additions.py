"""Additions to bare models, by MjSpec: servos in place of motors, a ground that collides, and a stage for images.

The parts of a ground and a stage come last in the model, so that the ids of everything else stay the same.
"""

import math
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from mjrun.errors import UsageError, clean, counted, option
from mjrun.model.names import SCALAR_JOINTS
from mjrun.options.model import AUTO, parse_gains

HINGE, SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
FREQUENCY = 2 * math.pi * 5  # natural frequency of a servo without load [rad/s]
SAG = {HINGE: 0.3, SLIDE: 0.1}  # error at the full force [rad, m]
GRAVITY_SAG = {HINGE: 0.1, SLIDE: 0.05}  # largest error under the weight of what the joint carries [rad, m]
STIFFEST = 0.1  # share of the inertia per squared timestep: beyond, the damping is unstable
GROUND, FLOOR, LIGHT, SKY = "ground", "stage floor", "stage light", "stage sky"
UP, DOWN = (0.45, 0.56, 0.70), (0.86, 0.89, 0.92)  # colours of the sky
TILES = (0.50, 0.53, 0.57), (0.44, 0.47, 0.51)  # colours of the floor
SAME = 1e-6  # [m] between the heights of two planes that are one
PIXELS = 512  # width of the sky and of the floor's texture
SLANT = np.array((-0.25, 0.3, -1.0))  # direction of the light


def add_servos(spec: mujoco.MjSpec, gains: str) -> None:
    """Replaces each motor on a hinge or slide joint by a position servo, whose control is the position of the joint.

    A model without actuators gets a servo on each of these joints that has a name. The force of a servo is
    kp (control - position) - kd velocity, within the limits of the motor.

    Args:
      gains: `auto`, or settings such as `kp=50,kd=2`. A missing kp gives a natural frequency of 5 Hz, and more where
        the weight or the largest force would otherwise move the joint far; a missing kd damps critically.

    Raises:
      UsageError: the model has no motor that a servo can replace.
    """
    motors = _motors(spec)
    if not motors:
        reason = "none of its actuators is a motor on a hinge or slide joint"
        if any(actuator.biastype == mujoco.mjtBias.mjBIAS_AFFINE for actuator in spec.actuators):
            reason = "its actuators are servos already, or no motors on hinge or slide joints"
        if not spec.actuators:
            reason = "it has no hinge or slide joint with a name"
        raise UsageError(f"{option('position_control')} does not apply to this model: {reason}")
    model = spec.compile()
    chosen = {} if gains == AUTO else parse_gains(gains)
    for motor, index in motors:
        _become_servo(motor, index, model, chosen)


def servos(model: mujoco.MjModel) -> list[int]:
    """Returns the ids of the actuators that control the position of a joint."""
    return [
        index
        for index in range(model.nactuator)
        if model.actuator_trntype[index] == mujoco.mjtTrn.mjTRN_JOINT
        and model.actuator_biastype[index] == mujoco.mjtBias.mjBIAS_AFFINE
        and model.actuator_dyntype[index] != mujoco.mjtDyn.mjDYN_INTEGRATOR
        and model.actuator_biasprm[index, 1] != 0
        and int(model.jnt_type[model.actuator_trnid[index, 0]]) in SCALAR_JOINTS
    ]


def servo_sentence(model: mujoco.MjModel) -> str:
    """Describes the servos of a model and their gains."""
    found = servos(model)
    kp, kd = (np.abs(prm[found, i]) for prm, i in ((model.actuator_gainprm, 0), (model.actuator_biasprm, 2)))
    gains = f"{counted(len(found), 'servo')}, kp {_span(kp)}, kd {_span(kd)}"
    return f"{gains}; {option('position_control')} kp=…,kd=… sets the gains"


def _span(values: np.ndarray) -> str:
    least, most = f"{values.min():.3g}", f"{values.max():.3g}"
    return least if least == most else f"{least} to {most}"


def _motors(spec: mujoco.MjSpec) -> Sequence[tuple[mujoco.MjsActuator, int]]:
    """Returns the motors on hinge and slide joints with their ids, after adding some to a model without actuators."""
    joints = {joint.name: joint for joint in spec.joints if joint.name and joint.type in (HINGE, SLIDE)}
    if not spec.actuators:
        for name in joints:
            spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    return [(each, index) for index, each in enumerate(spec.actuators) if each.target in joints and _is_motor(each)]


def _is_motor(actuator: mujoco.MjsActuator) -> bool:
    return (
        actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT
        and actuator.dyntype == mujoco.mjtDyn.mjDYN_NONE
        and actuator.gaintype == mujoco.mjtGain.mjGAIN_FIXED
        and actuator.biastype == mujoco.mjtBias.mjBIAS_NONE
    )


def _become_servo(motor: mujoco.MjsActuator, index: int, model: mujoco.MjModel, chosen: Mapping[str, float]) -> None:
    joint = int(model.actuator_trnid[index, 0])
    inertia = 1 / float(model.dof_invweight0[model.jnt_dofadr[joint]])  # as if everything else were free to move
    limits = _force_limits(model, index)
    kp = chosen.get("kp") or _stiffness(model, joint, inertia, limits)
    kd = chosen.get("kd", 2 * math.sqrt(kp * inertia))
    motor.set_to_position(kp, kv=kd)
    motor.gear = [1, 0, 0, 0, 0, 0]
    motor.forcelimited = np.isfinite(limits).all()
    motor.forcerange = limits if motor.forcelimited else [0, 0]
    motor.ctrllimited = bool(model.jnt_limited[joint])
    motor.ctrlrange = model.jnt_range[joint] if motor.ctrllimited else [0, 0]


def _force_limits(model: mujoco.MjModel, index: int) -> np.ndarray:
    """Returns the least and the largest force or torque that a motor exerts on its joint `(2,)`; perhaps infinite."""
    limits = np.array([-np.inf, np.inf])
    gain, control = model.actuator_gainprm[index, 0], model.actuator_ctrladr[index]
    if model.actuator_ctrllimited[control]:
        limits = np.sort(gain * model.actuator_ctrlrange[control])
    if model.actuator_forcelimited[index]:
        limits = np.clip(limits, *model.actuator_forcerange[index])
    return np.sort(limits * model.actuator_gear[model.actuator_outadr[index], 0])


def _stiffness(model: mujoco.MjModel, joint: int, inertia: float, limits: np.ndarray) -> float:
    """Returns kp of a servo, in N m/rad or N/m."""
    kind = mujoco.mjtJoint(int(model.jnt_type[joint]))
    if model.jnt_actfrclimited[joint]:
        limits = np.clip(limits, *model.jnt_actfrcrange[joint])
    force = float(np.abs(limits).max())
    loaded = force / SAG[kind] if math.isfinite(force) else _weight(model, joint, kind) / GRAVITY_SAG[kind]
    return min(max(inertia * FREQUENCY**2, loaded), STIFFEST * inertia / model.opt.timestep**2)


def _weight(model: mujoco.MjModel, joint: int, kind: mujoco.mjtJoint) -> float:
    """Returns the largest torque or force on a joint by the weight of what it carries [N m, N]."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    body = model.jnt_bodyid[joint]
    force = model.body_subtreemass[body] * float(np.linalg.norm(model.opt.gravity))
    arm = np.linalg.norm(data.subtree_com[body] - data.xanchor[joint]) if kind == HINGE else 1
    return force * float(arm)


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
    # Static bodies are fused and visual geoms discarded before the part is added, so that the compiler keeps it.
    if spec.compiler.fusestatic or spec.compiler.discardvisual:
        spec.compile()
        spec.compiler.fusestatic = spec.compiler.discardvisual = False
    {"floor": _add_floor, "light": _add_light, "sky": _add_sky}[part](spec)


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
