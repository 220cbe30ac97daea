"""Fixes that change how a model moves: contacts that are excluded, keyframes above the floor, inertias from geoms."""

from collections.abc import Collection

import mujoco
import numpy as np

from mjrun.check.context import LintContext
from mjrun.check.rule import GENERATED, Fix, words_fix
from mjrun.model.names import FREE, KINDS
from mjrun.model.text_edits import escaped, number_word

UPRIGHT = 0.99  # the least vertical part of the normal of a floor
DECIMALS = 6  # of heights [m]
ORIENTATIONS = ("quat", "euler", "axisangle", "xyaxes", "zaxis")
IDENTITY = (1.0, 0.0, 0.0, 0.0)


def without_contacts(context: LintContext, start: int | None, pairs: Collection[tuple[int, int]]) -> Fix | str:
    """Returns the fix of geoms that penetrate each other at a start.

    In the initial state, moving bodies exclude each other. In a keyframe, floating bodies are lifted out of the floor.
    """
    return _excluded(context, pairs) if start is None else _lifted(context, start, pairs)


def _excluded(context: LintContext, pairs: Collection[tuple[int, int]]) -> Fix | str:
    model, root = context.model, context.source.root
    bodies = {tuple(sorted(int(model.geom_bodyid[geom]) for geom in pair)) for pair in pairs}
    moving = sorted(pair for pair in bodies if model.body_weldid[list(pair)].all())
    names = [[mujoco.mj_id2name(model, KINDS["body"], body) or "" for body in pair] for pair in moving]
    excludes = [f'<exclude body1="{escaped(a)}" body2="{escaped(b)}"/>' for a, b in names if a and b]
    if root is None or not excludes:
        return "only contacts between moving bodies with names can be excluded"
    contact = next((e for e in root.children if e.tag == "contact" and e.file == context.path), None)
    if contact:
        edits = [context.editor.with_child(contact, exclude) for exclude in excludes]
    else:
        edits = [context.editor.with_child(root, "\n  ".join(["<contact>", *excludes]) + "\n</contact>")]
    return Fix(tuple(edits), ("exclude", "exclude_*", "nexclude"))


def _lifted(context: LintContext, key: int, pairs: Collection[tuple[int, int]]) -> Fix | str:
    model, heights = context.model, dict[int, float]()
    for contact in context.data_at(key).contact:
        pair = tuple(map(int, contact.geom))
        floors = [geom for geom in pair if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE]
        if pair not in pairs or len(floors) != 1 or abs(contact.frame[2]) < UPRIGHT:
            continue
        body = int(model.geom_bodyid[next(geom for geom in pair if geom != floors[0])])
        joint = int(model.body_jntadr[model.body_rootid[body]])
        if joint >= 0 and model.jnt_type[joint] == FREE:
            address = int(model.jnt_qposadr[joint]) + 2
            heights[address] = max(heights.get(address, 0.0), -float(contact.dist))
    lifted = {address: model.key_qpos[key, address] + height for address, height in heights.items()}
    if not heights:
        return "only a floating body that penetrates a horizontal plane can be lifted"
    words = {address: number_word(round(height + 0.5 * 10**-DECIMALS, DECIMALS)) for address, height in lifted.items()}
    return words_fix(context, context.element("keyframe", key), "qpos", words, "key_qpos")


def inferred_inertia(context: LintContext, body: int) -> Fix | str:
    """Returns the fix that gives a body the inertia of its geoms, of which the mass is scaled to that of the body."""
    element = context.element("body", body)
    inertial = next((child for child in element.children if child.tag == "inertial"), None) if element else None
    model = _with_inferred_inertia(context, body)
    if inertial is None:
        return GENERATED
    if model is None or not model.body_mass[body] > 0:
        return "its geoms have no mass from which its inertia could be inferred"
    scale = context.model.body_mass[body] / model.body_mass[body]
    quat = model.body_iquat[body]
    values = {"pos": model.body_ipos[body], "diaginertia": scale * model.body_inertia[body]}
    values |= {} if np.allclose(quat, IDENTITY, atol=1e-9) else {"quat": quat}
    outdated = [name for name in (*ORIENTATIONS, "fullinertia") if name in inertial.attributes and name not in values]
    edits = [context.editor.without(inertial, name) for name in outdated]
    edits += [context.editor.with_value(inertial, name, _numbers(value)) for name, value in values.items()]
    return Fix(tuple(edits), ("body_inertia", "body_ipos", "body_iquat"))


def _with_inferred_inertia(context: LintContext, body: int) -> mujoco.MjModel | None:
    """Returns the model with the inertia of one body inferred from its geoms; None if they have none."""
    if context.spec is None:
        return None
    spec = context.spec.copy()
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
    changed = spec.bodies[[each.id for each in context.spec.bodies].index(body)]
    changed.explicitinertial, changed.mass, changed.inertia[:], changed.ipos[:] = False, 0, 0, np.nan
    try:
        return spec.compile()
    except ValueError:
        return None


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:.9g}" for value in values.tolist())
