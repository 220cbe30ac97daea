"""Recompilation of a model with other numbers, from a specification that is parsed once.

The specification is compiled without its images, whose bytes nothing else in a model depends on, and the result is
written over a copy of the model that has them.
"""

from collections.abc import Callable, Sequence
from functools import cache
from operator import attrgetter
from typing import Any

import mujoco
import numpy as np

from mjrun.errors import MjrunError
from mjrun.model.compilation import FAULTS, checked_arrays, invalid_number, lengthen_buffers
from mjrun.model.compiler_copied_fields import STATISTICS
from mjrun.model.fields import arrays
from mjrun.model.mujoco_globals import without_log
from mjrun.model.override import ELEMENTS, Override, apply, elements_at

# Arrays and sizes of images and of the names of files.
IMAGES, FILES = ("tex_",), ("paths", "_pathadr")
IMAGE_SIZES = ("ntexdata", "npaths", "nbuffer")
PATCHED_KINDS = ELEMENTS.keys() - {"texture", "sensor"}  # a source may append sensors after its overrides
STRUCTURAL = ("delay", "interval")  # numbers that determine the sizes of buffers


class Recompiler:
    """The specification of a model, which compiles to the same model with other numbers in its elements.

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
        return model if self._fits(model) else None

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
    return attrgetter(*(name for name in names if name not in IMAGE_SIZES))
