"""Variants of one model, compiled fast: overrides of fields that the compiler only copies share a compilation.

These fields are numbers in `opt`, the contact parameters of geoms, and the gains of simple actuators. All other
overrides are compiled, as are negative and infinite values, which the compiler may refuse. In every case the model is
byte for byte the one that compiling the source with all overrides gives.
"""

import copy
import math
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import mujoco
import numpy as np

from mjrun.errors import MjrunError
from mjrun.model.override import PARTIAL, RELATIVE, Override, elements_at
from mjrun.model.source import Source

VECTORS = ("gravity", "wind", "magnetic")
OPTIONS = ("timestep", "density", "viscosity", "impratio", "tolerance", "ls_tolerance", "noslip_tolerance")
OPTIONS += ("ccd_tolerance", *VECTORS)
# Fields of elements, and the arrays of the compiled model that hold them.
COPIED = {f"geom.{name}": f"geom_{name}" for name in ("friction", "solref", "solimp")}
COPIED |= {f"actuator.{name}": f"actuator_{name}" for name in ("gainprm", "biasprm")}
COPIED |= {f"opt.{name}": f"opt.{name}" for name in OPTIONS}
REMEMBERED = 8  # compilations
BYTES = 2**27  # memory for models: of remembered compilations, and of simulations side by side
SPEC_SIZE = 3  # a specification with its processed meshes takes up to 2.4 times the memory of its model, as measured

AFFINE = (int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE))


@dataclass(frozen=True, eq=False)
class ModelVariant:
    """A model, and the compilation from which it differs only in copied numbers.

    Attributes:
      copied: the arrays of the model with other numbers.
    """

    model: mujoco.MjModel
    compilation: "SharedCompilation"
    copied: frozenset[str] = frozenset()

    @property
    def compiled(self) -> mujoco.MjModel:
        """The compiled model, which may be `model` itself."""
        return self.compilation.model


class ModelVariants:
    """A loader of sources like `Source.load`, which caches their common compilations within `BYTES` of memory.

    The latest compilation is cached whatever its size.

    Args:
      prepare: a function that changes each model after its compilation.
    """

    def __init__(self, prepare: Callable[[mujoco.MjModel], None] | None = None) -> None:
        self._prepare = prepare
        self._compilations = OrderedDict[Source, SharedCompilation]()

    def load(self, source: Source) -> ModelVariant:
        """Returns the model of `source`; it must not be changed, because others may share it.

        Raises:
          ModelError: it cannot be found or read, or MuJoCo refuses it.
          UsageError: an override refers to nothing, or its value does not fit.
        """
        copied = [_may_be_copied(override) for override in source.overrides]
        to_copy = [override for override, is_copied in zip(source.overrides, copied, strict=True) if is_copied]
        rest = tuple(override for override, is_copied in zip(source.overrides, copied, strict=True) if not is_copied)
        if to_copy and {_field(override) for override in to_copy}.isdisjoint(map(_field, rest)):
            # Otherwise the last override of a field counts.
            shared = self._compilation(replace(source, overrides=rest))
            if variant := shared.with_values(to_copy):
                return variant
        compilation = self._compilation(source)
        return ModelVariant(compilation.model, compilation)

    def reuse(self, variant: ModelVariant) -> None:
        """Returns a variant that is no longer used: a later one of the same compilation may overwrite it."""
        home = variant.compilation
        is_copy = variant.model is not home.model
        if is_copy and home.spec and self._bytes + home.size <= BYTES:
            home.unused.append(_UnusedCopy(variant.model, variant.copied))

    @property
    def _bytes(self) -> int:
        return sum(compilation.bytes for compilation in self._compilations.values())

    def _compilation(self, source: Source) -> "SharedCompilation":
        compilation = self._compilations.pop(source, None) or self._compile(source)
        self._compilations[source] = compilation
        while len(self._compilations) > 1 and (len(self._compilations) > REMEMBERED or self._bytes > BYTES):
            _, oldest = self._compilations.popitem(last=False)
            oldest.forget_source()  # its model may still be in use
        return compilation

    def _compile(self, source: Source) -> "SharedCompilation":
        spec, model = source.compile()
        if self._prepare:
            model = copy.copy(model) if spec is None else model  # it may belong to the user
            self._prepare(model)
        return SharedCompilation(spec, model)


@dataclass(frozen=True)
class _UnusedCopy:
    """A copy of a compiled model with other numbers in some arrays, which may be overwritten."""

    model: mujoco.MjModel
    copied: frozenset[str]


@dataclass(frozen=True)
class _Place:
    """An array of the compiled model, and the rows of it that a path refers to."""

    array: str
    rows: list[int]


class SharedCompilation:
    """A specification and the model compiled from it; without a specification, only the compiled model is shared.

    It is part of no reference cycle: Python's garbage collector, which counts objects, would let hundreds of models
    accumulate before it frees the first.

    Attributes:
      size: the size of the model [bytes].
      unused: copies of the model that may be overwritten.
    """

    def __init__(self, spec: mujoco.MjSpec | None, model: mujoco.MjModel) -> None:
        self.spec, self.model = spec, model
        self.size = mujoco.mj_sizeModel(model)
        self.unused: list[_UnusedCopy] = []
        self._places: dict[str, _Place | None] = {}
        self._source_values: dict[str, np.ndarray] = {}

    @property
    def bytes(self) -> int:
        """The approximate memory that it needs [bytes]."""
        return self.size * (1 + len(self.unused) + (SPEC_SIZE if self.spec else 0))

    def forget_source(self) -> None:
        """Drops everything except the model."""
        self.spec = None
        self.unused.clear()

    def with_values(self, overrides: Sequence[Override]) -> ModelVariant | None:
        """Returns the model with overrides of copied fields; None if it must be compiled."""
        if self.spec is None:
            return None
        changed: dict[str, np.ndarray] = {}
        rows: dict[str, list[int]] = {}
        for override in overrides:
            place = self._place(override)
            if place is None:
                return None
            values = changed.setdefault(place.array, self._in_source(place.array).copy())
            new = _new_values(values[place.rows], override)
            if new is None:
                return None
            values[place.rows] = new
            rows.setdefault(place.array, []).extend(place.rows)

        unused = self.unused.pop() if self.unused else None
        model = unused.model if unused else copy.copy(self.model)
        for array in unused.copied - changed.keys() if unused else ():
            _write(model, array, _read(self.model, array))
        for array, values in changed.items():
            merged = _read(self.model, array)
            merged[rows[array]] = values[rows[array]]
            _write(model, array, merged)
        return ModelVariant(model, self, frozenset(changed))

    def _place(self, override: Override) -> _Place | None:
        """Returns the place that an override changes; None if anything else in this model depends on it."""
        if override.target not in self._places:
            self._places[override.target] = self._found_place(override)
        return self._places[override.target]

    def _found_place(self, override: Override) -> _Place | None:
        assert self.spec
        array, field = COPIED[_name(override)], _field(override)
        if array.startswith("opt."):
            return _Place(array, [0]) if field != "timestep" or self._has_free_timestep else None
        try:
            elements, fields = elements_at(self.spec, override)
        except MjrunError:  # the compilation raises it again
            return None
        if array.startswith("geom"):
            is_copied = self._has_simple_contacts
        else:
            is_copied = all(_has_plain_gains(element) for element in elements)
        return _Place(array, [element.id for element in elements]) if is_copied and fields == [field] else None

    def _in_source(self, array: str) -> np.ndarray:
        """Returns the values in the specification, `(rows, size)`; one row for options."""
        if array not in self._source_values:
            assert self.spec
            kind, field = array.replace(".", "_").split("_", 1)
            owners: Any = {"geom": self.spec.geoms, "actuator": self.spec.actuators, "opt": [self.spec.option]}[kind]
            values = np.array([np.atleast_1d(getattr(owner, field)) for owner in owners], float)
            order = [0] if kind == "opt" else [owner.id for owner in owners]
            self._source_values[array] = values[np.argsort(order)]
        return self._source_values[array]

    @cached_property
    def _has_simple_contacts(self) -> bool:
        """True if the contact parameters of geoms are only copied to their own arrays."""
        return self.model.npair == 0 and self.model.nplugin == 0

    @cached_property
    def _has_free_timestep(self) -> bool:
        """True if the timestep is only copied to the options."""
        return self.model.nplugin == 0 and self.model.nhistory == 0


def _field(override: Override) -> str:
    return override.target.rpartition(".")[2]


@lru_cache(1024)
def _name_of(target: str) -> str:
    """Returns the kind and the field of a target, `geom.friction` or `opt.timestep`; empty for other targets."""
    kind, slash, _ = target.partition("/")
    if slash:
        return f"{kind}.{target.rpartition('.')[2]}" if kind != "opt" else ""
    return target if target.startswith("opt.") else ""


def _name(override: Override) -> str:
    return _name_of(override.target)


def _numbers(override: Override) -> list[float]:
    return [float(part) for part in override.value.replace(",", " ").split()]


def _may_be_copied(override: Override) -> bool:
    """Returns whether an override may be of a copied field, judged by its path and value."""
    if _name(override) not in COPIED:
        return False
    field = _field(override)
    if field == "biasprm" and override.index not in (0, 1):
        return False  # the third is a damping ratio if it is positive
    try:
        numbers = _numbers(override)
    except ValueError:
        return False
    any_sign = field in VECTORS or field == "biasprm"
    is_positive = override.operation != "add" and all(number > 0 for number in numbers)
    return all(map(math.isfinite, numbers)) and (any_sign or is_positive)


def _has_plain_gains(actuator: Any) -> bool:
    # A positive third bias is a damping ratio, which the compiler turns into a damping; muscles have computed gains.
    is_fixed = int(actuator.gaintype) == int(mujoco.mjtGain.mjGAIN_FIXED) and int(actuator.biastype) in AFFINE
    return is_fixed and not actuator.biasprm[2] > 0 and int(actuator.dyntype) != int(mujoco.mjtDyn.mjDYN_MUSCLE)


def _new_values(values: np.ndarray, override: Override) -> np.ndarray | None:
    """Returns `values` `(rows, size)` after an override, as in `mjrun.model.override`; None if it does not fit."""
    numbers, size = _numbers(override), values.shape[1]
    field, index, operation = _field(override), override.index, override.operation
    is_single = field in OPTIONS and field not in VECTORS
    if index is None and not operation:
        fits = 0 < len(numbers) <= size if field in PARTIAL else len(numbers) == size
        if not fits or (is_single and "," in override.value):
            return None
        values[:, : len(numbers)] = numbers
        return values

    chosen = slice(None) if index is None else slice(index, index + 1)
    old = values[:, chosen]
    fits = len(numbers) == 1 or (operation and len(numbers) == old.shape[1])
    if not old.size or not fits or (index is not None and is_single) or np.isnan(old).any():
        return None
    values[:, chosen] = RELATIVE[operation](old, np.array(numbers)) if operation else numbers[0]
    return values


def _read(model: mujoco.MjModel, array: str) -> np.ndarray:
    """Returns a copy of an array, `(rows, size)`."""
    if array.startswith("opt."):
        return np.array(getattr(model.opt, array.removeprefix("opt.")), float).reshape(1, -1)
    return getattr(model, array).copy()


def _write(model: mujoco.MjModel, array: str, values: np.ndarray) -> None:
    """Writes an array, the reverse of `_read`."""
    field = array.removeprefix("opt.")
    if array == field:
        getattr(model, field)[...] = values
    elif field in VECTORS:
        getattr(model.opt, field)[:] = values[0]
    else:
        setattr(model.opt, field, float(values[0, 0]))
