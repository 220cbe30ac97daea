"""Scenes without light, and geoms that flicker because they have the same surface."""

from collections.abc import Iterator

import mujoco
import numpy as np

from mjrun.check.context import LintContext
from mjrun.check.rule import Place, Violation, rule

SHOWN_GROUPS = 3  # the number of groups that are shown by default
DIGITS = 6  # of positions and sizes in m that are compared


@rule("MJ602", "note", "no light")
def missing_light(context: LintContext) -> Iterator[Violation]:
    """Yields models whose images are black: without an active light, and without a headlight."""
    model = context.model
    headlight = model.vis.headlight
    shines = headlight.active and (np.any(headlight.ambient) or np.any(headlight.diffuse))
    if model.ngeom and not shines and not model.light_active.any():
        message = "no light is active, and the headlight is off: images are black"
        remedy = 'add <light pos="0 0 3" dir="0 0 -1"/> to the <worldbody>, or switch the headlight on'
        yield Violation(message, remedy, Place(context.path))


@rule("MJ603", "note", "geoms that flicker")
def coincident_geoms(context: LintContext) -> Iterator[Violation]:
    """Yields the first visible geom with the same surface as another one of the same body in another colour."""
    model = context.model
    seen: dict[tuple[float, ...], int] = {}
    pairs: list[tuple[int, int]] = []
    for geom in range(model.ngeom):
        if model.geom_group[geom] >= SHOWN_GROUPS or not model.geom_rgba[geom, 3]:
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
