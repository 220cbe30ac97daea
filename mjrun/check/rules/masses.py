"""Masses and inertias that make a model move other than meant, or badly conditioned."""

from collections.abc import Iterator

import mujoco
import numpy as np

from mjrun.check.context import LintContext
from mjrun.check.finding import Sighting
from mjrun.check.rules.unnamed import flex_bodies
from mjrun.errors import quoted

# Double precision has 16 digits; factoring the inertia matrix costs as many as its condition number has.
FLATTEST = 1e6  # largest to smallest principal inertia; a rod of 1 m by 1 mm has 3e5
STEEPEST = 1e9  # largest to smallest inertia of joints of one kind in one tree
MASSLESS_KINDS = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))


def weightless(subject: LintContext) -> Iterator[Sighting]:
    """Geoms that collide, belong to a body that moves and takes its mass from its geoms, and have none."""
    model, spec = subject.model, subject.spec
    if spec is None:
        return
    inferred = {b.id for b in spec.bodies if not b.explicitinertial}
    if spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE:
        inferred = {b.id for b in spec.bodies}
    for geom in spec.geoms:
        if not 0 <= geom.id < model.ngeom or model.geom_type[geom.id] in MASSLESS_KINDS:
            continue
        body = int(model.geom_bodyid[geom.id])
        moves = model.body_weldid[body] != 0
        collides = model.geom_contype[geom.id] or model.geom_conaffinity[geom.id]
        if moves and collides and body in inferred and 0 in (geom.mass, geom.density if np.isnan(geom.mass) else 1):
            message = f"it collides, and adds no mass to {quoted(subject.name('body', body))}"
            remedy = 'give it a density or mass; or contype="0" conaffinity="0" if it is only to be seen'
            yield Sighting(message, remedy, subject.object("geom", geom.id), subject.place("geom", geom.id))


def flat(subject: LintContext) -> Iterator[Sighting]:
    """Bodies that turn and have next to no inertia about one axis."""
    model = subject.model
    made = flex_bodies(model)
    for body in range(1, model.nbody):
        low, high = model.body_inertia[body].min(), model.body_inertia[body].max()
        if body in made or not model.body_dofnum[body] or high <= FLATTEST * low:
            continue
        message = f"its principal inertias, {low:.3g} and {high:.3g} kg m², differ by a factor of {_ratio(high, low)}"
        remedy = "make its geoms less thin, or give it <inertial diaginertia=…>, or its joints some armature"
        yield Sighting(message, remedy, subject.object("body", body), subject.place("body", body))


def steep(subject: LintContext) -> Iterator[Sighting]:
    """Trees whose joints move inertias of very different size, which costs digits in every step."""
    model = subject.model
    for tree in range(model.ntree):
        of_tree = np.flatnonzero(model.dof_treeid == tree)
        for turns in (False, True):
            dofs = np.array([d for d in map(int, of_tree) if _turns(model, d) == turns], int)
            inertia = model.dof_M0[dofs]
            if dofs.size < 2 or inertia.max() <= STEEPEST * inertia.min():
                continue
            light, heavy = (int(model.dof_jntid[dofs[i]]) for i in (inertia.argmin(), inertia.argmax()))
            unit = "kg m²" if turns else "kg"
            message = (
                f"it moves {inertia.min():.3g} {unit}, and {subject.object('joint', heavy)} of the same tree "
                f"{inertia.max():.3g} {unit}: a factor of {_ratio(inertia.max(), inertia.min())}"
            )
            remedy = "give the light joint some armature, or check the masses and their unit, kg"
            yield Sighting(message, remedy, subject.object("joint", light), subject.place("joint", light))


def _turns(model: mujoco.MjModel, dof: int) -> bool:
    joint = model.dof_jntid[dof]
    kind = int(model.jnt_type[joint])
    if kind == mujoco.mjtJoint.mjJNT_FREE:
        return dof - model.jnt_dofadr[joint] > 2
    return kind != mujoco.mjtJoint.mjJNT_SLIDE


def _ratio(high: float, low: float) -> str:
    return f"{high / low:.2g}" if low > 0 else "infinity"
