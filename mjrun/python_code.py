"""Python that the user names, `FILE.py:NAME` or `PACKAGE.MODULE:NAME`: the only place where code comes from."""

import contextlib
import importlib
import importlib.util
import inspect
import sys
from collections.abc import Callable
from functools import reduce
from pathlib import Path
from types import ModuleType

from mjrun.confinement.confinement import require_unconfined
from mjrun.errors import ControllerError, FileError, UnknownNameError, UsageError, option, quoted


class RedirectedFunction:
    """A function whose prints go to standard error, as standard output carries the payload; so do its `reset`'s."""

    def __init__(self, function: Callable[..., object]) -> None:
        self._function = self.__wrapped__ = function
        self.__qualname__ = getattr(function, "__qualname__", type(function).__qualname__)
        with contextlib.suppress(ValueError):
            self.__signature__ = inspect.signature(function)
        if hasattr(function, "reset"):
            self.reset = RedirectedFunction(function.reset)  # type: ignore[attr-defined]

    def __call__(self, *arguments: object) -> object:
        with contextlib.redirect_stdout(sys.stderr):
            return self._function(*arguments)


def load_code(code: str, name: str, form: str) -> object:
    """What `code` names.

    Args:
      name: of the option.
      form: what such code is, for messages.

    Raises:
      UsageError: `code` is not of that form, or names what is not there.
      FileError: there is no such file.
      ControllerError: its code failed.
    """
    require_unconfined(f"{option(name)} {quoted(code)} is code")
    place, _, attribute = code.rpartition(":")
    if not place or not attribute:
        raise UsageError(f"{option(name)} {quoted(code)} names no code\n{form}")
    return RedirectedFunction(lambda: _load(place, attribute, name, form))()


def made(thing: object, code: str, name: str) -> object:
    """An instance, if `thing` is a class; raises ControllerError if that fails."""
    if not isinstance(thing, type):
        return thing
    try:
        return RedirectedFunction(thing)()
    except (Exception, SystemExit) as error:
        raise ControllerError.of(f"{option(name)} {quoted(code)}", error) from error


def _load(place: str, attribute: str, name: str, form: str) -> object:
    try:
        module = _file(Path(place), form) if place.endswith(".py") else _module(place)
        if not hasattr(module, attribute.partition(".")[0]):
            valid = [key for key, value in vars(module).items() if callable(value) and not key.startswith("_")]
            raise UnknownNameError(name, attribute, valid, where=place, plural="policies" * (name == "policy"))
        return reduce(getattr, attribute.split("."), module)
    except (UsageError, FileError):
        raise
    except (Exception, SystemExit) as error:
        raise ControllerError.of(f"{option(name)} {quoted(f'{place}:{attribute}')}", error) from error


def _file(path: Path, form: str) -> ModuleType:
    known = sys.modules.get(path.stem)
    if known and getattr(known, "__file__", None) == str(path.resolve()):
        return known  # or what it defines could not be pickled
    if not path.is_file():
        raise FileError(path, "there is no such file" if not path.exists() else "is not a file", form)
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
