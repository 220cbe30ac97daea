"""Recompilation of a model with other numbers, from a specification that is parsed once.

The specification is compiled without its images, whose bytes nothing else in a model depends on, and the result is
written over a copy of the model that has them.

The compiler derives the numbers of a body, such as its inertia and the bounds of its geoms, from that body alone. Where
only numbers of a few bodies vary, these are therefore compiled without the rest of the model; `DerivedNumbersComputer`
then computes what depends on several bodies, as the compiler does.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from operator import attrgetter
from typing import Any

import mujoco
import numpy as np

from mjrun.errors import MjrunError
from mjrun.model.compiler_copied_fields import STATISTICS, Rows
from mjrun.model.fields import arrays
from mjrun.model.mujoco_globals import without_log
from mjrun.model.override import ALTERNATIVES, ELEMENTS, ORIENTATIONS, Override, apply, elements_at
from mjrun.model.source import FAULTS, checked_arrays, invalid_number, lengthen_buffers

# Arrays and sizes of images and of the names of files.
IMAGES, FILES = ("tex_",), ("paths", "_pathadr")
PATCHED_KINDS = ELEMENTS.keys() - {"texture", "sensor"}  # a source may append sensors after its overrides
STRUCTURAL = ("delay", "interval")  # numbers that determine the sizes of buffers
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
NO_CONTACTS = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
SLEEP = int(mujoco.mjtEnableBit.mjENBL_SLEEP)
PLANE, HFIELD = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD)
FAR, SMALL = 1e10, 1e-5  # of the compiler [m]
LEAST_SIZE = 1e-5  # [m] of a geom; where its volume vanishes, MuJoCo keeps the mass of an earlier compilation
CHECKED = ("dof_M0", "dof_invweight0", "body_invweight0", "actuator_acc0", "tendon_invweight0")


class Recompiler:
    """A compiler of a specification to the same model with other numbers in its elements.

    Args:
      spec: the specification, which changes.
      model: the model compiled from it.

    Attributes:
      arrays: names of the arrays that a recompilation may change.
      spec: the specification with images that are as small as possible.
    """

    def __init__(self, spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
        self.arrays = tuple(name for name in _patched_arrays() if getattr(model, name).size)
        self._values, self._sizes = attrgetter(*self.arrays), sizes_of(model)
        numbers = {name: index for index, name in enumerate(self.arrays)}
        self._checked = [(name, numbers[name]) for name in checked_arrays() if name in numbers]
        self.spec = self._without_images(spec, model)
        self._has_numbers: dict[str, bool] = {}  # by the path of a field

    def model(self, overrides: Sequence[Override]) -> mujoco.MjModel | None:
        """Returns a model, without its images, compiled with `overrides`; None if this does not suffice.

        It suffices for overrides of numbers in elements that MuJoCo accepts and that leave all sizes unchanged.
        """
        if not all(map(self.is_number, overrides)):
            return None
        spec = self.spec.copy()
        try:
            for override in overrides:
                apply(spec, override)
            lengthen_buffers(spec, overrides)
            with without_log():
                model = spec.compile()
        except (MjrunError, *FAULTS):  # the compilation of the source raises it again, with the line
            return None
        return model if self._fits(model) and not _may_vanish(model, overrides) else None

    def write(self, source: mujoco.MjModel, target: mujoco.MjModel) -> None:
        """Writes the numbers of a model over another, except its options."""
        for to, values in zip(self._values(target), self._values(source), strict=True):
            to[...] = values
        for name in STATISTICS:
            setattr(target.stat, name, getattr(source.stat, name))

    def is_number(self, override: Override) -> bool:
        """Returns whether an override changes decimal numbers of elements."""
        target = override.target
        if target not in self._has_numbers:
            self._has_numbers[target] = self._changes_numbers(override)
        return self._has_numbers[target]

    def _changes_numbers(self, override: Override) -> bool:
        if not may_be_recompiled(override):
            return False
        try:
            elements, fields = elements_at(self.spec, override)
        except MjrunError:  # the compilation of the source raises it again
            return False
        if len(fields) > 1 or fields[0] in STRUCTURAL:
            return False
        return all(_is_decimal(getattr(element, fields[0], None)) for element in elements)

    def _fits(self, model: mujoco.MjModel) -> bool:
        """Returns whether a model has the sizes of the original one, and only valid numbers."""
        if sizes_of(model) != self._sizes:
            return False
        values = self._values(model)
        return not any(invalid_number(values[index], name) for name, index in self._checked)

    def _without_images(self, spec: mujoco.MjSpec, model: mujoco.MjModel) -> mujoco.MjSpec:
        """Returns a specification whose images are as small as possible, if it compiles to the same model otherwise."""
        small = spec.copy()
        for texture in small.textures:
            is_sky = texture.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX
            texture.builtin, texture.mark = mujoco.mjtBuiltin.mjBUILTIN_FLAT, mujoco.mjtMark.mjMARK_NONE
            texture.width, texture.height = 1, 6 if is_sky else 1
            texture.file, texture.gridsize = "", (1, 1)
            texture.cubefiles = [""] * len(texture.cubefiles)
        try:
            with without_log():
                compiled = small.copy().compile()
        except FAULTS:
            return spec
        is_same = sizes_of(compiled) == self._sizes and all(
            np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
            for one, other in zip(self._values(compiled), self._values(model), strict=True)
        )
        return small if is_same else spec


def _may_vanish(model: mujoco.MjModel, overrides: Sequence[Override]) -> bool:
    """Returns whether overrides of sizes leave geoms so small that their volumes may vanish."""
    if not any(override.target.startswith("geom/") and override.target.endswith(".size") for override in overrides):
        return False
    return bool(((model.geom_size != 0) & (model.geom_size < LEAST_SIZE)).any())


def may_be_recompiled(override: Override) -> bool:
    """Returns whether an override may change decimal numbers of elements, judged by its path."""
    kind, slash, _ = override.target.partition("/")
    return bool(slash) and kind in PATCHED_KINDS


def _is_decimal(value: Any) -> bool:
    if isinstance(value, np.ndarray):
        return value.dtype.kind == "f"
    return isinstance(value, float) or type(value).__name__ in ("MjDoubleVec", "MjFloatVec")


@cache
def _patched_arrays() -> tuple[str, ...]:
    """Returns the names of all arrays of numbers except those of images and files."""
    example = mujoco.MjSpec().compile()
    return tuple(
        name
        for name in arrays()
        if not name.startswith(IMAGES) and not name.endswith(FILES)
        if isinstance(getattr(example, name), np.ndarray)
    )


def sizes_of(model: mujoco.MjModel) -> tuple[int, ...]:
    """Returns all sizes and flags of a model except the sizes of images and files."""
    return _sizes()(model)


@cache
def _sizes() -> Callable[[mujoco.MjModel], tuple[int, ...]]:
    from mujoco.introspect import structs

    described: Any = structs.STRUCTS["mjModel"].fields
    names = [each.name for each in described if each.name.startswith(("n", "flg_")) and not each.array_extent]
    return attrgetter(*(name for name in names if name not in ("ntexdata", "npaths", "nbuffer")))


class ChangedBodyCompiler:
    """A compiler of the bodies that overrides change, instead of the whole model.

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
        if first.nbody != len(kept):
            raise ValueError("static bodies were fused, which other elements of the whole model refer to")
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
        if self._structure_of(compiled) != self._structure or _may_vanish(compiled, overrides):
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


class DerivedNumbersComputer:
    """A calculator of the derived numbers of the variants of a model.

    Args:
      spec: the specification of the model, already compiled.

    Attributes:
      arrays: the arrays and statistics that `compute` may change.
    """

    def __init__(self, spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
        changed = (*mujoco.MjModel._setconst_outputs, "tendon_lengthspring")  # pyright: ignore[reportPrivateUsage]
        self.arrays = [name for name in changed if getattr(model, name).size]
        self.arrays += [f"stat.{name}" for name in STATISTICS]
        self._data = mujoco.MjData(model)
        lengths = [tendon.id for tendon in spec.tendons if (np.asarray(tendon.springlength) == -1).all()]
        self._automatic_lengths = np.array(lengths, int)
        values = {name: getattr(spec.stat, name) for name in STATISTICS}
        self._statistics = {name: value for name, value in values.items() if not np.isnan(value).any()}
        self._parents = model.body_parentid[model.jnt_bodyid]

    def compute(self, model: mujoco.MjModel) -> bool:
        """Computes the numbers of a model with changed bodies; returns whether they are finite."""
        data = self._data
        disabled, enabled = model.opt.disableflags, model.opt.enableflags
        model.opt.disableflags |= NO_CONTACTS
        model.opt.enableflags &= ~SLEEP
        mujoco.mj_resetData(model, data)
        mujoco.mj_setConst(model, data)
        self._compute_spring_lengths(model)
        self._compute_statistics(model)
        model.opt.disableflags, model.opt.enableflags = disabled, enabled
        return all(np.isfinite(getattr(model, name)).all() for name in CHECKED)

    def _compute_spring_lengths(self, model: mujoco.MjModel) -> None:
        """Computes the spring lengths of tendons without their own, in the pose `qpos_spring`."""
        if not len(self._automatic_lengths):
            return
        self._data.qpos[:] = model.qpos_spring
        mujoco.mj_kinematics(model, self._data)
        mujoco.mj_comPos(model, self._data)
        mujoco.mj_tendon(model, self._data)
        model.tendon_lengthspring[self._automatic_lengths] = self._data.ten_length[self._automatic_lengths, None]

    def _compute_statistics(self, model: mujoco.MjModel) -> None:
        """Computes the statistics in the pose `qpos0`, except those that the source specifies."""
        data, statistics = self._data, model.stat
        data.qpos[:] = model.qpos0
        mujoco.mj_kinematics(model, data)
        self._compute_extent(model)

        joint_bodies = model.jnt_bodyid
        sizes = np.zeros(model.nbody)
        np.maximum.at(sizes, joint_bodies, _distances(data.xipos[joint_bodies], data.xanchor))
        np.maximum.at(sizes, self._parents, _distances(data.xipos[self._parents], data.xanchor))
        bounded = np.flatnonzero(model.geom_rbound > 0)
        owners = model.geom_bodyid[bounded]
        reach = model.geom_rbound[bounded] + _distances(data.xipos[owners], data.geom_xpos[bounded])
        np.maximum.at(sizes, owners, reach)

        others = model.nbody - 1
        if others:
            statistics.meansize = _sum(np.maximum(sizes[1:], SMALL) / others)
            statistics.meanmass = _sum(model.body_mass[1:]) / others
        statistics.extent = max(statistics.extent, 2 * statistics.meansize)
        if model.nv:
            statistics.meaninertia = _sum(model.dof_M0) / model.nv
        for name, value in self._statistics.items():
            setattr(statistics, name, value)

    def _compute_extent(self, model: mujoco.MjModel) -> None:
        """Computes the centre and the extent of the bounding box."""
        data = self._data
        radii = model.geom_rbound.copy()
        for geom in np.flatnonzero(~(radii > 0)).tolist():
            if model.geom_type[geom] == PLANE:
                radii[geom] = model.geom_size[geom, :2].max() * 0.1 if model.geom_size[geom, :2].any() else 0.01
            elif model.geom_type[geom] == HFIELD:
                radii[geom] = model.hfield_size[model.geom_dataid[geom]].max() * 0.1
            else:
                radii[geom] = 0
        points = np.concatenate([data.xpos[1:], data.xipos[1:], data.xanchor, data.site_xpos])
        low = np.concatenate([points, data.geom_xpos - radii[:, None]]).min(axis=0, initial=FAR)
        high = np.concatenate([points, data.geom_xpos + radii[:, None]]).max(axis=0, initial=-FAR)
        model.stat.center = (low + high) * 0.5
        if high[0] > low[0]:
            model.stat.extent = max(SMALL, (high - low).max())


def _distances(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    difference = one - other
    x, y, z = difference.T
    return np.sqrt(x * x + y * y + z * z)


def _sum(values: np.ndarray) -> float:
    """Returns the sum in order, as a loop in C adds."""
    return float(np.add.accumulate(values)[-1])
