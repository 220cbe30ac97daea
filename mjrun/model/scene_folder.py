"""Where the scenes are that come with mjrun."""

from functools import cache
from pathlib import Path


@cache
def scene_folder() -> Path:
    """The scenes, which the wheel holds within the package and a checkout beside it."""
    package = Path(__file__).parents[1]
    installed = package / "scenes"
    return installed if installed.is_dir() else package.parent / "scenes"
