"""Actuators and sensors that act on, or measure, another object than their name says, or one that cannot move."""

from collections.abc import Iterator

import mujoco

from mjrun.check.context import OWNERS, LintContext
from mjrun.check.rule import Violation, rule
from mjrun.check.rules.symmetry import other_side
from mjrun.model.names import KIND_OF, KINDS

SENSOR = mujoco.mjtSensor
MOTION = {  # sensors that are zero, or constant, on a body that cannot move
    int(kind)
    for kind in (
        *(SENSOR.mjSENS_ACCELEROMETER, SENSOR.mjSENS_VELOCIMETER, SENSOR.mjSENS_GYRO),
        *(SENSOR.mjSENS_FRAMELINVEL, SENSOR.mjSENS_FRAMEANGVEL, SENSOR.mjSENS_FRAMELINACC, SENSOR.mjSENS_FRAMEANGACC),
    )
}
TRANSMISSIONS = {
    int(mujoco.mjtTrn.mjTRN_JOINT): "joint",
    int(mujoco.mjtTrn.mjTRN_JOINTINPARENT): "joint",
    int(mujoco.mjtTrn.mjTRN_TENDON): "tendon",
    int(mujoco.mjtTrn.mjTRN_SITE): "site",
    int(mujoco.mjtTrn.mjTRN_BODY): "body",
}


@rule("MJ310", "warning", "name of the other side")
def signals_of_the_other_side(context: LintContext) -> Iterator[Violation]:
    """Yields actuators and sensors that are named after the left one of two objects, and belong to the right one."""
    model = context.model
    for kind, index, target_kind, target in _targets(model):
        name, of = mujoco.mj_id2name(model, KINDS[kind], index), mujoco.mj_id2name(model, KINDS[target_kind], target)
        if not (name and of) or _alike(name, of) or not _alike(other_side(name), of):
            continue
        meant = mujoco.mj_name2id(model, KINDS[target_kind], other_side(of))
        if meant >= 0:
            verb = "drives" if kind == "actuator" else "measures"
            message = f"it {verb} {context.object(target_kind, target)}, which is on the other side than its name says"
            remedy = f"write {context.object(target_kind, meant)}, or rename it"
            yield context.violation(kind, index, message, remedy)


@rule("MJ311", "warning", "motion of a body that cannot move")
def sensors_of_fixed_bodies(context: LintContext) -> Iterator[Violation]:
    """Yields the first sensor of velocities or accelerations on a body that is fixed to the world.

    Models whose world has no geoms are parts of scenes, in which they may move.
    """
    model = context.model
    fixed = [i for i in range(model.nsensor) if _is_motionless(model, i)] if model.body_geomnum[0] else []
    if fixed:
        more = f" (and {len(fixed) - 1} more)" if len(fixed) > 1 else ""
        kind, target = KIND_OF[int(model.sensor_objtype[fixed[0]])], int(model.sensor_objid[fixed[0]])
        message = f"it measures how {context.object(kind, target)} moves, which is fixed to the world{more}"
        remedy = "add the <freejoint/> that its body lacks, or attach the sensor to a body that moves"
        yield context.violation("sensor", fixed[0], message, remedy)


def _is_motionless(model: mujoco.MjModel, sensor: int) -> bool:
    """Returns whether a sensor measures the motion of a body other than the world that is fixed to the world."""
    if int(model.sensor_type[sensor]) not in MOTION:
        return False
    kind, target = KIND_OF.get(int(model.sensor_objtype[sensor]), ""), int(model.sensor_objid[sensor])
    body = target if kind == "body" else int(getattr(model, OWNERS[kind])[target]) if kind in OWNERS else 0
    mocap = model.body_mocapid[model.body_rootid[body]] >= 0
    return bool(body and not model.body_weldid[body] and not mocap)


def _targets(model: mujoco.MjModel) -> Iterator[tuple[str, int, str, int]]:
    """Yields the kind and id of actuators and sensors, each with the kind and id of what it belongs to."""
    for i in range(model.nactuator):
        if target_kind := TRANSMISSIONS.get(int(model.actuator_trntype[i])):
            yield "actuator", i, target_kind, int(model.actuator_trnid[i, 0])
    for i in range(model.nsensor):
        if (target_kind := KIND_OF.get(int(model.sensor_objtype[i]))) and model.sensor_objid[i] >= 0:
            yield "sensor", i, target_kind, int(model.sensor_objid[i])


def _alike(one: str, other: str) -> bool:
    """Returns whether one of two names contains the other."""
    return one in other or other in one
