"""Adds the manual pages to wheels, if `make docs` has built them; a build needs nothing for it."""

from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class ManualPages(BuildHookInterface[Any]):
    """Installs out/man as share/man/man1."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Names the folder before the wheel is built."""
        pages = Path(self.root) / "out/man"
        if self.target_name == "wheel" and pages.is_dir():
            build_data["shared_data"] |= {
                str(page): f"share/man/man1/{page.name}" for page in sorted(pages.glob("*.1"))
            }
