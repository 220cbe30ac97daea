"""Normalization of observations by the statistics of a policy's training, read from untrusted files.

A pickle names functions and calls them while it is read. Here each name is replaced by a class without effect, except
for the few names by which NumPy writes arrays; their numbers are kept as bytes until they are used.
"""

import math
import pickle
import re
from collections.abc import Sequence
from pathlib import Path
from typing import cast

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import FileError, UsageError, clean, counted, option
from mjrun.formats.input_file import decoding, opened
from mjrun.formats.npy_reader import read_arrays
from mjrun.policy.policy import ActionSpace, Actor, Policy

PICKLES = (".pkl", ".pickle")
SUFFIXES = (*PICKLES, ".npz")
EPSILON = 1e-8  # VecNormalize's default
DAMAGED = "is not a pickle, or is damaged"


@dataclass(frozen=True)
class NormalizationStatistics:
    """Statistics for `clip((observation - mean)/sqrt(var + epsilon), -clip, clip)`, as in VecNormalize.

    Attributes:
      mean, var: `(nobs,)`, float64.
      path: the path of their file.
    """

    mean: np.ndarray
    var: np.ndarray
    epsilon: float
    clip: float
    path: Path

    def normalize(self, observation: np.ndarray) -> np.ndarray:
        """Returns the float32 numbers of VecNormalize, to the bit."""
        normalized = (observation - self.mean) / np.sqrt(self.var + self.epsilon)
        return np.clip(normalized, -self.clip, self.clip).astype(np.float32)


class NormalizedPolicy(Policy):
    """A policy with normalized observations.

    Raises:
      UsageError: the statistics are of an observation of another size.
    """

    def __init__(self, policy: Policy, statistics: NormalizationStatistics) -> None:
        super().__init__(policy.name, policy.facts)
        self._policy, self._statistics = policy, statistics
        expected = policy.facts.observation_size
        if expected is not None:
            self._require_size(expected, f"{option('policy')} {clean(policy.name)} observes {expected}")

    def start(self, seed: int, actions: ActionSpace) -> Actor:
        actor = self._policy.start(seed, actions)

        def act(observation: np.ndarray) -> np.ndarray:
            self._require_size(len(observation), f"the task has {len(observation)}")
            return actor(self._statistics.normalize(observation))

        return act

    def _require_size(self, size: int, other: str) -> None:
        mean, path = self._statistics.mean, self._statistics.path
        if len(mean) != size:
            what = f"{option('normalize')} {clean(str(path))} has statistics of {counted(len(mean), 'number')}"
            raise UsageError(f"{what}, and {other}")


def normalized(policy: Policy, path: Path) -> Policy:
    """Returns `policy` with the statistics at `path`, or unchanged if they are of rewards alone.

    Raises:
      FileError: the file cannot be read, or contains no statistics.
      UsageError: the statistics do not have the size of the observation.
    """
    statistics = read_statistics(path)
    return policy if statistics is None else NormalizedPolicy(policy, statistics)


def read_statistics(path: Path) -> NormalizationStatistics | None:
    """Reads the statistics in a file, without running code of a pickle.

    Returns:
      The statistics; None if VecNormalize did not normalize observations.

    Raises:
      FileError: the file cannot be read, or contains no statistics.
      UsageError: its suffix is unknown.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        expected = f"{', '.join(SUFFIXES)}, or none"
        raise UsageError(f"{option('normalize')}: {clean(str(path))} is not a file of statistics: expected {expected}")
    if suffix == ".npz":
        with opened(path, "file of statistics", SUFFIXES) as file, decoding(path, "cannot be read as .npz"):
            values: dict[str, object] | None = {
                "epsilon": EPSILON,
                "clip": math.inf,
                **read_arrays(path, file, ("mean", "var", "epsilon", "clip")),
            }
    else:
        values = _vec_normalize(path)
    return None if values is None else _statistics(values, path)


def _vec_normalize(path: Path) -> dict[str, object] | None:
    root = read_inert(path)
    state = root.values if isinstance(root, InertPickledObject) and root.name.endswith(".VecNormalize") else {}
    if not state:
        raise FileError(path, "is not a VecNormalize of Stable-Baselines3")
    if state.get("norm_obs") is False:
        return None
    running = state.get("obs_rms")
    if not isinstance(running, InertPickledObject):
        raise FileError(path, "contains statistics of several observations by name; only one is supported")
    return {**running.values, "epsilon": state.get("epsilon"), "clip": state.get("clip_obs")}


def _statistics(values: dict[str, object], path: Path) -> NormalizationStatistics:
    try:
        mean, var = (np.asarray(values[name], np.float64) for name in ("mean", "var"))
        epsilon, clip = (float(cast("float", values[name])) for name in ("epsilon", "clip"))
    except (KeyError, TypeError, ValueError) as error:
        raise FileError(path, "lacks statistics: mean, var, epsilon and clip") from error
    fits = mean.ndim == 1 and mean.shape == var.shape and len(mean) > 0
    if not fits or not (np.isfinite(mean).all() and np.isfinite(var).all() and (var + epsilon > 0).all() and clip > 0):
        reason = "its mean and var must be two lists of equally many finite numbers, with var of at least 0"
        raise FileError(path, reason)
    return NormalizationStatistics(mean, var, epsilon, clip, path)


class InertPickledObject:
    """A replacement of any object of a pickle.

    Attributes:
      name: the name of the object's class, `package.module.Class`.
      values: the object's attributes.
    """

    name = ""
    values: dict[str, object]

    def __new__(cls, *arguments: object, **keywords: object) -> "InertPickledObject":
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
        """Accepts an item of a list, and discards it."""


class _PickledDtype:
    """The type of an array's numbers, pickled as `numpy.dtype`."""

    def __init__(self, code: object = "", *_: object) -> None:
        self._code = code
        self._order: object = "="

    def __setstate__(self, state: Sequence[object]) -> None:
        self._order = state[1]

    def dtype(self) -> np.dtype:
        """Returns the type; raises ValueError if it is not a type of numbers."""
        if not re.fullmatch(r"[fiub][1248]", str(self._code)) or self._order not in ("<", ">", "=", "|"):
            raise ValueError(f"its numbers have the unsupported type {self._code}")
        return np.dtype(f"{self._order}{self._code}")


class _PickledArray:
    """An array that `numpy.asarray` converts; it raises ValueError if the array does not hold numbers."""

    def __init__(self, *_: object) -> None:
        self._state: Sequence[object] = ()

    def __setstate__(self, state: Sequence[object]) -> None:
        self._state = state

    def __array__(self, dtype: object = None, copy: object = None) -> np.ndarray:
        if len(self._state) != 5:
            raise ValueError("an array lacks its numbers")
        _, shape, of, is_fortran, content = self._state
        if (
            not isinstance(of, _PickledDtype)
            or not isinstance(content, bytes | bytearray)
            or not isinstance(shape, tuple)
        ):
            raise ValueError("an array does not hold numbers")
        numbers = np.frombuffer(content, of.dtype())
        sizes = cast("tuple[object, ...]", shape)
        known = [size for size in sizes if isinstance(size, int) and size >= 0]
        if len(known) != len(sizes) or math.prod(known) != len(numbers):
            raise ValueError("the shape of an array does not fit its numbers")
        return numbers.reshape(known, order="F" if is_fortran else "C").astype(cast("np.dtype", dtype or of.dtype()))


def _array(content: object, of: object, shape: object, order: object) -> _PickledArray:
    """Returns an array written by the newest protocol."""
    array = _PickledArray()
    array.__setstate__((1, shape, of, order == "F", content))
    return array


def _number(of: object, content: object) -> _PickledArray:
    """Returns a single number of NumPy's."""
    return _array(content, of, (), "C")


def _latin(text: str, encoding: str) -> bytes:
    """Returns the bytes that old protocols write as text."""
    return text.encode("latin1")


# The names with an effect: those by which NumPy writes arrays and numbers.
CORES = ("numpy.core", "numpy._core")
MAKERS: dict[tuple[str, str], object] = {
    **{(f"{core}.multiarray", "_reconstruct"): _PickledArray for core in CORES},
    **{(f"{core}.multiarray", "scalar"): _number for core in CORES},
    **{(f"{core}.numeric", "_frombuffer"): _array for core in CORES},
    ("numpy", "dtype"): _PickledDtype,
    ("_codecs", "encode"): _latin,
}


class _Reader(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> object:
        return MAKERS.get((module, name)) or type(
            "InertPickledObject", (InertPickledObject,), {"name": f"{module}.{name}"}
        )


def read_inert(path: Path) -> object:
    """Reads the pickle at `path`, without running its code.

    Raises:
      FileError: it cannot be read, or is not a pickle.
    """
    with opened(path, "pickle", PICKLES) as file, decoding(path, DAMAGED):
        try:
            return _Reader(file).load()
        except MemoryError:  # a length beyond the end of the file
            raise FileError(path, f"{DAMAGED}: it ends early") from None
