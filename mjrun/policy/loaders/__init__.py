"""The formats of policy files, one module each.

A module is found by its place in this package, and defines `FORMAT`, a `PolicyFormat`. It imports the libraries of its
format inside functions, as these may not be installed. The first line of its docstring names the format, up to a colon:
help lists it without importing the module.
"""

import functools
import importlib
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mjrun.policy.policy import PolicyFormat


def formats() -> list[str]:
    """Returns the names of all formats of policy files, such as `ONNX files (.onnx)`, without importing them."""
    return [path.read_text("utf-8").split('"""', 2)[1].partition(":")[0] for path in _modules()]


@functools.cache
def loaders() -> "list[PolicyFormat]":
    """Returns all formats of policy files."""
    return [importlib.import_module(f"{__name__}.{path.stem}").FORMAT for path in _modules()]


def format_of(path: Path) -> "PolicyFormat | None":
    """Returns the loader of a file or a folder; None if its format is unknown."""
    from mjrun.formats.input_file import is_folder  # which help does without

    if is_folder(path):
        return next(each for each in loaders() if each.reads_folders)
    return next((each for each in loaders() if path.suffix.lower() in each.suffixes), None)


def _modules() -> list[Path]:
    """Returns the files of the modules of all formats."""
    return sorted(Path(__file__).parent.glob("[!_]*.py"))
