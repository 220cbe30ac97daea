"""Objects that can only be addressed by number."""

from collections.abc import Iterator

import mujoco
import numpy as np

from mjrun.check.context import LintContext
from mjrun.check.finding import Sighting
from mjrun.model.names import COUNTS, KINDS

ADDRESSED = ("joint", "actuator", "sensor", "camera")
SHOWN = 8  # numbers that are listed


def unnamed(subject: LintContext) -> Iterator[Sighting]:
    """Joints, actuators, sensors and cameras without a name, told once for each kind.

    The only joint of a body answers to the name of its body, and nobody can name what a flexcomp makes.
    """
    for kind in ADDRESSED:
        count = getattr(subject.model, COUNTS[kind])
        found = [i for i in range(count) if not mujoco.mj_id2name(subject.model, KINDS[kind], i)]
        if kind == "joint":
            made = flex_bodies(subject.model)
            found = [i for i in found if not _answers(subject.model, i, made)]
        if not found:
            continue
        numbers = [str(i) for i in found[:SHOWN]] + ["…"] * (len(found) > SHOWN)
        message = f"{len(found)} {kind}{'s' * (len(found) > 1)} without a name: {kind}:{', '.join(numbers)}"
        remedy = "name what is to be found again: the numbers of the others shift with every change to the model"
        yield Sighting(message, remedy, subject.object(kind, found[0]), subject.place(kind, found[0]))


def flex_bodies(model: mujoco.MjModel) -> set[int]:
    """The bodies that carry a flex."""
    return {int(b) for b in np.concatenate([model.flex_vertbodyid, model.flex_nodebodyid])}


def _answers(model: mujoco.MjModel, joint: int, made: set[int]) -> bool:
    body = int(model.jnt_bodyid[joint])
    alone = model.body_jntnum[body] == 1 and bool(mujoco.mj_id2name(model, KINDS["body"], body))
    return alone or body in made
