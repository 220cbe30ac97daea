"""Variants of one model, compiled fast: overrides of numbers share a compilation.

Fields that the compiler only copies are written into a copy of the model: numbers in `opt`, the contact parameters of
geoms, and the gains of simple actuators. For other numbers of elements, such as positions, sizes and masses, a
specification that is parsed once is recompiled; the first models are compared with compilations of the source. All
other overrides are compiled, as are values that the compiler may refuse. In every case the model is byte for byte the
one that compiling the source with all overrides gives.
"""

import copy
from collections import OrderedDict
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import replace
from operator import is_
from types import MappingProxyType

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import MjrunError
from mjrun.model.compiler_copied_fields import (
    COPIED_ARRAYS,
    CompilerCopiedFields,
    CopiedElementNumbers,
    Rows,
    field_of,
    may_be_copied,
)
from mjrun.model.fields import VariedModel, read_array, restore_array, write_array
from mjrun.model.override import Override
from mjrun.model.recompilation import ChangedBodyCompiler, DerivedNumbersComputer, Recompiler, may_be_recompiled
from mjrun.model.source import ModelSource, model_fingerprint

PROOFS = 2  # recompilations with the same paths that are compared with compilations of the source
REMEMBERED = 8  # compilations
REMEMBERED_BYTES = 2**27  # memory for them
BYTES = 2**25  # memory for models of simulations side by side; more models are no faster, as measured
# Bytes of a model beside its buffer: 100 KB of Python objects, and 150 KB of gaps that compiling the next one leaves.
MODEL_BYTES = 2**18
SPEC_SIZE = 3  # a specification with its processed meshes takes up to 2.4 times the memory of its model, as measured


class ModelVariant:
    """A model that differs from a compilation only in numbers.

    Args:
      model: the model, if it exists already.

    Attributes:
      compilation: the compilation.
      arrays: the arrays with other numbers, whole, by name, except derived ones and those of a recompilation.
      derived: the names of arrays that were computed from the others.
      is_recompiled: whether it was recompiled, so that any array may differ.
    """

    def __init__(
        self,
        compilation: "SharedCompilation",
        arrays: Mapping[str, np.ndarray] = MappingProxyType({}),
        model: mujoco.MjModel | None = None,
        *,
        derived: Sequence[str] = (),
        is_recompiled: bool = False,
    ) -> None:
        self.compilation, self.arrays = compilation, arrays
        self.derived, self.is_recompiled = derived, is_recompiled
        self._model = compilation.model if model is None and not arrays else model

    @property
    def model(self) -> mujoco.MjModel:
        """The model, which may be the compiled one; otherwise it is made when it is first asked for."""
        if self._model is None:
            self._model = self.compilation.model_with(self.arrays)
        return self._model

    @property
    def compiled(self) -> mujoco.MjModel:
        """The compiled model, which may be `model` itself."""
        return self.compilation.model

    @property
    def has_copy(self) -> bool:
        """True once a copy of the compiled model has been made for it."""
        return self._model is not None and self._model is not self.compiled

    @property
    def differs_as_copied(self) -> bool:
        """True if it equals the compiled model except in copied fields."""
        return self.arrays.keys() <= COPIED_ARRAYS and not self.derived and not self.is_recompiled


def model_bytes(model: mujoco.MjModel) -> int:
    """Returns the approximate memory that a model needs [bytes]."""
    return mujoco.mj_sizeModel(model) + MODEL_BYTES


def models_side_by_side(variants: Sequence[ModelVariant]) -> Sequence[mujoco.MjModel] | VariedModel:
    """Returns the models of variants, as arrays of one model where they differ in copied fields only."""
    first = variants[0].compilation
    names = dict.fromkeys(name for variant in variants for name in variant.arrays)
    if not names or not all(each.compilation is first and each.differs_as_copied for each in variants):
        return [variant.model for variant in variants]
    compiled = {name: read_array(first.model, name) for name in names}
    arrays = {name: np.array([variant.arrays.get(name, compiled[name]) for variant in variants]) for name in names}
    return VariedModel(first.model, arrays)


class VariantLoader:
    """A loader of sources like `ModelSource.load`, which caches their common compilations within `REMEMBERED_BYTES`.

    The latest compilation is cached whatever its size.

    Args:
      prepare: a function that sets flags of each model after its compilation.
    """

    def __init__(self, prepare: Callable[[mujoco.MjModel], None] | None = None) -> None:
        self._prepare = prepare
        self._compilations = OrderedDict[ModelSource, SharedCompilation]()
        self._compiled_once = dict[
            ModelSource, ModelSource
        ]()  # the last source that was compiled, by that without overrides
        self._copied_over = dict[ModelSource, ModelSource]()  # likewise the last one whose copied fields vary
        self._last: _CopiedPaths | None = None
        self._same: tuple[ModelSource, SharedCompilation] | None = None  # the last one that is loaded unchanged

    def load(self, source: ModelSource) -> ModelVariant:
        """Returns the model of `source`; it must not be changed, because others may share it.

        Raises:
          ModelError: it cannot be found or read, or MuJoCo refuses it.
          UsageError: an override refers to nothing, or its value does not fit.
        """
        if self._same and self._same[0] is source:
            return ModelVariant(self._same[1])
        last = self._last
        if last and last.fits(source) and (variant := last.variant(source)):
            return variant
        if source not in self._compilations and (variant := self._copied(source) or self._recompiled(source)):
            return variant
        compilation = self._compilation(source)
        self._same = source, compilation
        return ModelVariant(compilation)

    def add(self, source: ModelSource, spec: mujoco.MjSpec | None, model: mujoco.MjModel) -> None:
        """Adds what `source.compile` has returned, so that it is not compiled again; `prepare` is not called."""
        self._compilations[source] = SharedCompilation(spec, model)

    def reuse(self, variant: ModelVariant) -> None:
        """Returns a variant that is no longer used: a later one of the same compilation may overwrite it."""
        home = variant.compilation
        if variant.has_copy and home.spec and self._bytes + home.size <= REMEMBERED_BYTES:
            home.unused.append(variant)

    def _copied(self, source: ModelSource) -> ModelVariant | None:
        """Returns a model that differs from a compilation, which is cached, in copied fields, or None."""
        to_copy, rest = _parted(source.overrides, may_be_copied)
        if not to_copy:
            return None
        shared, bare = replace(source, overrides=rest), replace(source, overrides=())
        is_worth_it = not rest or shared in self._compilations or self._copied_over.get(bare) == shared
        self._copied_over[bare] = shared
        if not is_worth_it:
            return None
        compilation = self._compilation(shared)
        self._last = None if rest else _CopiedPaths(source, compilation)
        return compilation.with_values(to_copy)

    def _recompiled(self, source: ModelSource) -> ModelVariant | None:
        """Returns a model that is recompiled with numbers that vary; None if it must be compiled from the source."""
        options, rest = _parted(source.overrides, _is_copied_option)
        if not rest or not all(map(may_be_recompiled, rest)):
            return None
        bare = replace(source, overrides=())
        if self._compiled_once.setdefault(bare, source) == source:  # the next one shows whether overrides vary
            return None
        try:
            compilation = self._compilation(bare)
        except MjrunError:  # overrides may make it valid
            return None
        reference: str | None = None
        for make in (SharedCompilation.with_parts, SharedCompilation.recompiled):
            proof = compilation.proofs.setdefault((make.__name__, _paths(rest)), _Proof())
            variant = make(compilation, options, rest) if proof.can_succeed else None
            if variant and not proof.is_complete:
                reference = reference or model_fingerprint(self._compile(source).model)
                proof.add(model_fingerprint(variant.model) == reference)
            if variant and proof.can_succeed:
                return variant
        return None

    @property
    def _bytes(self) -> int:
        return sum(compilation.bytes for compilation in self._compilations.values())

    def _compilation(self, source: ModelSource) -> "SharedCompilation":
        compilation = self._compilations.pop(source, None) or self._compile(source)
        self._compilations[source] = compilation
        while len(self._compilations) > 1 and (len(self._compilations) > REMEMBERED or self._bytes > REMEMBERED_BYTES):
            _, oldest = self._compilations.popitem(last=False)
            oldest.forget_source()  # its model may still be in use
        return compilation

    def _compile(self, source: ModelSource) -> "SharedCompilation":
        spec, model = source.compile()
        if self._prepare:
            model = copy.copy(model) if spec is None else model  # it may belong to the user
            self._prepare(model)
        return SharedCompilation(spec, model)


class _CopiedPaths:
    """Sources that differ only in the values of overrides of copied fields, which is faster to see than to search.

    Args:
      source: one of these sources.
      compilation: the compilation of the source without overrides.
    """

    def __init__(self, source: ModelSource, compilation: "SharedCompilation") -> None:
        self._compilation = compilation
        self._paths = [override.path for override in source.overrides]
        self._others = [value for name, value in vars(source).items() if name != "overrides"]

    def fits(self, source: ModelSource) -> bool:
        """Returns whether `source` is one of these sources, with the very same values of all other attributes."""
        others = [value for name, value in vars(source).items() if name != "overrides"]
        is_same = len(others) == len(self._others) and all(map(is_, others, self._others))
        return is_same and [override.path for override in source.overrides] == self._paths

    def variant(self, source: ModelSource) -> ModelVariant | None:
        """Returns the model of `source`; None if it must be compiled."""
        return self._compilation.with_values(source.overrides) if all(map(may_be_copied, source.overrides)) else None


@dataclass
class _Proof:
    """The comparisons of models made in one way from overrides of the same fields with compilations of the source."""

    same: int = 0
    can_succeed: bool = True

    @property
    def is_complete(self) -> bool:
        return self.same >= PROOFS

    def add(self, is_same: bool) -> None:
        """Adds a comparison."""
        self.same += is_same
        self.can_succeed = self.can_succeed and is_same


class SharedCompilation:
    """A specification and the model compiled from it; without a specification, only the compiled model is shared.

    It is part of no reference cycle: Python's garbage collector, which counts objects, would let hundreds of models
    accumulate before it frees the first.

    Attributes:
      size: the memory of the model [bytes].
      unused: variants of the model that may be overwritten.
      proofs: the results of comparisons, by the way in which models are made and the paths of the overrides.
    """

    def __init__(self, spec: mujoco.MjSpec | None, model: mujoco.MjModel) -> None:
        self.spec, self.model = spec, model
        self.size = model_bytes(model)
        self.unused: list[ModelVariant] = []
        self._copied = CompilerCopiedFields(spec, model) if spec else None
        self._recompiler: Recompiler | None = None
        self._partial: ChangedBodyCompiler | None = None
        self._elements: CopiedElementNumbers | None = None
        self._derived: DerivedNumbersComputer | None = None
        self.proofs = dict[object, _Proof]()

    @property
    def bytes(self) -> int:
        """The approximate memory that it needs [bytes]."""
        return self.size * (1 + len(self.unused) + (SPEC_SIZE if self.spec else 0))

    def forget_source(self) -> None:
        """Drops everything except the model."""
        self.spec = self._copied = self._recompiler = self._partial = self._elements = self._derived = None
        self.unused.clear()

    def with_values(self, overrides: Sequence[Override]) -> ModelVariant | None:
        """Returns the model with overrides of copied fields; None if it must be compiled."""
        changed = self._copied.changed(overrides) if self._copied else None
        return None if changed is None else ModelVariant(self, self._whole(changed))

    def model_with(self, arrays: Mapping[str, np.ndarray]) -> mujoco.MjModel:
        """Returns a copy of the model with other arrays."""
        model = self._copy(arrays)
        for name, values in arrays.items():
            write_array(model, name, values)
        return model

    def with_parts(self, options: Sequence[Override], rest: Sequence[Override]) -> ModelVariant | None:
        """Returns the model with overrides of copied options and of numbers in a few bodies; None if that fails."""
        changed = self._copied.changed(options) if self._copied else None
        if changed is None or self.spec is None:
            return None
        self._elements = self._elements or CopiedElementNumbers(self.spec, self.model)
        of_bodies = self._elements.changed(rest)
        has_effects = of_bodies is None or self._elements.have_effects(rest)
        if of_bodies is None:
            of_bodies = self._part_compiler.changed(rest)
        if of_bodies is None:
            return None
        arrays = self._whole(changed | of_bodies)
        model = self.model_with(arrays)
        if not has_effects:
            return ModelVariant(self, arrays, model)
        self._derived = self._derived or DerivedNumbersComputer(self.spec, self.model)
        if not self._derived.compute(model):
            return None
        return ModelVariant(self, arrays, model, derived=self._derived.arrays)

    def recompiled(self, options: Sequence[Override], rest: Sequence[Override]) -> ModelVariant | None:
        """Returns the model with overrides of copied options, recompiled with all others; None if that fails."""
        changed = self._copied.changed(options) if self._copied else None
        compiled = self._whole_compiler.model(rest) if self.spec else None
        if changed is None or compiled is None:
            return None
        arrays = self._whole(changed)
        model = self._copy(arrays, of_arrays=False)
        self._whole_compiler.write(compiled, model)
        for name, values in arrays.items():
            write_array(model, name, values)
        return ModelVariant(self, arrays, model, is_recompiled=True)

    @property
    def _whole_compiler(self) -> Recompiler:
        if self._recompiler is None:
            assert self.spec
            self._recompiler = Recompiler(self.spec, self.model)
        return self._recompiler

    @property
    def _part_compiler(self) -> ChangedBodyCompiler:
        if self._partial is None:
            whole = self._whole_compiler
            self._partial = ChangedBodyCompiler(whole.spec, self.model, whole.is_number)
        return self._partial

    def _copy(self, overwritten: Container[str], *, of_arrays: bool = True) -> mujoco.MjModel:
        """Returns a copy of the model, if possible one that is no longer used, where some arrays may differ.

        Args:
          overwritten: the arrays and options that may differ.
          of_arrays: whether arrays that a recompilation has changed are restored.
        """
        if not self.unused:
            return copy.copy(self.model)
        unused = self.unused.pop()
        if unused.is_recompiled and of_arrays:
            self._whole_compiler.write(self.model, unused.model)
        for array in (*unused.arrays, *unused.derived):
            if array not in overwritten:
                restore_array(unused.model, array, self.model)
        return unused.model

    def _whole(self, changed: Mapping[str, Rows]) -> dict[str, np.ndarray]:
        """Returns whole arrays of which some rows are changed; the others are those of the compiled model."""
        arrays = {name: read_array(self.model, name) for name in changed}
        for name, (rows, values) in changed.items():
            arrays[name][rows] = values
        return arrays


def _parted(
    overrides: Sequence[Override], is_chosen: Callable[[Override], bool]
) -> tuple[tuple[Override, ...], tuple[Override, ...]]:
    """Parts overrides into chosen and other ones; chooses none if both are of one field, where the last one counts."""
    chosen = tuple(override for override in overrides if is_chosen(override))
    others = tuple(override for override in overrides if not is_chosen(override))
    is_clear = {field_of(override) for override in chosen}.isdisjoint(map(field_of, others))
    return (chosen, others) if is_clear else ((), tuple(overrides))


def _paths(overrides: Sequence[Override]) -> frozenset[str]:
    return frozenset(override.path for override in overrides)


def _is_copied_option(override: Override) -> bool:
    return override.target.startswith("opt.") and may_be_copied(override)
