"""The scenes that come with mjrun, written `scene:NAME`: model sources, and task documents."""

import re
from collections.abc import Mapping, Sequence
from functools import cache
from itertools import takewhile
from pathlib import Path
from typing import ClassVar

from mjrun.dataclass import dataclass
from mjrun.errors import ModelNotFoundError
from mjrun.model.sources.file import CollectionFileSource
from mjrun.platform.installation import scene_folder

SCHEMA_COMMENT = "# yaml-language-server:"  # the comment in a document that selects its schema in editors


@dataclass(frozen=True)
class BundledSceneSource(CollectionFileSource):
    """A scene of mjrun's gallery; its tasks, which are not models, are listed too."""

    PREFIX: ClassVar[str] = "scene"
    KIND: ClassVar[str] = "scene"

    @classmethod
    def descriptions(cls) -> Mapping[str, str]:
        files = [*scene_folder().glob("*.xml"), *_tasks().values()]
        return {path.stem: _first_sentence(path) for path in sorted(files)}

    @property
    def main_file(self) -> Path:
        self.check_name()
        if self.name in _tasks():
            reason = "is a task, not a model; in Python, mjrun.read_task reads it"
            raise ModelNotFoundError(self.text, reason)
        return scene_folder() / f"{self.name}.xml"


def bundled_task(text: str) -> Path | None:
    """Returns the document of the task that `text` names, as `scene:car_drive` does; None for other texts."""
    prefix, _, name = text.partition(":")
    return _tasks().get(name) if prefix == BundledSceneSource.PREFIX else None


def bundled_task_names() -> Sequence[str]:
    """Returns the names of the tasks, such as `scene:car_drive`."""
    return [f"{BundledSceneSource.PREFIX}:{name}" for name in _tasks()]


@cache
def _tasks() -> Mapping[str, Path]:
    """Returns the task documents by name; documents named like a model are run documents, and others are fits."""
    documents = sorted(scene_folder().glob("*.yaml"))
    return {path.stem: path for path in documents if not path.with_suffix(".xml").exists() and _is_task(path)}


def _is_task(path: Path) -> bool:
    """Returns whether the schema that a document declares is that of tasks."""
    with path.open(encoding="utf-8") as file:
        return file.readline().strip() == f"{SCHEMA_COMMENT} $schema=schema/task.json"


def _first_sentence(path: Path) -> str:
    """Returns the first sentence of the comment at the top of a scene."""
    text = path.read_text("utf-8")
    if path.suffix == ".xml":
        comment = text.removeprefix("<!--").partition("-->")[0]
    else:
        lines = takewhile(lambda line: line.startswith("#"), text.splitlines())
        comment = "\n".join(line[1:] for line in lines if not line.startswith(SCHEMA_COMMENT))
    return re.split(r"(?<=\.)\s", " ".join(comment.split()), maxsplit=1)[0]
