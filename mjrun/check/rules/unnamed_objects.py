"""Objects without a name, which can only be addressed by number."""

from collections.abc import Iterator

import mujoco
import numpy as np

from mjrun.check.context import LintContext
from mjrun.check.rule import Violation, rule
from mjrun.model.names import COUNTS, KINDS

ADDRESSED = ("joint", "actuator", "sensor", "camera")
LISTED = 8  # numbers in one message


@rule("MJ201", "note", "object without a name")
def unnamed_objects(context: LintContext) -> Iterator[Violation]:
    """Yields joints, actuators, sensors and cameras without a name, one violation for each kind.

    The only joint of a body can be addressed by the name of its body, and the parts of a flexcomp cannot be named.
    """
    for kind in ADDRESSED:
        count = getattr(context.model, COUNTS[kind])
        unnamed = [i for i in range(count) if not mujoco.mj_id2name(context.model, KINDS[kind], i)]
        if kind == "joint":
            generated = flex_bodies(context.model)
            unnamed = [joint for joint in unnamed if not _needs_no_name(context.model, joint, generated)]
        if not unnamed:
            continue
        numbers = [str(i) for i in unnamed[:LISTED]] + ["…"] * (len(unnamed) > LISTED)
        message = f"{len(unnamed)} {kind}{'s' * (len(unnamed) > 1)} without a name: {kind}:{', '.join(numbers)}"
        remedy = "name the objects that you want to address: numbers shift whenever the model changes"
        yield context.violation(kind, unnamed[0], message, remedy)


def flex_bodies(model: mujoco.MjModel) -> set[int]:
    """Returns the bodies that carry a flex."""
    return {int(b) for b in np.concatenate([model.flex_vertbodyid, model.flex_nodebodyid])}


def _needs_no_name(model: mujoco.MjModel, joint: int, generated: set[int]) -> bool:
    body = int(model.jnt_bodyid[joint])
    only_joint = model.body_jntnum[body] == 1 and bool(mujoco.mj_id2name(model, KINDS["body"], body))
    return only_joint or body in generated
