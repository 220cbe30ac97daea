"""The scenes that come with mjrun as model sources, written `scene:NAME`."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import ClassVar

import mujoco

from mjrun.model.source import CollectionSource
from mjrun.model.sources.file import FileSource


@dataclass(frozen=True)
class BundledScene(CollectionSource):
    """A scene of mjrun's gallery."""

    PREFIX: ClassVar[str] = "scene"
    KIND: ClassVar[str] = "scene"

    @classmethod
    def descriptions(cls) -> Mapping[str, str]:
        return {path.stem: _first_sentence(path) for path in sorted(scene_folder().glob("*.xml"))}

    @property
    def main_file(self) -> Path:
        self.check_name()
        return scene_folder() / f"{self.name}.xml"

    @property
    def files(self) -> tuple[Path, ...]:
        return FileSource(self.main_file).files

    def compile(self) -> tuple[mujoco.MjSpec | None, mujoco.MjModel]:
        return FileSource(self.main_file, overrides=self.overrides).compile()


@cache
def scene_folder() -> Path:
    """The scenes, which the wheel holds within the package and a checkout beside it."""
    package = Path(__file__).parents[2]
    installed = package / "scenes"
    return installed if installed.is_dir() else package.parent / "scenes"


def _first_sentence(path: Path) -> str:
    """The first sentence of the comment at the top of a scene."""
    comment = path.read_text("utf-8").removeprefix("<!--").partition("-->")[0]
    return re.split(r"(?<=\.)\s", " ".join(comment.split()), maxsplit=1)[0]
