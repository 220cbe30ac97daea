"""Fields that the compiler only copies: numbers in `opt`, the contact parameters of geoms, the gains of actuators."""

import math
from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Any

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import MjrunError
from mjrun.model.override import PARTIAL, Override, elements_at, relative_values

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
            if new is None:
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
