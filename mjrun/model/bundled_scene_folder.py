"""The folder of the scenes that come with mjrun."""

from functools import cache
from pathlib import Path


@cache
def scene_folder() -> Path:
    """Returns the folder of the scenes, which is inside the package in a wheel and beside it in a checkout."""
    package = Path(__file__).parents[1]
    installed = package / "scenes"
    return installed if installed.is_dir() else package.parent / "scenes"
