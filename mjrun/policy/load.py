"""Policies by the text that names them: files, Python code, and the built-in ones."""

import copy
import inspect
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import cast

import numpy as np

from mjrun.errors import ControllerError, UsageError, clean, option, quoted, suggestion
from mjrun.formats.input_file import is_file, is_folder
from mjrun.formats.user_cache import FileDigestCache
from mjrun.options.policy import BUILT_IN, NONE, RANDOM, ZERO, is_code
from mjrun.policy.loaders import format_of, formats
from mjrun.policy.normalization import normalized
from mjrun.policy.policy import ActionSpace, Actor, Policy
from mjrun.python_code import RedirectedFunction, code_of_file, load_code, made, own_copy

STREAM = 1_886_350_441  # separates the random numbers of policies from those of tasks
FORM = (
    "FILE.py:NAME or PACKAGE.MODULE:NAME names a function (observation) that returns the action, or a class or object "
    "with act(observation), or predict(observation) as in Stable-Baselines3, and reset() if it is stateful"
)

digests = FileDigestCache()  # of the files of policies


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
