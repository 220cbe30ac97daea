"""Policies by the text that names them: files, Python code, and the built-in ones; and normalization of observations.

The statistics of a policy's training are read from untrusted files. A pickle names functions and calls them while it is
read. Here each name is replaced by a class without effect, except for the few names by which NumPy writes arrays; their
numbers are kept as bytes until they are used.
"""

import copy
import inspect
import math
import pickle
import re
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import cast

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import ControllerError, FileError, UsageError, clean, counted, option, quoted, suggestion
from mjrun.formats.input_file import decoding, is_file, is_folder, opened
from mjrun.formats.npy_reader import read_arrays
from mjrun.formats.user_cache import FileDigestCache
from mjrun.options.policy import BUILT_IN, NONE, RANDOM, ZERO, is_code
from mjrun.policy.loaders import format_of, formats
from mjrun.policy.policy import ActionSpace, Actor, Policy
from mjrun.python_code import RedirectedFunction, code_of_file, load_code, made, own_copy, same_working_directory

STREAM = 1_886_350_441  # separates the random numbers of policies from those of tasks
FORM = (
    "FILE.py:NAME or PACKAGE.MODULE:NAME names a function (observation) that returns the action, or a class or object "
    "with act(observation), or predict(observation) as in Stable-Baselines3, and reset() if it is stateful"
)

digests = FileDigestCache()  # of the files of policies
PICKLES = (".pkl", ".pickle")
SUFFIXES = (*PICKLES, ".npz")
EPSILON = 1e-8  # VecNormalize's default
DAMAGED = "is not a pickle, or is damaged"


class RandomPolicy(Policy):
    """A policy of uniformly random actions within the clip of the task, or within [-1, 1] without one."""

    def __init__(self) -> None:
        super().__init__(RANDOM)

    def start(self, seed: int, actions: ActionSpace) -> Actor:
        low = np.where(np.isfinite(actions.low), actions.low, np.minimum(-1, actions.high - 2))
        high = np.where(np.isfinite(actions.high), actions.high, np.maximum(1, low + 2))
        generator = np.random.default_rng([seed, STREAM])
        return lambda observation: generator.uniform(low, high)


class ZeroPolicy(Policy):
    """A policy whose actions are always zero."""

    def __init__(self) -> None:
        super().__init__(ZERO)

    def start(self, seed: int, actions: ActionSpace) -> Actor:
        return lambda observation: np.zeros(len(actions.names))


class PythonPolicy(Policy):
    """A policy in Python: a function, an object, or a class that is instantiated for each episode.

    An object is copied for each episode, so that episodes share no memory; without `reset`, only if it is of a class of
    the user's and can be copied.

    Raises:
      UsageError: the object cannot be called as a policy.
      ControllerError: its code failed.
    """

    def __init__(self, thing: object, name: str) -> None:
        super().__init__(name)
        self._thing = thing
        instance = self._instance()
        if not callable(instance) and not any(_method(instance, method) for method in ("act", "predict")):
            kind = type(instance).__name__
            raise UsageError(f"{option('policy')} {quoted(name)} is of type {kind}, which cannot act\n{FORM}")

    def start(self, seed: int, actions: ActionSpace) -> Actor:
        instance = self._instance()
        reset = _method(instance, "reset")
        if reset:
            arguments = (seed,) if _takes_one(reset) else ()
            with same_working_directory():
                self._guarded(reset)(*arguments)
        act, predict = _method(instance, "act"), _method(instance, "predict")
        if not act and predict:
            return _predicting(self._guarded(predict), _keywords(predict))
        function = self._guarded(act or cast("Callable[..., object]", instance))
        return lambda observation: cast("np.ndarray", function(observation.copy()))

    def _instance(self) -> object:
        if isinstance(self._thing, type):
            return made(self._thing, self.name, "policy")
        if not _method(self._thing, "reset"):
            return own_copy(self._thing)
        try:
            return copy.deepcopy(self._thing)
        except Exception as error:
            raise ControllerError.of(f"policy {quoted(self.name)}: copying it for an episode", error) from error

    def _guarded(self, function: Callable[..., object]) -> Callable[..., object]:
        redirected = RedirectedFunction(function)

        def guarded(*arguments: object, **keywords: object) -> object:
            try:
                return redirected(*arguments, **keywords)
            except (Exception, SystemExit) as error:
                raise ControllerError.of(f"policy {quoted(self.name)}", error) from error

        return guarded


def _predicting(predict: Callable[..., object], keywords: frozenset[str]) -> Actor:
    """Returns an actor that calls Stable-Baselines3's `predict` without noise, with the state that it returned last."""
    state: object = None
    is_start = True

    def act(observation: np.ndarray) -> np.ndarray:
        nonlocal state, is_start
        known = {"state": state, "episode_start": np.array([is_start]), "deterministic": True}
        answer = predict(observation.copy(), **{name: known[name] for name in known if name in keywords})
        action, state = answer, None
        if isinstance(answer, tuple) and len(cast("tuple[object, ...]", answer)) == 2:
            action, state = cast("tuple[object, object]", answer)
        is_start = False
        return cast("np.ndarray", action)

    return act


def _method(thing: object, name: str) -> Callable[..., object] | None:
    method = getattr(thing, name, None)
    return method if callable(method) else None


def _keywords(function: Callable[..., object]) -> frozenset[str]:
    try:
        return frozenset(inspect.signature(function).parameters)
    except (TypeError, ValueError):
        return frozenset()


def _takes_one(function: Callable[..., object]) -> bool:
    """Returns whether `function` can be called with one argument."""
    try:
        inspect.signature(function).bind(0)
    except (TypeError, ValueError):
        return False
    return True


def load_policy(
    text: object,
    *,
    trust: bool = False,
    normalize: str | None = None,
    place: Callable[[str | Path], Path] = Path,
) -> Policy:
    """Loads the policy that `text` names: a file, `random`, `zero` or code.

    In Python, `text` may also be a policy, a function or an object.

    Args:
      trust: opens files that can run code when they are opened.
      normalize: a file with statistics for the normalization of observations, `none`, or None if unspecified.
      place: resolves paths of files; the policy is named by its text in any case.

    Raises:
      UsageError: it is not a policy, is not trusted, or its normalization is unspecified.
      FileError: a file cannot be read, or is damaged.
      ControllerError: its code failed.
      MissingExtraError: a library that it needs is not installed.
    """
    stored = normalize if normalize in (None, NONE) else str(place(normalize))
    policy = _load(text, trust, stored, place)
    return policy if stored in (None, NONE) else normalized(policy, Path(stored))


def files_of(path: Path) -> list[Path]:
    """Returns the files of the policy at `path`, a file or a folder, the first being `path` itself if it is a file."""
    if is_folder(path):
        return sorted(file for file in path.rglob("*") if file.is_file())
    return _files_of(path, digests.of(str(path))) if is_file(path) else [path]


@lru_cache
def _files_of(path: Path, digest: str) -> list[Path]:
    loader = format_of(path)
    return list(dict.fromkeys(loader.files(path))) if loader else [path]


def _load(text: object, trust: bool, normalize: str | None, place: Callable[[str | Path], Path]) -> Policy:
    if isinstance(text, Policy):
        return text
    if not isinstance(text, str):
        return PythonPolicy(text, type(text).__name__)
    if text == RANDOM:
        return RandomPolicy()
    if text == ZERO:
        return ZeroPolicy()
    if is_code(text):
        return PythonPolicy(load_code(text, "policy", FORM), text)
    path = place(text)
    if loader := format_of(path):
        return loader.load(path, text, trust, normalize)
    if named := code_of_file(path):
        raise UsageError(f"{option('policy')} {clean(text)}: select one of its policies\n{named}")
    known = ", ".join([*formats(), "FILE.py:NAME", *BUILT_IN])
    raise UsageError(
        f"{option('policy')} {clean(text)}: unknown policy format{suggestion(text, BUILT_IN)}\nformats: {known}"
    )


# --- normalization of observations -------------------------------------------------------------------


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
        epsilon, clip = (np.asarray(values[name], np.float64).item() for name in ("epsilon", "clip"))
    except (KeyError, TypeError, ValueError, OverflowError) as error:
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
