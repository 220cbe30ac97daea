"""Many variants of one model, compiled fast: overrides of what the compiler only copies share a compilation.

These are numbers of `opt`, the contact parameters of geoms, and the gains of simple actuators. Whatever else is
overridden is compiled, and so is every negative or infinite value, which the compiler may refuse. The model is in any
case the one that compiling the source with all overrides gives, byte for byte.
"""

import copy
import math
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from mjrun.errors import concerning
from mjrun.model.override import Override, apply, elements_at
from mjrun.model.source import Source

OPTIONS = ("timestep", "gravity", "wind", "magnetic", "density", "viscosity", "impratio", "tolerance", "ls_tolerance")
OPTIONS += ("noslip_tolerance", "ccd_tolerance")
# Fields of elements, and the array of the compiled model that holds them.
COPIED = {f"geom.{name}": f"geom_{name}" for name in ("friction", "solref", "solimp")}
COPIED |= {f"actuator.{name}": f"actuator_{name}" for name in ("gainprm", "biasprm")}
REMEMBERED = 8  # compilations

AFFINE = (int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE))


@dataclass(frozen=True)
class _Compilation:
    """A specification, and the model compiled from it; None where only compiled models are shared."""

    spec: mujoco.MjSpec | None
    model: mujoco.MjModel

    @property
    def has_simple_contacts(self) -> bool:
        """Whether the contact parameters of geoms go nowhere but into their own arrays."""
        return self.model.npair == 0 and self.model.nplugin == 0

    @property
    def has_free_timestep(self) -> bool:
        """Whether the timestep goes nowhere but into the options."""
        return self.model.nplugin == 0 and self.model.nhistory == 0


class ModelVariants:
    """Loads sources as `Source.load` does, and remembers what they have in common.

    Args:
      prepare: changes each model after its compilation.
    """

    def __init__(self, prepare: Callable[[mujoco.MjModel], None] | None = None) -> None:
        self._prepare = prepare
        self._compilations = OrderedDict[Source, _Compilation]()

    def load(self, source: Source) -> mujoco.MjModel:
        """The model of `source`; not to be changed: others may have the same.

        Raises:
          ModelError: it cannot be found or read, or MuJoCo refuses it.
          UsageError: an override names nothing, or its value does not fit.
        """
        copied = [override for override in source.overrides if _may_be_copied(override)]
        rest = tuple(override for override in source.overrides if override not in copied)
        if {_field(override) for override in copied} & {_field(override) for override in rest}:
            return self._compilation(source).model  # the last one of a field counts
        shared = self._compilation(replace(source, overrides=rest))
        if not copied:
            return shared.model
        if shared.spec is None or not all(_is_copied(shared, override) for override in copied):
            return self._compilation(source).model
        return _with_values(shared.spec, shared.model, copied)

    def _compilation(self, source: Source) -> _Compilation:
        compilation = self._compilations.pop(source, None) or self._compile(source)
        self._compilations[source] = compilation
        if len(self._compilations) > REMEMBERED:
            self._compilations.popitem(last=False)
        return compilation

    def _compile(self, source: Source) -> _Compilation:
        spec, model = source.compile()
        if self._prepare:
            model = copy.copy(model) if spec is None else model  # which may be the user's own
            self._prepare(model)
        return _Compilation(spec, model)


def _field(override: Override) -> str:
    return override.target.rpartition(".")[2]


def _may_be_copied(override: Override) -> bool:
    """Whether an override is of a field that the compiler copies, as far as its path and value tell."""
    try:
        numbers = [float(part) for part in override.value.replace(",", " ").split()]
    except ValueError:
        return False
    kind, slash, _ = override.target.partition("/")
    field = _field(override)
    known = f"{kind}.{field}" in COPIED if slash else override.target == f"opt.{field}" and field in OPTIONS
    if field == "biasprm" and override.index not in (0, 1):
        return False  # the third is a damping ratio if it is positive
    any_sign = field in ("gravity", "wind", "magnetic", "biasprm")
    is_positive = override.operation != "add" and all(number > 0 for number in numbers)
    return known and all(map(math.isfinite, numbers)) and (any_sign or is_positive)


def _is_copied(shared: _Compilation, override: Override) -> bool:
    """Whether nothing else in this model follows from the field."""
    assert shared.spec
    kind = override.target.partition("/")[0]
    if kind == "geom":
        return shared.has_simple_contacts
    if kind == "actuator":
        elements, _ = elements_at(shared.spec, override)
        return all(_has_plain_gains(element) for element in elements)
    return override.target != "opt.timestep" or shared.has_free_timestep


def _has_plain_gains(actuator: Any) -> bool:
    # A positive third bias is a damping ratio, which the compiler turns into a damping; muscles have computed gains.
    is_fixed = int(actuator.gaintype) == int(mujoco.mjtGain.mjGAIN_FIXED) and int(actuator.biastype) in AFFINE
    return is_fixed and not actuator.biasprm[2] > 0 and int(actuator.dyntype) != int(mujoco.mjtDyn.mjDYN_MUSCLE)


def _with_values(spec: mujoco.MjSpec, compiled: mujoco.MjModel, overrides: Sequence[Override]) -> mujoco.MjModel:
    """A copy of a compiled model with overrides that the compiler would only copy."""
    model = copy.copy(compiled)
    restore: list[Callable[[], None]] = []
    try:
        for override in overrides:
            with concerning(*override.option_path):
                restore.append(_written(spec, model, override))
    finally:
        for each in reversed(restore):
            each()
    return model


def _written(spec: mujoco.MjSpec, model: mujoco.MjModel, override: Override) -> Callable[[], None]:
    """Writes one override into `model`, by way of `spec`, and returns what undoes it there."""
    kind, slash, _ = override.target.partition("/")
    field = _field(override)
    elements = elements_at(spec, override)[0] if slash else [spec.option]
    before = [np.array(getattr(element, field)) for element in elements]

    def undo() -> None:
        for element, value in zip(elements, before, strict=True):
            setattr(element, field, value if value.ndim else float(value))

    try:
        apply(spec, override)
    except BaseException:
        undo()
        raise
    for element in elements:
        if slash:
            array = getattr(model, COPIED[f"{kind}.{field}"])
            array[element.id] = getattr(element, field)
        elif field in ("gravity", "wind", "magnetic"):
            getattr(model.opt, field)[:] = getattr(element, field)
        else:
            setattr(model.opt, field, getattr(element, field))
    return undo
