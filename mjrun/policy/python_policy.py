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
            return _predicting(self._guarded(predict), _keywords(predict))
        function = self._guarded(act or cast("Callable[..., object]", instance))
        return lambda observation: cast("np.ndarray", function(observation.copy()))

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


def _predicting(predict: Callable[..., object], keywords: frozenset[str]) -> Actor:
    """Calls `predict` as Stable-Baselines3 declares it: without noise, and with the state that it returned last."""
    state: object = None
    is_start = True

    def act(observation: np.ndarray) -> np.ndarray:
        nonlocal state, is_start
        known = {"state": state, "episode_start": np.array([is_start]), "deterministic": True}
        answer = predict(observation.copy(), **{name: known[name] for name in known if name in keywords})
        action, state = answer if isinstance(answer, tuple) and len(answer) == 2 else (answer, None)
        is_start = False
        return cast("np.ndarray", action)

    return act


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
