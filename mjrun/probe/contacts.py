"""Contacts: copied at each instant in one piece, then counted between two objects, or listed with their forces.

The table has a row for each contact of an instant. Forces and torques are those that geom1 exerts on geom2, as
`mj_contactForce` computes them, to the last bit. The normal points from geom1 to geom2, so that repulsion is positive
along it. Torques are about the contact point. The contact frame is the normal and the two tangents that follow it in
`mjContact.frame`.
"""

import ctypes
from collections.abc import Callable, Sequence
from functools import cache, cached_property
from typing import Any, NamedTuple

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UnknownNameError, UsageError, clean, quoted
from mjrun.model.fields import carriers
from mjrun.model.names import identify, names
from mjrun.model.table_column import Column
from mjrun.probe.fields import MjDataProbe

ELLIPTIC = int(mujoco.mjtCone.mjCONE_ELLIPTIC)
NUMPY_TYPES = {"mjtNum": "f8", "int": "i4"}
FRAME, WORLD = ("normal", "tangent1", "tangent2"), ("x", "y", "z")
ACTION = "{} that geom1 exerts on geom2, {} frame"
TORQUE = "torque about the contact point"
# Kinds of objects that touch: a bare name is searched in this order, a flex is `flex:NAME` only.
PARTIES, FLEX = ("body", "geom"), "flex"


class ContactCopiers(NamedTuple):
    """Functions that copy the present contacts in an MjData: the bytes of `mjContact` structures and of `efc_force`."""

    structures: Callable[[], bytes]
    forces: Callable[[], bytes]


def contact_copiers(data: mujoco.MjData) -> ContactCopiers:
    """Returns functions that copy the present contacts in `data`."""
    size, arena = _layout().itemsize, b""

    def structures() -> bytes:
        nonlocal arena
        count = data.ncon
        if count and not arena:  # the memory of a step, which contacts begin, and which stays at one address
            first = ctypes.c_double.from_buffer(data.contact.dist[:1])
            arena = (ctypes.c_char * data.narena).from_address(ctypes.addressof(first))
        return arena[: count * size]

    return ContactCopiers(structures, lambda: data.efc_force.tobytes())


class RecordedContacts:
    """The contacts of n instants, m in all, in MuJoCo's order.

    Args:
      structures, forces: copies made by `ContactCopiers` at each instant.

    Attributes:
      counts: the number of contacts at each instant, `(n,)`.
      instants: the instant of each contact, `(m,)`.
      fields: `mjContact` structures as a structured array, `(m,)`.
    """

    def __init__(self, model: mujoco.MjModel, structures: Sequence[bytes], forces: Sequence[bytes]) -> None:
        self._model, self._forces = model, forces
        self.fields = np.frombuffer(b"".join(structures), _layout())
        self.counts = np.array([*map(len, structures)], int) // _layout().itemsize
        self.instants = np.repeat(np.arange(len(structures)), self.counts)

    @classmethod
    def of(cls, model: mujoco.MjModel, data: mujoco.MjData) -> "RecordedContacts":
        """Returns the contacts of the instant in `data`."""
        structures, forces = contact_copiers(data)
        return cls(model, [structures()], [forces()])

    @property
    def indices(self) -> np.ndarray:
        """The index of each contact within its instant, `(m,)`."""
        ends = np.cumsum(self.counts)
        return np.arange(len(self.fields)) - np.repeat(ends - self.counts, self.counts)

    @property
    def contact_frames(self) -> np.ndarray:
        """Contact frames `(m, 3, 3)`; their rows are the normal and two tangents."""
        return self.fields["frame"].reshape(-1, 3, 3)

    @cached_property
    def things(self) -> np.ndarray:
        """The geoms that touch, or flexes, counted after all geoms: `(m, 2)`."""
        geom, flex = self.fields["geom"], self.fields["flex"]
        return np.where(geom < 0, self._model.ngeom + flex, geom)

    @cached_property
    def bodies(self) -> np.ndarray:
        """The bodies that touch, −1 for none: `(m, 2)`."""
        model, geom, vert = self._model, self.fields["geom"], self.fields["vert"]
        bodies = np.full(geom.shape, -1)
        rigid, soft = geom >= 0, vert >= 0
        bodies[rigid] = model.geom_bodyid[geom[rigid]]
        bodies[soft] = model.flex_vertbodyid[model.flex_vertadr[self.fields["flex"][soft]] + vert[soft]]
        return bodies

    @cached_property
    def wrenches(self) -> np.ndarray:
        """Forces and torques in the contact frames, `(m, 6)` [N, N·m]; zeros for a contact without a constraint.

        The normal force is what the solver found minus the pull of adhesive geoms.
        """
        forces = np.frombuffer(b"".join(self._forces))
        ends = np.cumsum([*map(len, self._forces)]) // forces.itemsize
        starts = np.concatenate([[0], ends[:-1]])[self.instants]
        address, dims = self.fields["efc_address"], self.fields["dim"]
        wrenches = np.zeros((len(dims), 6))
        for dim in sorted(set(dims.tolist())):  # `np.unique` imports numpy.ma first
            chosen = np.flatnonzero((address >= 0) & (dims == dim))
            first = (starts[chosen] + address[chosen])[:, None]
            if dim == 1 or self._model.opt.cone == ELLIPTIC:
                wrenches[chosen, :dim] = forces[first + np.arange(dim)]
                continue
            edges = forces[first + np.arange(2 * (dim - 1))]  # two opposite edges of the pyramid for each direction
            normal = np.zeros(len(chosen))
            for edge in np.ascontiguousarray(edges.T):
                normal += edge
            wrenches[chosen, 0] = normal
            wrenches[chosen, 1:dim] = (edges[:, ::2] - edges[:, 1::2]) * self.fields["friction"][chosen, : dim - 1]
        wrenches[:, 0] -= np.where(address >= 0, self.fields["adhesion"], 0)
        return wrenches


@dataclass(frozen=True)
class ContactProbe(MjDataProbe):
    """A probe whose columns are computed from contacts, for any number of instants at once.

    Attributes:
      compute: returns `(n, len(columns))`, given the contacts of n instants.
    """

    compute: Callable[[RecordedContacts], np.ndarray]

    @classmethod
    def of(cls, columns: Sequence[Any], compute: Callable[[RecordedContacts], np.ndarray]) -> "ContactProbe":
        """Returns the probe, which can also be measured on a single MjData."""

        def bind(model: mujoco.MjModel, data: mujoco.MjData) -> Callable[[], np.ndarray]:
            return lambda: compute(RecordedContacts.of(model, data))[0]

        return cls(columns, bind, compute)

    def only(self, indices: Sequence[int]) -> "ContactProbe":
        """Returns the probe with only these of its columns."""
        index, compute = np.array(indices, int), self.compute
        return ContactProbe.of([self.columns[i] for i in indices], lambda contacts: compute(contacts)[:, index])


@cache
def _layout() -> np.dtype[Any]:
    """Returns the layout of an `mjContact` structure."""
    from mujoco.introspect import structs

    fields: Any = structs.STRUCTS["mjContact"].fields
    parts: list[tuple[str, str, tuple[int, ...]]] = []
    for field in fields:
        extents = getattr(field.type, "extents", ())
        kind = field.type.inner_type if extents else field.type
        parts.append((field.name, NUMPY_TYPES[str(kind)], tuple(extents)))
    return np.dtype(parts, align=True)


def contact_columns(model: mujoco.MjModel) -> list[Column]:
    """Returns the columns of `contact_rows`: time first; geoms and bodies are indices into their labels.

    A flex is `flex/cloth`, or `flex:0` without a name. It has a body only if the contact is at a vertex with a body.
    """
    flexes = (mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_FLEX, i) for i in range(model.nflex))
    touching = (*names(model, "geom"), *(f"flex/{name}" if name else f"flex:{i}" for i, name in enumerate(flexes)))
    touching = touching or ("",)  # text columns even if nothing can touch
    bodies = tuple(names(model, "body"))
    return [
        Column("time", "s", "simulated time, exact"),
        Column("contact", "", "index of the contact within its instant"),
        *(Column(f"geom{i}", "", "geom or flex; the normal points from geom1 to geom2", labels=touching) for i in "12"),
        *(Column(f"body{i}", "", f"body of geom{i}", labels=bodies) for i in "12"),
        Column("dist", "m", "distance between the two; negative is penetration"),
        *(Column(f"pos/{part}", "m", "contact point, world frame") for part in WORLD),
        *(Column(f"normal/{part}", "", "direction from geom1 to geom2, world frame") for part in WORLD),
        *(Column(f"force/{part}", "N", ACTION.format("force", "contact")) for part in FRAME),
        *(Column(f"torque/{part}", "N·m", ACTION.format(TORQUE, "contact")) for part in FRAME),
        *(Column(f"world_force/{part}", "N", ACTION.format("force", "world")) for part in WORLD),
        *(Column(f"world_torque/{part}", "N·m", ACTION.format(TORQUE, "world")) for part in WORLD),
    ]


def contact_rows(contacts: RecordedContacts, times: np.ndarray) -> np.ndarray:
    """Returns a row for each contact: `(m, len(contact_columns(model)))` float64.

    A contact without a constraint, as in the gap or for lack of memory, has no force.

    Args:
      times: times of the instants `(n,)` [s].
    """
    frames, wrenches = contacts.contact_frames, contacts.wrenches
    world = wrenches.reshape(-1, 2, 3) @ frames
    parts = (
        times[contacts.instants],
        contacts.indices,
        contacts.things,
        contacts.bodies,
        contacts.fields["dist"],
        contacts.fields["pos"],
        frames[:, 0],
        wrenches,
        world.reshape(-1, 6),
    )
    return np.column_stack(parts)


def identify_party(text: str, model: mujoco.MjModel) -> tuple[str, int]:
    """Returns kind and id of the body, or else geom, called `text`, or of `body:NAME`, `geom:NAME` or `flex:NAME`.

    Raises:
      UnknownNameError: the object does not exist; the message lists the valid names.
    """
    kind, colon, name = text.partition(":")
    if colon and kind in (*PARTIES, FLEX):
        return kind, identify(model, kind, name)
    known = {kind: names(model, kind) for kind in PARTIES}
    for kind in PARTIES:
        if text in known[kind]:
            return kind, known[kind].index(text)
    flexes = [f"{FLEX}:{name.removeprefix(f'{FLEX}:')}" for name in names(model, FLEX)]
    valid = list(dict.fromkeys([*known["body"], *known["geom"], *flexes]))
    plural = "bodies, geoms and flexes" if flexes else "bodies and geoms"
    meant = [flex for flex in flexes if flex == f"{FLEX}:{text}"]
    raise UnknownNameError("object", text, valid, plural=plural, meant=meant)


def pair(text: str, model: mujoco.MjModel) -> ContactProbe:
    """Returns the probe of the number of contacts between two objects, `A/B`, in either order.

    A body includes its geoms and those of all bodies below it, so that `world` is everything. A contact counts, once,
    if one side of it belongs to A and the other to B; it may lack a force, as in the gap. A flex belongs to a body if
    all of its vertices are below that body. If only some are, contacts at those vertices count for the body, and
    contacts within elements do not.

    Raises:
      UnknownNameError: an object does not exist; the message lists the valid names.
      UsageError: `A/B` can be read in two ways.
    """
    first, second = _split(text, model)
    one, other = _party(model, first), _party(model, second)

    def compute(contacts: RecordedContacts) -> np.ndarray:
        sides = contacts.things, contacts.bodies
        between = (one.has(*sides) & other.has(*sides)[:, ::-1]).any(axis=1)
        numbers = np.bincount(contacts.instants[between], minlength=len(contacts.counts))
        return numbers[:, None].astype(float)

    meaning = f"number of contacts between {quoted(first)} and {quoted(second)}"
    return ContactProbe.of([Column(f"contact/{text}", "", meaning)], compute)


@dataclass(frozen=True)
class _Party:
    """The parts of an object that touches.

    Attributes:
      things: whether each geom, and then each flex, belongs to it, `(ngeom + nflex,)`.
      bodies: whether each body belongs to it, `(nbody + 1,)`; the last entry means no body.
    """

    things: np.ndarray
    bodies: np.ndarray

    def has(self, things: np.ndarray, bodies: np.ndarray) -> np.ndarray:
        """Returns whether each side of contacts belongs to it; all are `(ncon, 2)`."""
        return self.things[things] | self.bodies[bodies]


def _party(model: mujoco.MjModel, text: str) -> _Party:
    kind, index = identify_party(text, model)
    things, bodies = np.zeros(model.ngeom + model.nflex, bool), np.zeros(model.nbody + 1, bool)
    if kind != "body":
        things[index if kind == "geom" else model.ngeom + index] = True
        return _Party(things, bodies)
    bodies[index] = True
    for body in range(index + 1, model.nbody):  # parents come first
        bodies[body] = bodies[model.body_parentid[body]]
    for flex in range(model.nflex):
        things[model.ngeom + flex] = bodies[carriers(model, flex)].all()
    return _Party(things, bodies)


def _split(text: str, model: mujoco.MjModel) -> tuple[str, str]:
    """Returns the two objects of `A/B`; their names may contain slashes."""
    cuts = [index for index, character in enumerate(text) if character == "/"]
    splits = [(text[:cut], text[cut + 1 :]) for cut in cuts]
    if not splits:
        raise UnknownNameError("column", f"contact/{text}", ["contact/ncon", "contact/A/B"])
    known = [sum(_is_party(part, model) for part in split) for split in splits]
    best = splits[known.index(max(known))]
    if known.count(2) > 1:
        ways = " or ".join(f"{quoted(a)} and {quoted(b)}" for (a, b), n in zip(splits, known, strict=True) if n == 2)
        raise UsageError(
            f"contact/{clean(text)} may be {ways}\n`body:NAME` and `geom:NAME` show where the name of an object begins"
        )
    for part in best:
        identify_party(part, model)
    return best


def _is_party(text: str, model: mujoco.MjModel) -> bool:
    try:
        identify_party(text, model)
    except UnknownNameError:
        return False
    return True
