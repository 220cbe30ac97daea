"""The kinds of policy files: one module each, and nothing else in this package.

A module defines `LOADER`, a `PolicyLoader`, and is found because it is here. Modules import the libraries of their kind
inside functions, as these may not be installed.
"""

import functools
import importlib
import pkgutil
from pathlib import Path

from mjrun.formats.input_file import is_folder
from mjrun.policy.policy import PolicyLoader


@functools.cache
def loaders() -> list[PolicyLoader]:
    """All kinds of policy files."""
    modules = [importlib.import_module(f"{__name__}.{module.name}") for module in pkgutil.iter_modules(__path__)]
    return [module.LOADER for module in modules]


def loader_of(path: Path) -> PolicyLoader | None:
    """The loader of a file or a folder; None if it is of no kind that is known."""
    if is_folder(path):
        return next(each for each in loaders() if each.reads_folders)
    return next((each for each in loaders() if path.suffix.lower() in each.suffixes), None)
