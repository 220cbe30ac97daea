"""Numbers that the compiler copies: those in `opt`, contact parameters of geoms, gains of actuators, other elements.

For numbers of elements, `DerivedNumbersComputer` computes everything that depends on them. The mass and the inertia of
a body with a single primitive geom are computed here, in the compiler's order of operations, and thus to the last bit.
"""

import math
from collections.abc import Callable, Sequence
from functools import cached_property, lru_cache, partial
from math import pi
from typing import Any

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import MjrunError
from mjrun.model.override import PARTIAL, Override, elements_at, relative_values
from mjrun.model.source import LONGEST

VECTORS = ("gravity", "wind", "magnetic")
OPTIONS = ("timestep", "density", "viscosity", "impratio", "tolerance", "ls_tolerance", "noslip_tolerance")
OPTIONS += ("ccd_tolerance", *VECTORS)
# Fields of elements, and the arrays of the compiled model that hold them.
COPIED = {f"geom.{name}": f"geom_{name}" for name in ("friction", "solref", "solimp")}
COPIED |= {f"actuator.{name}": f"actuator_{name}" for name in ("gainprm", "biasprm")}
COPIED |= {f"opt.{name}": f"opt.{name}" for name in OPTIONS}
COPIED_ARRAYS = frozenset(COPIED.values())
STATISTICS = ("center", "extent", "meaninertia", "meanmass", "meansize")
AFFINE = (int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE))
Rows = tuple[Sequence[int] | np.ndarray, np.ndarray]  # of an array, and their values
FREE = int(mujoco.mjtJoint.mjJNT_FREE)
SHAPES = ("SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX", "PLANE")
PRIMITIVES = {int(mujoco.mjtGeom.__members__[f"mjGEOM_{shape}"]): shape for shape in SHAPES}
WITH_ENDS = ("CAPSULE", "CYLINDER")  # shapes whose length follows from `fromto`, and their radius does not
# Coefficients of a polynomial, in an array for the first and another for the rest.
ELEMENT_VECTORS = ("damping", "stiffness")
LEAST = 1e-9  # smaller masses and sizes may be refused


@dataclass(frozen=True)
class _Place:
    """An array of the compiled model, and the rows of it that a path refers to."""

    array: str
    rows: np.ndarray


class CompilerCopiedFields:
    """The copied fields of a model, and their values in its specification."""

    def __init__(self, spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
        self._spec, self._model = spec, model
        self._places: dict[str, _Place | None] = {}
        self._source_values: dict[str, np.ndarray] = {}

    def changed(self, overrides: Sequence[Override]) -> dict[str, Rows] | None:
        """Returns the changed rows of each array and their values; None if the model must be compiled for them."""
        changed: dict[str, np.ndarray] = {}
        rows: dict[str, np.ndarray] = {}
        for override in overrides:
            place = self._place(override)
            if place is None:
                return None
            if place.array not in changed:
                changed[place.array], rows[place.array] = self._in_source(place.array).copy(), place.rows
            elif place.rows is not rows[place.array]:
                rows[place.array] = np.union1d(rows[place.array], place.rows)
            values = changed[place.array]
            new = new_values(values[place.rows], override)
            if new is None or (place.array == "opt.timestep" and not (new <= LONGEST).all()):
                return None
            values[place.rows] = new
        return {array: (rows[array], values[rows[array]]) for array, values in changed.items()}

    def _place(self, override: Override) -> _Place | None:
        """Returns the place that an override changes; None if anything else in this model depends on it."""
        if override.target not in self._places:
            self._places[override.target] = self._found_place(override)
        return self._places[override.target]

    def _found_place(self, override: Override) -> _Place | None:
        array, field = COPIED[field_name(override)], field_of(override)
        if array.startswith("opt."):
            return _Place(array, np.array([0])) if field != "timestep" or self._has_free_timestep else None
        try:
            elements, fields = elements_at(self._spec, override)
        except MjrunError:  # the compilation raises it again
            return None
        if array.startswith("geom"):
            is_copied = self._has_simple_contacts
        else:
            is_copied = all(_has_plain_gains(element) for element in elements)
        rows = np.array([element.id for element in elements])
        return _Place(array, rows) if is_copied and fields == [field] else None

    def _in_source(self, array: str) -> np.ndarray:
        """Returns the values in the specification, `(rows, size)`; one row for options."""
        if array not in self._source_values:
            kind, field = array.replace(".", "_").split("_", 1)
            owners: Any = {"geom": self._spec.geoms, "actuator": self._spec.actuators, "opt": [self._spec.option]}[kind]
            values = np.array([np.atleast_1d(getattr(owner, field)) for owner in owners], float)
            order = [0] if kind == "opt" else [owner.id for owner in owners]
            self._source_values[array] = values[np.argsort(order)]
        return self._source_values[array]

    @cached_property
    def _has_simple_contacts(self) -> bool:
        """True if the contact parameters of geoms are only copied to their own arrays."""
        return self._model.npair == 0 and self._model.nplugin == 0

    @cached_property
    def _has_free_timestep(self) -> bool:
        """True if the timestep is only copied to the options."""
        return self._model.nplugin == 0 and self._model.nhistory == 0


def field_of(override: Override) -> str:
    """Returns the field that an override changes."""
    return override.target.rpartition(".")[2]


@lru_cache(1024)
def _name_of(target: str) -> str:
    """Returns the kind and the field of a target, `geom.friction` or `opt.timestep`; empty for other targets."""
    kind, slash, _ = target.partition("/")
    if slash:
        return f"{kind}.{target.rpartition('.')[2]}" if kind != "opt" else ""
    return target if target.startswith("opt.") else ""


def field_name(override: Override) -> str:
    """Returns the kind and the field that an override changes; see `_name_of`."""
    return _name_of(override.target)


def numbers_of(override: Override) -> list[float]:
    """Returns the numbers in the value of an override; raises ValueError if it has others."""
    return [float(part) for part in override.value.replace(",", " ").split()]


def may_be_copied(override: Override) -> bool:
    """Returns whether an override may be of a copied field, judged by its path and value."""
    if field_name(override) not in COPIED:
        return False
    field = field_of(override)
    if field == "biasprm" and override.index not in (0, 1):
        return False  # the third is a damping ratio if it is positive
    try:
        numbers = numbers_of(override)
    except ValueError:
        return False
    any_sign = field in VECTORS or field == "biasprm"
    is_positive = override.operation != "add" and all(number > 0 for number in numbers)
    return all(map(math.isfinite, numbers)) and (any_sign or is_positive)


def _has_plain_gains(actuator: Any) -> bool:
    # A positive third bias is a damping ratio, which the compiler turns into a damping; muscles have computed gains.
    is_fixed = int(actuator.gaintype) == int(mujoco.mjtGain.mjGAIN_FIXED) and int(actuator.biastype) in AFFINE
    return is_fixed and not actuator.biasprm[2] > 0 and int(actuator.dyntype) != int(mujoco.mjtDyn.mjDYN_MUSCLE)


def new_values(values: np.ndarray, override: Override) -> np.ndarray | None:
    """Returns `values` `(rows, size)` after an override, as in `mjrun.model.override`; None if it does not fit."""
    numbers, size = numbers_of(override), values.shape[1]
    field, index, operation = field_of(override), override.index, override.operation
    is_single = field in OPTIONS and field not in VECTORS
    if index is None and not operation:
        fits = 0 < len(numbers) <= size if field in PARTIAL else len(numbers) == size
        if not fits or (is_single and "," in override.value):
            return None
        values[:, : len(numbers)] = numbers
        return values

    chosen = slice(None) if index is None else slice(index, index + 1)
    old = values[:, chosen]
    if not old.size or (index is not None and is_single) or np.isnan(old).any():
        return None
    if operation:
        changed = relative_values(old, np.array(numbers), override)
    else:
        changed = numbers[0] if len(numbers) == 1 else None
    if changed is None:
        return None
    values[:, chosen] = changed
    return values


@dataclass(frozen=True)
class _Field:
    """A field of elements.

    Attributes:
      array: the array of the compiled model.
      any_sign: whether zero and negative numbers are copied, too.
      has_effects: whether other numbers of the model depend on it.
    """

    array: str
    any_sign: bool = False
    has_effects: bool = True


@dataclass(frozen=True)
class _Solid:
    """The only geom of a body, from which the mass and the inertia of the body follow.

    Attributes:
      body: the id of the body.
      shape: the name of the shape.
      density: the density of the geom, if `mass` is None.
      mass: the mass of the geom, if the source specifies it.
    """

    body: int
    shape: str
    density: float
    mass: float | None

    def numbers(self, size: np.ndarray) -> tuple[float, list[float]]:
        """Returns the mass and the principal moments of inertia of the geom with a size."""
        volume, moments = _SOLIDS[self.shape]
        mass = self.density * volume(*size.tolist()) if self.mass is None else self.mass
        return mass, moments(mass, *size.tolist())


FIELDS = {
    "body.pos": _Field("body_pos", any_sign=True),
    "body.mass": _Field("body_mass"),
    "joint.armature": _Field("dof_armature"),
    "joint.damping": _Field("dof_damping", has_effects=False),
    "joint.frictionloss": _Field("dof_frictionloss", has_effects=False),
    "joint.stiffness": _Field("jnt_stiffness", has_effects=False),
    "geom.pos": _Field("geom_pos", any_sign=True),
    "geom.size": _Field("geom_size"),
    "geom.margin": _Field("geom_margin"),
    "geom.gap": _Field("geom_gap"),
    "geom.solmix": _Field("geom_solmix", has_effects=False),
    "site.pos": _Field("site_pos", any_sign=True),
    "site.size": _Field("site_size", has_effects=False),
    "camera.pos": _Field("cam_pos", any_sign=True),
    "light.pos": _Field("light_pos", any_sign=True),
}


class CopiedElementNumbers:
    """The numbers of the elements of a model that are only copied.

    Args:
      spec: the specification of the model, already compiled.
      model: the model.
    """

    def __init__(self, spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
        self._spec, self.model = spec, model
        compiler = spec.compiler
        is_adjusted = compiler.settotalmass > 0 or compiler.boundmass or compiler.boundinertia or compiler.fusestatic
        self._is_plain = not (is_adjusted or model.npair or model.nflex or model.nskin or model.nplugin)
        self._rows: dict[str, np.ndarray | None] = {}  # by the path of a field
        self._first_only = set[str]()  # paths of which the compiler copies the first number of each row
        self._solids: dict[int, _Solid] = {}  # by the id of the geom

    def changed(self, overrides: Sequence[Override]) -> dict[str, Rows] | None:
        """Returns the changed rows of each array and their values; None if the model must be compiled for them."""
        whole = dict[str, np.ndarray]()
        changed = dict[str, list[int]]()
        for override in overrides:
            rows = self._rows_of(override) if self._is_plain else None
            if rows is None or not _is_valid(override):
                return None
            array = FIELDS[field_name(override)].array
            values = whole.setdefault(array, _by_rows(self.model, array))
            is_first = override.target in self._first_only
            new = _first_number(values[rows, :1], override) if is_first else new_values(values[rows], override)
            if new is None:
                return None
            values[rows, : new.shape[1]] = new
            changed.setdefault(array, []).extend(rows.tolist())
        result: dict[str, Rows] = {
            array: (rows, self._shaped(array, whole[array][rows])) for array, rows in changed.items()
        }
        of_solids = self._of_solids(result)
        return None if of_solids is None else result | of_solids | self._of_free_joints(result)

    @staticmethod
    def have_effects(overrides: Sequence[Override]) -> bool:
        """Returns whether other numbers of the model depend on those that overrides change."""
        return any(FIELDS[field_name(override)].has_effects for override in overrides)

    def _rows_of(self, override: Override) -> np.ndarray | None:
        """Returns the rows that an override changes; None if anything but `DerivedNumbersComputer` depends on them."""
        if override.target not in self._rows:
            self._rows[override.target] = self._found_rows(override)
        return self._rows[override.target]

    def _found_rows(self, override: Override) -> np.ndarray | None:
        field = FIELDS.get(field_name(override))
        if field is None:
            return None
        try:
            elements, fields = elements_at(self._spec, override)
        except MjrunError:  # the compilation raises it again
            return None
        kind = field_name(override).partition(".")[0]
        is_copied = _CONDITIONS.get(kind)
        if fields != [field_of(override)] or (is_copied and not all(is_copied(self, each) for each in elements)):
            return None
        if fields == ["mass"] and not all(element.explicitinertial for element in elements):
            return None
        has_ends = {kind == "geom" and _has_ends(element) for element in elements}
        if True in has_ends and (False in has_ends or fields != ["size"]):
            return None
        if fields == ["pos"] and kind == "geom" and any(element.id in self._solids for element in elements):
            return None  # it may change how MuJoCo computes the body

        values = _by_rows(self.model, field.array)
        if fields[0] in ELEMENT_VECTORS or True in has_ends:
            self._first_only.add(override.target)
            values = values[:, :1]
        rows = list[int]()
        for element in elements:
            own = [element.id]
            if field.array.startswith("dof_"):
                own = np.flatnonzero(self.model.dof_jntid == element.id).tolist()
            source = np.ravel(getattr(element, fields[0]))
            if fields[0] in ELEMENT_VECTORS and source[1:].any():
                return None
            if not (values[own] == source[: values.shape[1]]).all():  # a unit or a frame comes between
                return None
            rows += own
        return np.array(rows, int)

    def is_separate(self, geom: Any) -> bool:
        """Returns whether nothing but the bounds and the mass of its body depend on a geom, in a known way."""
        body, shape = geom.parent, PRIMITIVES.get(int(geom.type))
        # The compiler sorts the bounding volumes of several geoms by their positions.
        if shape is None or self.model.body_bvhnum[body.id] > 1 or (_has_ends(geom) and shape not in WITH_ENDS):
            return False
        from_geoms = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
        if not body.id or (body.explicitinertial and self._spec.compiler.inertiafromgeom != from_geoms):
            return True
        solid = _Solid(body.id, shape, float(geom.density), None if np.isnan(geom.mass) else float(geom.mass))
        if shape not in _SOLIDS or geom.typeinertia != mujoco.mjtGeomInertia.mjINERTIA_VOLUME:
            return False
        is_exact = len(body.geoms) == 1 and self._is_exact(geom.id, solid)
        if is_exact:
            self._solids[geom.id] = solid
        return is_exact

    def _is_exact(self, geom: int, solid: _Solid) -> bool:
        """Returns whether the compiled numbers of the body of a solid are those of its geom."""
        model, body = self.model, solid.body
        mass, inertia = solid.numbers(model.geom_size[geom])
        pairs = (
            (model.body_mass[body], mass),
            (model.body_inertia[body], inertia),
            (model.body_ipos[body], model.geom_pos[geom]),
            (model.body_iquat[body], model.geom_quat[geom]),
        )
        return all(np.array_equal(compiled, computed) for compiled, computed in pairs)

    def _of_solids(self, changed: dict[str, Rows]) -> dict[str, Rows] | None:
        """Returns the rows of bodies whose only geom changes its size; None if the compiler may refuse them."""
        bodies, masses, inertias = list[int](), list[float](), list[list[float]]()
        for geom, size in zip(*changed.get("geom_size", ((), ())), strict=True):
            solid = self._solids.get(geom)
            if solid:
                mass, inertia = solid.numbers(size)
                if not min(mass, *inertia) > LEAST:
                    return None
                bodies.append(solid.body)
                masses.append(mass)
                inertias.append(inertia)
        if not bodies:
            return {}
        return {"body_mass": (bodies, np.array(masses)), "body_inertia": (bodies, np.array(inertias))}

    def _of_free_joints(self, changed: dict[str, Rows]) -> dict[str, Rows]:
        """Returns the initial positions of free joints of bodies whose position changes."""
        bodies, positions = changed.get("body_pos", ((), np.empty((0, 3))))
        model, rows, values = self.model, list[int](), list[np.ndarray]()
        for body, position in zip(bodies, positions, strict=True):
            joint = int(model.body_jntadr[body])
            if joint >= 0 and model.jnt_type[joint] == FREE:
                start = int(model.jnt_qposadr[joint])
                rows += range(start, start + 3)
                values.append(position)
        return dict.fromkeys(("qpos0", "qpos_spring"), (rows, np.concatenate(values))) if rows else {}

    def _shaped(self, array: str, values: np.ndarray) -> np.ndarray:
        return values if getattr(self.model, array).ndim > 1 else values[:, 0]


def _has_inertia(numbers: CopiedElementNumbers, body: Any) -> bool:
    """Returns whether the inertial frame of a body is independent of its position."""
    return bool(body.id) and numbers.model.body_mass[body.id] > 0


_CONDITIONS: dict[str, Callable[[CopiedElementNumbers, Any], bool]] = {
    "body": _has_inertia,
    "geom": CopiedElementNumbers.is_separate,
    "joint": lambda numbers, joint: not np.any(joint.springdamper),
}


def _is_valid(override: Override) -> bool:
    """Returns whether the compiler copies the value of an override, judged by itself."""
    try:
        numbers = numbers_of(override)
    except ValueError:
        return False
    is_positive = override.operation != "add" and all(number > LEAST for number in numbers)
    return bool(np.isfinite(numbers).all()) and (FIELDS[field_name(override)].any_sign or is_positive)


def _has_ends(geom: Any) -> bool:
    return bool(np.isfinite(geom.fromto[0]))


def _first_number(values: np.ndarray, override: Override) -> np.ndarray | None:
    """Returns the first numbers `(rows, 1)` after an override; None if it changes others."""
    numbers = numbers_of(override)
    if len(numbers) != 1 or override.index not in (None, 0):
        return None
    return values * numbers[0] if override.operation else np.full_like(values, numbers[0])


def _by_rows(model: mujoco.MjModel, array: str) -> np.ndarray:
    """Returns a copy of an array, `(rows, size)`."""
    values = getattr(model, array)
    return values.reshape(len(values), -1).copy()


def _capsule(mass: float, radius: float, half: float, _: float) -> list[float]:
    """Returns the moments of inertia of a cylinder and two hemispheres at its ends."""
    height = 2 * half
    sphere = mass * 4 * radius / (4 * radius + 3 * height)
    cylinder = mass - sphere
    of_sphere = 2 * sphere * radius * radius / 5
    across = cylinder * (3 * radius * radius + height * height) / 12
    across += of_sphere + sphere * height * (3 * radius + 2 * height) / 8
    return [across, across, cylinder * radius * radius / 2 + of_sphere]


def _cylinder(mass: float, radius: float, half: float, _: float) -> list[float]:
    height = 2 * half
    across = mass * (3 * radius * radius + height * height) / 12
    return [across, across, mass * radius * radius / 2]


def _three_axes(mass: float, x: float, y: float, z: float, divisor: int) -> list[float]:
    """Returns the moments of inertia of an ellipsoid (divisor 5) or a box (divisor 3) with these half axes."""
    xx, yy, zz = x * x, y * y, z * z
    return [mass * (yy + zz) / divisor, mass * (xx + zz) / divisor, mass * (xx + yy) / divisor]


_Formulas = tuple[Callable[[float, float, float], float], Callable[[float, float, float, float], list[float]]]
# The volume of a size, and the principal moments of inertia of a mass and a size.
_SOLIDS: dict[str, _Formulas] = {
    "SPHERE": (lambda r, _, __: 4 * pi * r * r * r / 3, lambda mass, r, _, __: [2 * mass * r * r / 5] * 3),
    "CAPSULE": (lambda r, half, _: pi * (r * r * (2 * half) + 4 * r * r * r / 3), _capsule),
    "CYLINDER": (lambda r, half, _: pi * r * r * (2 * half), _cylinder),
    "ELLIPSOID": (lambda x, y, z: 4 * pi * x * y * z / 3, partial(_three_axes, divisor=5)),
    "BOX": (lambda x, y, z: x * y * z * 8, partial(_three_axes, divisor=3)),
}
