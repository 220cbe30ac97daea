"""The formats of policy files, one module each.

A module is found by its place in this package, and defines `LOADER`, a `PolicyLoader`. It imports the libraries of its
format inside functions, as these may not be installed.
"""

import functools
import importlib
import pkgutil
from pathlib import Path

from mjrun.formats.input_file import is_folder
from mjrun.policy.policy import PolicyLoader


@functools.cache
def loaders() -> list[PolicyLoader]:
    """Returns all formats of policy files."""
    modules = [importlib.import_module(f"{__name__}.{module.name}") for module in pkgutil.iter_modules(__path__)]
    return [module.LOADER for module in modules]


def loader_of(path: Path) -> PolicyLoader | None:
    """Returns the loader of a file or a folder; None if its format is unknown."""
    if is_folder(path):
        return next(each for each in loaders() if each.reads_folders)
    return next((each for each in loaders() if path.suffix.lower() in each.suffixes), None)
