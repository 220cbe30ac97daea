"""Numbers of elements that the compiler copies, while `DerivedNumbers` computes everything that depends on them."""

from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import MjrunError
from mjrun.model.copied_fields import Rows, field_name, field_of, new_values, numbers_of
from mjrun.model.override import Override, elements_at

FREE = int(mujoco.mjtJoint.mjJNT_FREE)
SHAPES = ("SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX", "PLANE")
PRIMITIVES = {int(mujoco.mjtGeom.__members__[f"mjGEOM_{shape}"]) for shape in SHAPES}
VECTORS = ("damping", "stiffness")  # coefficients of a polynomial, in an array for the first and another for the rest
LEAST = 1e-9  # smaller masses and sizes may be refused


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


class ElementNumbers:
    """The numbers of the elements of a model that are only copied.

    Args:
      spec: the specification of the model, already compiled.
      model: the model.
    """

    def __init__(self, spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
        self._spec, self.model = spec, model
        compiler = spec.compiler
        is_plain = compiler.settotalmass <= 0 and not (compiler.fusestatic or compiler.boundmass or model.npair)
        self._is_plain = is_plain and not (model.nflex or model.nskin or model.nplugin)
        self._rows: dict[str, np.ndarray | None] = {}  # by the path of a field

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
            new = _first_number(values[rows], override) if _is_first(override) else new_values(values[rows], override)
            if new is None:
                return None
            values[rows] = new
            changed.setdefault(array, []).extend(rows.tolist())
        result: dict[str, Rows] = {
            array: (rows, self._shaped(array, whole[array][rows])) for array, rows in changed.items()
        }
        return result | self._of_free_joints(result)

    @staticmethod
    def have_effects(overrides: Sequence[Override]) -> bool:
        """Returns whether other numbers of the model depend on those that overrides change."""
        return any(FIELDS[field_name(override)].has_effects for override in overrides)

    def _rows_of(self, override: Override) -> np.ndarray | None:
        """Returns the rows that an override changes; None if anything but `DerivedNumbers` depends on them."""
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
        if fields != [field_of(override)] or not all(_CONDITIONS.get(kind, _always)(self, each) for each in elements):
            return None
        if fields == ["mass"] and not all(element.explicitinertial for element in elements):
            return None

        values = _by_rows(self.model, field.array)
        rows = list[int]()
        for element in elements:
            own = self._dofs(element) if field.array.startswith("dof_") else [element.id]
            source = np.ravel(getattr(element, fields[0]))
            if fields[0] in VECTORS and source[1:].any():
                return None
            if not (values[own] == source[: values.shape[1]]).all():  # a unit or a frame comes between
                return None
            rows += own
        return np.array(rows, int)

    def _dofs(self, joint: Any) -> list[int]:
        return np.flatnonzero(self.model.dof_jntid == joint.id).tolist()

    def has_own_inertia(self, geom: Any) -> bool:
        """Returns whether the inertia of the body of a geom is independent of it, and of its mass."""
        body, from_geoms = geom.parent, mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
        is_independent = not body.id or (body.explicitinertial and self._spec.compiler.inertiafromgeom != from_geoms)
        return is_independent and int(geom.type) in PRIMITIVES and not np.isfinite(geom.fromto[0])

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


def _always(numbers: ElementNumbers, element: Any) -> bool:
    return True


def _has_no_spring_damper(numbers: ElementNumbers, joint: Any) -> bool:
    return not np.any(joint.springdamper)


def _has_inertia(numbers: ElementNumbers, body: Any) -> bool:
    """Returns whether the inertial frame of a body is independent of its position."""
    return bool(body.id) and numbers.model.body_mass[body.id] > 0


_CONDITIONS: dict[str, Callable[[ElementNumbers, Any], bool]] = {
    "body": _has_inertia,
    "geom": ElementNumbers.has_own_inertia,
    "joint": _has_no_spring_damper,
}


def _is_valid(override: Override) -> bool:
    """Returns whether the compiler copies the value of an override, judged by itself."""
    try:
        numbers = numbers_of(override)
    except ValueError:
        return False
    is_positive = override.operation != "add" and all(number > LEAST for number in numbers)
    return bool(np.isfinite(numbers).all()) and (FIELDS[field_name(override)].any_sign or is_positive)


def _is_first(override: Override) -> bool:
    """Returns whether an override may change the first coefficient of a polynomial, or all of them."""
    return field_of(override) in VECTORS


def _first_number(values: np.ndarray, override: Override) -> np.ndarray | None:
    """Returns the first coefficients `(rows, 1)` after an override; None if it changes others from zero."""
    numbers = numbers_of(override)
    if len(numbers) != 1 or override.index not in (None, 0):
        return None
    return values * numbers[0] if override.operation else np.full_like(values, numbers[0])


def _by_rows(model: mujoco.MjModel, array: str) -> np.ndarray:
    """Returns a copy of an array, `(rows, size)`."""
    values = getattr(model, array)
    return values.reshape(len(values), -1).copy()
