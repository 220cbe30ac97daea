"""Columns without a field in MuJoCo: energies, speeds, momentum, contact sums.

All of them are computed from fields of one instant. Spatial velocities follow MuJoCo: `cvel` is rotation then
translation, in world orientation, at the centre of mass of the body's kinematic tree, so that a point p moves with
v + w × (p − com).
"""

from collections.abc import Callable, Mapping
from functools import cache

import mujoco
import numpy as np

from mjrun.model.names import PLACES, enum_members, names
from mjrun.model.table_column import Column
from mjrun.probe.contacts import ContactProbe, RecordedContacts
from mjrun.probe.fields import Fields, MjDataProbe, Probe, RecordedFieldProbe

WARNINGS = {
    "inertia": "near-singular inertia matrix",
    "contactfull": "no memory for contacts",
    "cnstrfull": "no memory for constraints",
    "badqpos": "position not finite or too large",
    "badqvel": "velocity not finite or too large",
    "badqacc": "acceleration not finite or too large",
    "badctrl": "control not finite or too large",
}


def energy(model: mujoco.MjModel) -> RecordedFieldProbe:
    """Measures potential, kinetic and total energy, and the total's drift since the start of the simulation [J]."""

    def compute(fields: Fields, initial: Fields) -> np.ndarray:
        parts, first = fields["energy"], initial["energy"].sum(axis=-1)
        total = parts.sum(axis=-1)
        return np.concatenate([parts, total[..., None], (total - first)[..., None]], axis=-1)

    meanings = ("potential energy", "kinetic energy", "potential + kinetic", "total energy less that of the first row")
    parts = ("potential", "kinetic", "total", "drift")
    columns = [Column(f"energy/{part}", "J", meaning) for part, meaning in zip(parts, meanings, strict=True)]
    return RecordedFieldProbe(columns, ("energy",), compute, relative=("energy/drift",))


def contact(model: mujoco.MjModel) -> RecordedFieldProbe:
    """Measures the number of contacts."""
    column = Column("contact/ncon", "", "number of detected contacts")
    return RecordedFieldProbe(
        [column], ("ncon",), lambda fields, initial: fields["ncon"][..., None].astype(float), places=[0]
    )


def solver(model: mujoco.MjModel) -> RecordedFieldProbe:
    """Measures iterations of the constraint solver, over all islands, and the number of constraints."""
    columns = [Column("solver/niter", "", "solver iterations, all islands"), Column("solver/nefc", "", "constraints")]

    def compute(fields: Fields, initial: Fields) -> np.ndarray:
        return np.stack([fields["solver_niter"].sum(axis=-1), fields["nefc"]], axis=-1).astype(float)

    return RecordedFieldProbe(columns, ("solver_niter", "nefc"), compute)


def speed(model: mujoco.MjModel) -> RecordedFieldProbe:
    """Measures the speed of the origin of every body, geom and site [m/s]."""
    owners = [("body", i, i) for i in range(model.nbody)]
    owners += [("geom", i, int(body)) for i, body in enumerate(model.geom_bodyid)]
    owners += [("site", i, int(body)) for i, body in enumerate(model.site_bodyid)]
    bodies = np.array([body for _, _, body in owners], int)
    roots = model.body_rootid[bodies]
    known = {kind: names(model, kind) for kind in PLACES}
    taken: set[str] = set()
    columns = []
    for kind, index, _ in owners:
        name = known[kind][index]
        shown = f"speed/{name}" if name not in taken else f"speed/{kind}:{name}"
        taken.add(name)
        columns.append(Column(shown, "m/s", f"speed of the origin of this {kind}", kind, index))

    def compute(fields: Fields, initial: Fields) -> np.ndarray:
        points = np.concatenate([fields[name] for name in PLACES.values()], axis=-2)
        return np.linalg.norm(_velocity(fields, bodies, roots, points), axis=-1)

    return RecordedFieldProbe(columns, ("cvel", "subtree_com", *PLACES.values()), compute)


def com(model: mujoco.MjModel) -> RecordedFieldProbe:
    """Measures the centre of mass of the whole model [m], world included."""
    columns = [Column(f"com/{axis}", "m", "centre of mass of the model") for axis in "xyz"]
    return RecordedFieldProbe(
        columns, ("subtree_com",), lambda fields, initial: fields["subtree_com"][..., 0, :], places=range(3)
    )


def momentum(model: mujoco.MjModel) -> RecordedFieldProbe:
    """Measures linear momentum, and angular momentum about the centre of mass, of the whole model."""
    mass, inertia = model.body_mass, model.body_inertia
    columns = [Column(f"momentum/p{axis}", "kg·m/s", "linear momentum") for axis in "xyz"]
    columns += [Column(f"momentum/l{axis}", "kg·m²/s", "angular momentum about the centre of mass") for axis in "xyz"]
    bodies = np.arange(model.nbody)

    def compute(fields: Fields, initial: Fields) -> np.ndarray:
        centres = fields["xipos"]
        velocity = _velocity(fields, bodies, model.body_rootid, centres)
        linear = mass[:, None] * velocity
        arm = centres - fields["subtree_com"][..., :1, :]
        frames = fields["ximat"].reshape(*centres.shape, 3)
        spin = np.einsum("...ji,...j->...i", frames, fields["cvel"][..., :3])  # in the inertia's own axes
        angular = np.einsum("...ij,...j->...i", frames, inertia * spin) + np.cross(arm, linear)
        return np.concatenate([linear.sum(axis=-2), angular.sum(axis=-2)], axis=-1)

    return RecordedFieldProbe(columns, ("cvel", "subtree_com", "xipos", "ximat"), compute, reads_model=True)


def contact_force(model: mujoco.MjModel) -> ContactProbe:
    """Measures the sum over all contacts of the normal and of the friction force, world frame [N].

    Each contact counts with the force that acts on its second geom, which is the one above on a floor.
    """
    meaning = "sum of the {} forces on the second geom of each contact"
    columns = [
        Column(f"contact_force/{part}/{axis}", "N", meaning.format(part))
        for part in ("normal", "friction")
        for axis in "xyz"
    ]

    def compute(contacts: RecordedContacts) -> np.ndarray:
        frames, wrenches = contacts.contact_frames, contacts.wrenches
        friction = (frames[:, 1:].swapaxes(1, 2) @ wrenches[:, 1:3, None])[..., 0]
        sums = np.zeros((len(contacts.counts), 6))
        np.add.at(sums, contacts.instants, np.column_stack([frames[:, 0] * wrenches[:, :1], friction]))
        return sums

    return ContactProbe.of(columns, compute)


def penetration(model: mujoco.MjModel) -> ContactProbe:
    """Measures the depth of the deepest contact [m]; 0 without contacts."""
    column = Column("penetration/deepest", "m", "depth of the deepest contact")

    def compute(contacts: RecordedContacts) -> np.ndarray:
        deepest = np.zeros(len(contacts.counts))
        np.maximum.at(deepest, contacts.instants, 0 - contacts.fields["dist"])  # never -0.0
        return deepest[:, None]

    return ContactProbe.of([column], compute)


def warning(model: mujoco.MjModel) -> MjDataProbe:
    """Measures the number of MuJoCo's warnings of each kind, up to this instant."""
    kinds = enum_members(mujoco.mjtWarning)
    columns = [Column(f"warning/{kind}", "", f"MuJoCo's warnings so far: {WARNINGS[kind]}") for kind in kinds]
    index = np.array([*kinds.values()])

    def bind(model: mujoco.MjModel, data: mujoco.MjData) -> Callable[[], np.ndarray]:
        numbers = data.warning.number
        return lambda: numbers[index].astype(float)

    return MjDataProbe(columns, bind)


DERIVED: dict[str, Callable[[mujoco.MjModel], Probe]] = {
    probe.__name__: probe
    for probe in (energy, contact, solver, speed, com, momentum, contact_force, penetration, warning)
}


@cache
def derived_units() -> Mapping[str, str]:
    """Returns the unit of each group of derived columns whose columns all have the same one."""
    model = mujoco.MjSpec().compile()
    units = {name: {column.unit for column in probe(model).columns} for name, probe in DERIVED.items()}
    return {name: unit for name, (unit, *others) in units.items() if not others}


def _velocity(fields: Fields, bodies: np.ndarray, roots: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Returns the velocity of `points` `(…, k, 3)`, each fixed to a body; world frame [m/s]."""
    twist, com = fields["cvel"][..., bodies, :], fields["subtree_com"][..., roots, :]
    return twist[..., 3:] + np.cross(twist[..., :3], points - com)
