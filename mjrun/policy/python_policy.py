"""Policies that are Python: a function of the observation, or an object with `act` or Stable-Baselines3's `predict`."""

import copy
import inspect
from collections.abc import Callable
from functools import partial
from typing import cast

import numpy as np

from mjrun.errors import ControllerError, UsageError, option, quoted
from mjrun.policy.policy import ActionSpace, Actor, Policy
from mjrun.python_code import RedirectedFunction, load_code, made

FORM = (
    "FILE.py:NAME or PACKAGE.MODULE:NAME names a function (observation) that returns the action, or a class or object "
    "with act(observation), or predict(observation) as in Stable-Baselines3, and reset() if it remembers anything"
)
METHODS = ("act", "predict")


class PythonPolicy(Policy):
    """A function, an object, or a class, of which every episode gets an instance of its own.

    Objects with `reset` are copied for each episode, so that none remembers another's.
    """

    def __init__(self, thing: object, name: str) -> None:
        super().__init__(name)
        self._thing = thing
        self._check(self._instance())

    def start(self, seed: int, actions: ActionSpace) -> Actor:
        instance = self._instance()
        reset = _method(instance, "reset")
        if reset:
            arguments = (seed,) if _takes(reset, 1) else ()
            self._guarded(reset)(*arguments)
        act, predict = _method(instance, "act"), _method(instance, "predict")
        if not act and predict:
            return _PredictingActor(self._guarded(predict), _keywords(predict))
        return _PythonActor(self._guarded(act or cast("Callable[..., object]", instance)))

    def _instance(self) -> object:
        if isinstance(self._thing, type):
            return made(self._thing, self.name, "policy")
        if not _method(self._thing, "reset"):
            return self._thing
        try:
            return copy.deepcopy(self._thing)
        except Exception as error:
            raise ControllerError.of(
                f"{option('policy')} {quoted(self.name)}: copying it for an episode", error
            ) from error

    def _check(self, instance: object) -> None:
        if not callable(instance) and not any(_method(instance, name) for name in METHODS):
            kind = type(instance).__name__
            raise UsageError(f"{option('policy')} {quoted(self.name)} is of type {kind}, and cannot act\n{FORM}")

    def _guarded(self, function: Callable[..., object]) -> Callable[..., object]:
        def guarded(*arguments: object, **keywords: object) -> object:
            try:
                return RedirectedFunction(partial(function, **keywords))(*arguments)
            except (Exception, SystemExit) as error:
                raise ControllerError.of(f"{option('policy')} {quoted(self.name)}", error) from error

        return guarded


class _PythonActor:
    def __init__(self, act: Callable[..., object]) -> None:
        self._act = act

    def act(self, observation: np.ndarray) -> np.ndarray:
        return cast("np.ndarray", self._act(observation.copy()))


class _PredictingActor:
    """Calls `predict` as Stable-Baselines3 declares it: without noise, and with the state that it returned last."""

    def __init__(self, predict: Callable[..., object], keywords: frozenset[str]) -> None:
        self._predict, self._keywords = predict, keywords
        self._state: object = None
        self._is_start = True

    def act(self, observation: np.ndarray) -> np.ndarray:
        known = {"state": self._state, "episode_start": np.array([self._is_start]), "deterministic": True}
        answer = self._predict(observation.copy(), **{name: known[name] for name in known if name in self._keywords})
        action, self._state = answer if isinstance(answer, tuple) and len(answer) == 2 else (answer, None)
        self._is_start = False
        return cast("np.ndarray", action)


def load_python(code: str) -> PythonPolicy:
    """The policy that `code` names.

    Raises:
      UsageError: `code` is not of that form, or names what cannot act.
      FileError: there is no such file.
      ControllerError: its code failed.
    """
    return PythonPolicy(load_code(code, "policy", FORM), code)


def _method(thing: object, name: str) -> Callable[..., object] | None:
    method = getattr(thing, name, None)
    return method if callable(method) else None


def _keywords(function: Callable[..., object]) -> frozenset[str]:
    try:
        return frozenset(inspect.signature(function).parameters)
    except (TypeError, ValueError):
        return frozenset()


def _takes(function: Callable[..., object], count: int) -> bool:
    try:
        inspect.signature(function).bind(*range(count))
    except (TypeError, ValueError):
        return False
    return True
