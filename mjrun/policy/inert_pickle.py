"""Pickles read without running them: arrays become arrays, and every other object only its name and its values.

A pickle names functions and calls them as it is read. Here each name stands for a class that does nothing, but for the
few of NumPy's that make arrays.
"""

import pickle
from collections import OrderedDict
from pathlib import Path
from typing import cast

import numpy as np
from numpy._core import multiarray, numeric  # pyright: ignore

from mjrun.formats.input_file import decoding, opened

SUFFIXES = (".pkl", ".pickle")


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
        pass

    def append(self, value: object) -> None:
        pass


def _empty_array(*_: object) -> np.ndarray:
    """An array whose shape and values are set next."""
    return np.ndarray((0,), np.int8)


def _latin(text: str, encoding: str) -> bytes:
    """The bytes that old protocols write as text."""
    return text.encode("latin1")


# The names that mean something: those by which NumPy writes arrays and numbers.
MAKERS = {
    **{
        (f"numpy.{core}.multiarray", name): make
        for core in ("core", "_core")
        for name, make in (("_reconstruct", _empty_array), ("scalar", multiarray.scalar))
    },
    **{
        (f"numpy.{core}.numeric", "_frombuffer"): numeric._frombuffer  # pyright: ignore[reportAttributeAccessIssue]
        for core in ("core", "_core")
    },
    ("numpy", "ndarray"): np.ndarray,
    ("numpy", "dtype"): np.dtype,
    ("_codecs", "encode"): _latin,
    ("collections", "OrderedDict"): OrderedDict,
}


class _Reader(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> object:
        return MAKERS.get((module, name)) or type(name, (Inert,), {"name": f"{module}.{name}"})


def read_inert(path: Path) -> object:
    """What the pickle at `path` holds.

    Raises:
      FileError: it cannot be read, or is none.
    """
    with opened(path, "pickle", SUFFIXES) as file, decoding(path, "is no pickle, or a damaged one"):
        return _Reader(file).load()
