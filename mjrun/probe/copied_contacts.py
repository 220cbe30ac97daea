"""Contacts of many instants: copied at each instant in one piece, and evaluated together.

`mj_contactForce` is called once per contact; here the forces of all contacts are decoded at once, bit for bit the same.
"""

import ctypes
from collections.abc import Callable, Sequence
from functools import cache, cached_property
from typing import Any, NamedTuple

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.probe.fields import InstantProbe

ELLIPTIC = int(mujoco.mjtCone.mjCONE_ELLIPTIC)
NUMPY_TYPES = {"mjtNum": "f8", "int": "i4"}


class CopiedContacts(NamedTuple):
    """The contacts of one instant: copies of the bytes of its `mjContact` structures and of `efc_force`."""

    structures: bytes
    forces: bytes


def copy_contacts(data: mujoco.MjData) -> CopiedContacts:
    """Copies the contacts in `data`."""
    return contact_copier(data)()


def contact_copier(data: mujoco.MjData) -> Callable[[], CopiedContacts]:
    """Returns a function that copies the present contacts in `data`."""
    size, address = _layout().itemsize, 0

    def copy() -> CopiedContacts:
        nonlocal address
        count = data.ncon
        if count and not address:  # contacts come first in the memory of a step, and stay at one address
            address = ctypes.addressof(ctypes.c_double.from_buffer(data.contact.dist[:1]))
        return CopiedContacts(ctypes.string_at(address, count * size), data.efc_force.tobytes())

    return copy


class RecordedContacts:
    """The contacts of n instants, m in all, in MuJoCo's order.

    Attributes:
      counts: the number of contacts at each instant, `(n,)`.
      instants: the instant of each contact, `(m,)`.
      fields: `mjContact` structures as a structured array, `(m,)`.
    """

    def __init__(self, model: mujoco.MjModel, copies: Sequence[CopiedContacts]) -> None:
        self._model, self._copies = model, copies
        self.fields = np.frombuffer(b"".join([copy.structures for copy in copies]), _layout())
        self.counts = np.array([len(copy.structures) // _layout().itemsize for copy in copies], int)
        self.instants = np.repeat(np.arange(len(copies)), self.counts)

    @property
    def indices(self) -> np.ndarray:
        """The index of each contact within its instant, `(m,)`."""
        ends = np.cumsum(self.counts)
        return np.arange(len(self.fields)) - np.repeat(ends - self.counts, self.counts)

    @property
    def frames(self) -> np.ndarray:
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
        """Forces and torques in the contact frames, `(m, 6)` [N, N·m]; zeros for a contact without a constraint."""
        forces = np.frombuffer(b"".join([copy.forces for copy in self._copies]))
        ends = np.cumsum([len(copy.forces) // forces.itemsize for copy in self._copies])
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
        return wrenches


@dataclass(frozen=True)
class ContactProbe(InstantProbe):
    """Columns that are computed from contacts, for any number of instants at once.

    Attributes:
      compute: returns `(n, len(columns))`, given the contacts of n instants.
    """

    compute: Callable[[RecordedContacts], np.ndarray]

    @classmethod
    def of(cls, columns: Sequence[Any], compute: Callable[[RecordedContacts], np.ndarray]) -> "ContactProbe":
        """Returns the probe, which can also be measured on a single MjData."""

        def measure(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
            return compute(RecordedContacts(model, [copy_contacts(data)]))[0]

        return cls(columns, measure, compute)

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
