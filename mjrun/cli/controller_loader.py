"""Loads the controller that the user names on the command line, the only place where code comes from."""

import contextlib
import importlib
import importlib.util
import inspect
import sys
from collections.abc import Callable
from functools import reduce
from pathlib import Path
from types import ModuleType

from mjrun.errors import ControllerError, FileError, UnknownNameError, UsageError, option, quoted

FORM = "FILE.py:NAME or PACKAGE.MODULE:NAME names a function (model, data), or a class with __call__ and reset"


class RedirectedController:
    """A function whose prints go to standard error, as standard output carries the payload; so do its `reset`'s."""

    def __init__(self, function: Callable[..., object]) -> None:
        self._function = self.__wrapped__ = function
        self.__qualname__ = getattr(function, "__qualname__", type(function).__qualname__)
        with contextlib.suppress(ValueError):
            self.__signature__ = inspect.signature(function)
        if hasattr(function, "reset"):
            self.reset = RedirectedController(function.reset)  # type: ignore[attr-defined]

    def __call__(self, *arguments: object) -> object:
        with contextlib.redirect_stdout(sys.stderr):
            return self._function(*arguments)


def load_controller(code: str) -> Callable[..., object]:
    """The controller that `code` names; of a class, an instance.

    Raises:
      UsageError: `code` is not of that form, or names what is not there.
      FileError: there is no such file.
      ControllerError: its code failed.
    """
    place, _, name = code.rpartition(":")
    if not place or not name:
        raise UsageError(f"{option('controller')} {quoted(code)} names no code\n{FORM}")
    controller = RedirectedController(lambda: _load(place, name))()
    if not callable(controller):
        kind = type(controller).__name__
        raise UsageError(f"{option('controller')} {quoted(code)} is of type {kind}, and cannot be called\n{FORM}")
    return RedirectedController(controller)


def _load(place: str, name: str) -> object:
    try:
        module = _file(Path(place)) if place.endswith(".py") else _module(place)
        if not hasattr(module, name.partition(".")[0]):
            valid = [key for key, value in vars(module).items() if callable(value) and not key.startswith("_")]
            raise UnknownNameError("controller", name, valid, where=place)
        controller = reduce(getattr, name.split("."), module)
        return controller() if isinstance(controller, type) else controller
    except (UsageError, FileError):
        raise
    except (Exception, SystemExit) as error:
        raise ControllerError.of(f"{option('controller')} {quoted(f'{place}:{name}')}", error) from error


def _file(path: Path) -> ModuleType:
    known = sys.modules.get(path.stem)
    if known and getattr(known, "__file__", None) == str(path.resolve()):
        return known  # or what it defines could not be pickled
    if not path.is_file():
        raise FileError(path, "there is no such file" if not path.exists() else "is not a file", FORM)
    sys.path.insert(0, str(path.parent.resolve()))  # as `python FILE.py` does
    spec = importlib.util.spec_from_file_location(path.stem, path.resolve())
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules.setdefault(path.stem, module)  # dataclasses and pickle look there
    spec.loader.exec_module(module)
    return module


def _module(name: str) -> ModuleType:
    sys.path.insert(0, str(Path.cwd()))  # as `python -m` does
    return importlib.import_module(name)
