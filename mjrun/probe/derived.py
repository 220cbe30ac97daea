"""Columns that MuJoCo has no field for: energies, speeds, momentum, contact sums.

All of them are computed from fields of one instant. Spatial velocities follow MuJoCo: `cvel` is rotation
then translation, in world orientation, at the centre of mass of the body's kinematic tree, so a point p
moves with v + w × (p − com).
"""

from collections.abc import Callable

import mujoco
import numpy as np

from mjrun.model.column import Column
from mjrun.model.names import members, names
from mjrun.probe.fields import Probe, Recording, instant_only

POSITIONS = {"body": "xpos", "geom": "geom_xpos", "site": "site_xpos"}
WARNINGS = {
    "inertia": "near-singular inertia matrix",
    "contactfull": "no memory for contacts",
    "cnstrfull": "no memory for constraints",
    "badqpos": "position not finite or too large",
    "badqvel": "velocity not finite or too large",
    "badqacc": "acceleration not finite or too large",
    "badctrl": "control not finite or too large",
}


def energy(model: mujoco.MjModel) -> Probe:
    """Potential, kinetic and total energy, and the total's drift from the first row [J]."""
    first: list[float] = []

    def compute(record: Recording) -> np.ndarray:
        total = record["energy"].sum(axis=1)
        if not first:
            first.append(float(total[0]))
        return np.column_stack([record["energy"], total, total - first[0]])

    meanings = ("potential energy", "kinetic energy", "potential + kinetic", "total energy less that of the first row")
    parts = ("potential", "kinetic", "total", "drift")
    columns = [Column(f"energy/{part}", "J", meaning) for part, meaning in zip(parts, meanings, strict=True)]
    return Probe(columns, ("energy",), compute)


def counts(model: mujoco.MjModel) -> Probe:
    """The number of contacts."""
    column = Column("contact/ncon", "", "number of detected contacts")
    return Probe([column], ("ncon",), lambda record: record["ncon"].reshape(-1, 1).astype(float))


def solver(model: mujoco.MjModel) -> Probe:
    """Iterations of the constraint solver, over all islands, and the number of constraints."""
    columns = [Column("solver/niter", "", "solver iterations, all islands"), Column("solver/nefc", "", "constraints")]

    def compute(record: Recording) -> np.ndarray:
        iterations = record["solver_niter"].reshape(len(record["nefc"]), -1).sum(axis=1)
        return np.column_stack([iterations, record["nefc"].reshape(-1)]).astype(float)

    return Probe(columns, ("solver_niter", "nefc"), compute)


def speed(model: mujoco.MjModel) -> Probe:
    """How fast the origin of every body, geom and site moves [m/s]."""
    owners = [("body", i, i) for i in range(model.nbody)]
    owners += [("geom", i, int(body)) for i, body in enumerate(model.geom_bodyid)]
    owners += [("site", i, int(body)) for i, body in enumerate(model.site_bodyid)]
    bodies = np.array([body for _, _, body in owners], int)
    roots = model.body_rootid[bodies]
    known = {kind: names(model, kind) for kind in POSITIONS}
    taken: set[str] = set()
    columns = []
    for kind, index, _ in owners:
        name = known[kind][index]
        shown = f"speed/{name}" if name not in taken else f"speed/{kind}:{name}"
        taken.add(name)
        columns.append(Column(shown, "m/s", f"speed of the origin of this {kind}", kind, index))

    def compute(record: Recording) -> np.ndarray:
        points = np.concatenate([record[field] for field in POSITIONS.values()], axis=1)
        return np.linalg.norm(_velocity(record, bodies, roots, points), axis=2)

    return Probe(columns, ("cvel", "subtree_com", *POSITIONS.values()), compute)


def com(model: mujoco.MjModel) -> Probe:
    """The centre of mass of everything that is in the model [m], world included."""
    columns = [Column(f"com/{axis}", "m", "centre of mass of the model") for axis in "xyz"]
    return Probe(columns, ("subtree_com",), lambda record: record["subtree_com"][:, 0])


def momentum(model: mujoco.MjModel) -> Probe:
    """Linear momentum, and angular momentum about the centre of mass, of the whole model."""
    mass, inertia = model.body_mass, model.body_inertia
    columns = [Column(f"momentum/p{axis}", "kg·m/s", "linear momentum") for axis in "xyz"]
    columns += [Column(f"momentum/l{axis}", "kg·m²/s", "angular momentum about the centre of mass") for axis in "xyz"]
    bodies = np.arange(model.nbody)

    def compute(record: Recording) -> np.ndarray:
        centres = record["xipos"]
        velocity = _velocity(record, bodies, model.body_rootid, centres)
        linear = mass[:, None] * velocity
        arm = centres - record["subtree_com"][:, :1]
        frames = record["ximat"].reshape(len(centres), -1, 3, 3)
        spin = np.einsum("nbji,nbj->nbi", frames, record["cvel"][..., :3])  # in the inertia's own axes
        angular = np.einsum("nbij,nbj->nbi", frames, inertia * spin) + np.cross(arm, linear)
        return np.concatenate([linear.sum(axis=1), angular.sum(axis=1)], axis=1)

    return Probe(columns, ("cvel", "subtree_com", "xipos", "ximat"), compute)


def contact_force(model: mujoco.MjModel) -> Probe:
    """The sum over all contacts of the normal and of the friction force, world frame [N].

    Each contact counts with the force that acts on its second geom, which is the one above on a floor.
    """
    meaning = "sum of the {} forces on the second geom of each contact"
    columns = [
        Column(f"contact_force/{part}/{axis}", "N", meaning.format(part))
        for part in ("normal", "friction")
        for axis in "xyz"
    ]

    def at(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
        sums, wrench = np.zeros((2, 3)), np.zeros(6)
        for index in range(data.ncon):
            mujoco.mj_contactForce(model, data, index, wrench)
            frame = data.contact[index].frame.reshape(3, 3)  # rows: normal, two tangents
            sums[0] += frame[0] * wrench[0]
            sums[1] += frame[1:].T @ wrench[1:3]
        return sums.ravel()

    return Probe(columns, (), instant_only, at)


def penetration(model: mujoco.MjModel) -> Probe:
    """How deep the deepest contact penetrates [m]; 0 without one."""
    column = Column("penetration/deepest", "m", "depth of the deepest contact")

    def at(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
        return np.array([max([0.0, *(-data.contact.dist)])])

    return Probe([column], (), instant_only, at)


def warning(model: mujoco.MjModel) -> Probe:
    """How often MuJoCo has warned, of each kind, up to this instant."""
    kinds = members(mujoco.mjtWarning)
    columns = [Column(f"warning/{kind}", "", f"MuJoCo's warnings so far: {WARNINGS[kind]}") for kind in kinds]
    index = list(kinds.values())

    def at(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
        return np.array([data.warning[kind].number for kind in index], float)

    return Probe(columns, (), instant_only, at)


DERIVED: dict[str, Callable[[mujoco.MjModel], Probe]] = {
    "energy": energy,
    "contact": counts,
    "solver": solver,
    "speed": speed,
    "com": com,
    "momentum": momentum,
    "contact_force": contact_force,
    "penetration": penetration,
    "warning": warning,
}


def _velocity(record: Recording, bodies: np.ndarray, roots: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The velocity of `points` `(n, k, 3)`, each fixed to a body; world frame [m/s]."""
    twist, com = record["cvel"][:, bodies], record["subtree_com"][:, roots]
    return twist[..., 3:] + np.cross(twist[..., :3], points - com)
