"""Loads the controller that the user names on the command line."""

from collections.abc import Callable

from mjrun.errors import UsageError, option, quoted
from mjrun.python_code import RedirectedFunction, load_code, made

FORM = "FILE.py:NAME or PACKAGE.MODULE:NAME names a function (model, data), or a class with __call__ and reset"


def load_controller(code: str) -> Callable[..., object]:
    """The controller that `code` names; of a class, an instance.

    Raises:
      UsageError: `code` is not of that form, or names what is not there.
      FileError: there is no such file.
      ControllerError: its code failed.
    """
    controller = made(load_code(code, "controller", FORM), code, "controller")
    if not callable(controller):
        kind = type(controller).__name__
        raise UsageError(f"{option('controller')} {quoted(code)} is of type {kind}, and cannot be called\n{FORM}")
    return RedirectedFunction(controller)
