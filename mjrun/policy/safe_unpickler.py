"""Pickles read without running them: every object is only its name and its values, and arrays can be had of them.

A pickle names functions and calls them as it is read. Here each name stands for a class that does nothing, but for the
few by which NumPy writes arrays, whose numbers are kept as bytes until they are asked for.
"""

import math
import pickle
import re
from collections.abc import Sequence
from pathlib import Path
from typing import cast

import numpy as np

from mjrun.errors import FileError
from mjrun.formats.input_file import decoding, opened

SUFFIXES = (".pkl", ".pickle")
FAULT = "is no pickle, or a damaged one"


class Inert:
    """What stands for an object of a pickle.

    Attributes:
      name: of its class, `package.module.Class`.
      values: its attributes.
    """

    name = ""
    values: dict[str, object]

    def __new__(cls, *arguments: object, **keywords: object) -> "Inert":
        self = super().__new__(cls)
        self.values = {}
        return self

    def __init__(self, *arguments: object, **keywords: object) -> None:
        pass

    def __setstate__(self, state: object) -> None:
        if isinstance(state, dict):
            self.values = cast("dict[str, object]", state)

    def __setitem__(self, key: object, value: object) -> None:
        if isinstance(key, str):  # of a mapping
            self.values[key] = value

    def append(self, value: object) -> None:
        """Takes an item of a list, and forgets it."""


class PickledDtype:
    """The type of an array's numbers, as `numpy.dtype` is pickled."""

    def __init__(self, code: object = "", *_: object) -> None:
        self._code = code
        self._order: object = "="

    def __setstate__(self, state: Sequence[object]) -> None:
        self._order = state[1]

    def dtype(self) -> np.dtype:
        """The type; raises ValueError if it is none of numbers."""
        if not re.fullmatch(r"[fiub][1248]", str(self._code)) or self._order not in ("<", ">", "=", "|"):
            raise ValueError(f"its numbers are of the type {self._code}")
        return np.dtype(f"{self._order}{self._code}")


class PickledArray:
    """An array, which `numpy.asarray` turns into one of NumPy's; ValueError if it is none of numbers."""

    def __init__(self, *_: object) -> None:
        self._state: Sequence[object] = ()

    def __setstate__(self, state: Sequence[object]) -> None:
        self._state = state

    def __array__(self, dtype: object = None, copy: object = None) -> np.ndarray:
        if len(self._state) != 5:
            raise ValueError("an array lacks its numbers")
        _, shape, of, is_fortran, content = self._state
        if (
            not isinstance(of, PickledDtype)
            or not isinstance(content, bytes | bytearray)
            or not isinstance(shape, tuple)
        ):
            raise ValueError("an array does not hold numbers")
        numbers = np.frombuffer(content, of.dtype())
        sizes = cast("tuple[int, ...]", shape)
        if not all(isinstance(size, int) and size >= 0 for size in sizes) or math.prod(sizes) != len(numbers):
            raise ValueError("an array has another shape than numbers")
        return numbers.reshape(sizes, order="F" if is_fortran else "C").astype(cast("np.dtype", dtype or of.dtype()))


def _array(content: object, of: object, shape: object, order: object) -> PickledArray:
    """As the newest protocol writes arrays."""
    array = PickledArray()
    array.__setstate__((1, shape, of, order == "F", content))
    return array


def _number(of: object, content: object) -> PickledArray:
    """A single number of NumPy's."""
    return _array(content, of, (), "C")


def _latin(text: str, encoding: str) -> bytes:
    """The bytes that old protocols write as text."""
    return text.encode("latin1")


# The names that mean something: those by which NumPy writes arrays and numbers.
CORES = ("numpy.core", "numpy._core")
MAKERS: dict[tuple[str, str], object] = {
    **{(f"{core}.multiarray", "_reconstruct"): PickledArray for core in CORES},
    **{(f"{core}.multiarray", "scalar"): _number for core in CORES},
    **{(f"{core}.numeric", "_frombuffer"): _array for core in CORES},
    ("numpy", "dtype"): PickledDtype,
    ("_codecs", "encode"): _latin,
}


class _Reader(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> object:
        return MAKERS.get((module, name)) or type("Inert", (Inert,), {"name": f"{module}.{name}"})


def read_inert(path: Path) -> object:
    """What the pickle at `path` holds.

    Raises:
      FileError: it cannot be read, or is none.
    """
    with opened(path, "pickle", SUFFIXES) as file, decoding(path, FAULT):
        try:
            return _Reader(file).load()
        except MemoryError:  # from the length of something that is not there
            raise FileError(path, f"{FAULT}: it is shorter than it says") from None
