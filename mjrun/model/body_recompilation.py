"""Compilation of a few bodies of a model, for overrides of numbers in them.

The compiler derives the numbers of a body, such as its inertia and the bounds of its geoms, from that body alone. The
numbers of the bodies that vary are therefore compiled without the rest of the model; `DerivedNumbers` then computes
what depends on several bodies.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from operator import attrgetter
from typing import Any

import mujoco
import numpy as np

from mjrun.errors import MjrunError
from mjrun.model.compilation import FAULTS
from mjrun.model.compiler_copied_fields import Rows
from mjrun.model.fields import arrays
from mjrun.model.mujoco_globals import without_log
from mjrun.model.override import ALTERNATIVES, ELEMENTS, ORIENTATIONS, Override, apply, elements_at
from mjrun.model.recompilation import sizes_of

# Parts of a body by the name of their count, and their lists in a body of MjSpec.
PARTS = {"njnt": "joints", "ngeom": "geoms", "nsite": "sites", "ncam": "cameras", "nlight": "lights"}
KINDS = ("body", "joint", "geom", "site", "camera", "light")
# Everything else in a model, which may refer to bodies.
REST = ("keys", "sensors", "actuators", "tendons", "equalities", "pairs", "excludes", "tuples", "numerics", "texts")
# Numbers of rigid bodies that follow from the whole model; `mj_setConst` computes them.
GLOBAL = ("body_subtreemass", "body_invweight0", "dof_invweight0", "dof_M0", "dof_length")
GLOBAL += ("cam_poscom0", "cam_pos0", "cam_mat0", "light_poscom0", "light_pos0", "light_dir0")
ROWS = ("nbody", "nv", "nq", "nbvhstatic", *PARTS)
MOST_BODIES = 0.5  # share of the bodies of a model, above which compiling all of it takes about the same time


class BodyCompiler:
    """The specification of a model, of which parts are compiled.

    Args:
      spec: the specification, already compiled.
      model: the model compiled from it.
      is_number: returns whether an override changes decimal numbers of elements.
    """

    def __init__(self, spec: mujoco.MjSpec, model: mujoco.MjModel, is_number: Callable[[Override], bool]) -> None:
        self._spec, self._model, self._is_number = spec, model, is_number
        # Contacts of pairs, soft bodies, skins and plugins depend on several bodies.
        self._is_rigid = not (model.npair or model.nflex or model.nskin or model.nplugin)
        self._owners: dict[str, frozenset[int] | None] = {}  # by the path of a field
        self._parts: dict[frozenset[int], _Part | None] = {}

    def changed(self, overrides: Sequence[Override]) -> dict[str, Rows] | None:
        """Returns the changed rows of each array and their values; None if the model must be compiled for them."""
        if not self._is_rigid:
            return None
        bodies = frozenset[int]()
        for override in overrides:
            owners = self._bodies(override)
            if owners is None:
                return None
            bodies |= owners
        if bodies not in self._parts:
            self._parts[bodies] = self._part(bodies)
        part = self._parts[bodies]
        return part.changed(overrides) if part else None

    def _bodies(self, override: Override) -> frozenset[int] | None:
        """Returns the ids of the bodies of the elements that an override changes; None if it changes others."""
        target = override.target
        if target not in self._owners:
            kind, _, rest = target.partition("/")
            is_named = not rest.removeprefix(f"{kind}:").partition(".")[0].isdigit()  # an index differs in a part
            self._owners[target] = None
            if kind in KINDS and is_named and self._is_number(override):
                elements, fields = elements_at(self._spec, override)
                if {*fields} & {*ALTERNATIVES, *ORIENTATIONS}:  # which change several fields
                    return None
                bodies = elements if kind == "body" else [element.parent for element in elements]
                self._owners[target] = frozenset(body.id for body in bodies)
        return self._owners[target]

    def _part(self, bodies: frozenset[int]) -> "_Part | None":
        if len(bodies) > MOST_BODIES * self._model.nbody:
            return None
        try:
            return _Part(self._spec, self._model, bodies)
        except (ValueError, MjrunError, *FAULTS):  # a camera that follows another body, for instance
            return None


class _Part:
    """Some bodies of a model.

    Raises:
      ValueError: they do not compile to the same numbers without the rest.
    """

    def __init__(self, spec: mujoco.MjSpec, model: mujoco.MjModel, bodies: frozenset[int]) -> None:
        self._spec, kept = _reduced(spec, bodies)
        first = self._compiled([])
        self._rows = dict(_matched_rows(model, first, sorted(bodies), kept))
        self._names = tuple(name for name in _numbers() if len(self._rows[arrays()[name].rows][0]))
        self._values = attrgetter(*self._names)
        self._whole_numbers = attrgetter(*(name for name in _whole_numbers() if getattr(first, name).size))
        self._structure = self._structure_of(first)
        values_of_first = self._values(first)
        self._first = [values.tobytes() for values in values_of_first]
        for name, values in zip(self._names, values_of_first, strict=True):
            whole, part = self._rows[arrays()[name].rows]
            if not np.array_equal(getattr(model, name)[whole], values[part], equal_nan=True):
                raise ValueError(name)

    def changed(self, overrides: Sequence[Override]) -> dict[str, Rows] | None:
        """Returns the changed rows of each array and their values; None if the structure changes."""
        try:
            compiled = self._compiled(overrides)
        except (MjrunError, *FAULTS):
            return None
        if self._structure_of(compiled) != self._structure:
            return None
        changed = dict[str, Rows]()
        for name, first, values in zip(self._names, self._first, self._values(compiled), strict=True):
            if first != values.tobytes():
                whole, part = self._rows[arrays()[name].rows]
                if not np.isfinite(values[part]).all():
                    return None
                changed[name] = whole, values[part]
        return changed

    def _structure_of(self, model: mujoco.MjModel) -> tuple[object, ...]:
        """Returns the sizes of a model and its arrays of whole numbers."""
        return (*sizes_of(model), b"".join([values.tobytes() for values in self._whole_numbers(model)]))

    def _compiled(self, overrides: Sequence[Override]) -> mujoco.MjModel:
        before = [*self._fields(overrides)]
        try:
            for override in overrides:
                apply(self._spec, override)
            with without_log():
                return self._spec.compile()
        finally:
            for element, field, value in before:
                setattr(element, field, value)

    def _fields(self, overrides: Sequence[Override]) -> Iterator[tuple[Any, str, Any]]:
        """Yields the elements that overrides change, the field, and a copy of its value."""
        for override in overrides:
            elements, (field,) = elements_at(self._spec, override)
            for element in elements:
                value = getattr(element, field)
                yield element, field, value if isinstance(value, float) else np.array(list(value))


def _reduced(spec: mujoco.MjSpec, bodies: frozenset[int]) -> tuple[mujoco.MjSpec, list[int]]:
    """Returns a copy of a specification with some bodies and the bare ones above them; and the ids of all of these."""
    small = spec.copy()
    for kind in KINDS:
        for index, element in enumerate(getattr(small, ELEMENTS[kind])):
            element.name = element.name or f"{kind}:{index}"  # by which overrides refer to it
    for elements in REST:
        for element in [*getattr(small, elements)]:
            small.delete(element)

    kept = {*bodies}
    for body in small.bodies:
        if body.id in bodies:
            kept |= {above.id for above in _above(body)}
    for body in [*small.bodies]:
        if body.id not in bodies and body.id in kept:
            for part in PARTS.values():
                for element in [*getattr(body, part)]:
                    small.delete(element)
    unused = [body for body in small.bodies if body.id not in kept and body.parent.id in kept]
    for body in unused:
        small.delete(body)
    for geom in small.geoms:
        geom.material = ""
    for site in small.sites:
        site.material = ""
    for element in [*small.materials, *small.textures]:
        small.delete(element)
    used = {geom.meshname for geom in small.geoms}
    for mesh in [*small.meshes]:
        if mesh.name not in used:
            small.delete(mesh)
    return small, sorted(kept)


def _above(body: Any) -> Iterator[Any]:
    while body.id:
        body = body.parent
        yield body


def _matched_rows(
    model: mujoco.MjModel, part: mujoco.MjModel, bodies: Sequence[int], kept: Sequence[int]
) -> Iterator[tuple[str, tuple[np.ndarray, np.ndarray]]]:
    """Yields, for each count of rows, the rows of `bodies` in the model, and in a part of it with the same order."""
    places = np.array([kept.index(body) for body in bodies], int)
    yield "nbody", (np.array(bodies, int), places)
    owners = {
        "njnt": model.jnt_bodyid,
        "ngeom": model.geom_bodyid,
        "nsite": model.site_bodyid,
        "ncam": model.cam_bodyid,
        "nlight": model.light_bodyid,
        "nv": model.dof_bodyid,
        "nq": np.repeat(model.jnt_bodyid, np.diff(model.jnt_qposadr, append=model.nq)),
    }
    for count, owner in owners.items():
        whole = np.flatnonzero(np.isin(owner, bodies))
        yield count, (whole, np.arange(len(whole)))
    yield "nbvhstatic", (_volumes(model, bodies), _volumes(part, places.tolist()))


def _volumes(model: mujoco.MjModel, bodies: Sequence[int]) -> np.ndarray:
    """Returns the rows of the bounding volumes of bodies."""
    starts, counts = model.body_bvhadr, model.body_bvhnum
    rows = [np.arange(starts[body], starts[body] + counts[body]) for body in bodies]
    return np.concatenate([np.empty(0, int), *rows])


@cache
def _numbers() -> tuple[str, ...]:
    """Returns the names of the arrays with numbers of bodies and of their parts that the compiler sets for each."""
    example = mujoco.MjSpec().compile()
    return tuple(
        name
        for name, field in arrays().items()
        if field.rows in ROWS and name not in GLOBAL and getattr(example, name).dtype.kind == "f"
    )


@cache
def _whole_numbers() -> tuple[str, ...]:
    """Returns the names of all arrays of a model that are not of decimal numbers."""
    example = mujoco.MjSpec().compile()
    of_model = [name for name in arrays() if isinstance(getattr(example, name), np.ndarray)]
    return tuple(name for name in of_model if getattr(example, name).dtype.kind != "f")
