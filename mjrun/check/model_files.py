"""The models among files and folders."""

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from xml.parsers import expat

from mjrun.errors import UsageError, clean
from mjrun.formats.input_file import is_file, is_folder
from mjrun.model.source import CollectionSource
from mjrun.model.sources import source_of
from mjrun.model.sources.bundled_scene import bundled_task
from mjrun.suffixes import CHECKED, XML

HEAD = 2**16  # bytes within which the root of an XML file must begin
ROOTS = {"mujoco", "robot"}
FRAGMENT = "mujocoinclude"  # the root of what other models include


def find_models(paths: Sequence[str | Path]) -> tuple[list[str], int]:
    """The models among files and folders, each once and in order, and how many files are not models.

    The latter are the files in folders whose root element is not that of a model, and the parts that models include.
    """
    models: dict[str, None] = {}
    skipped = 0
    for path in map(_path, paths):
        if not is_folder(path):
            if root_tag(Path(path)) == FRAGMENT:
                skipped += 1
            else:
                models[path] = None
            continue
        for file in _below(Path(path)):
            if file.suffix not in XML or root_tag(file) in ROOTS:
                models[str(file)] = None
            else:
                skipped += 1
    return list(models), skipped


def _path(model: str | Path) -> str:
    """The path of a model, or of a task; a name in a collection, such as `scene:dominos`, stands for its file."""
    if task := bundled_task(str(model)):
        return str(task)
    source = source_of(model)
    if source.main_file is None:
        raise UsageError(f"{clean(str(model))}: a check needs a model file")
    return str(source.main_file if isinstance(source, CollectionSource) else model)


def _below(folder: Path) -> Iterator[Path]:
    """Files with the suffix of a model below `folder`, sorted; hidden and linked folders are skipped."""
    for parent, folders, files in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        yield from (Path(parent) / name for name in sorted(files) if name.endswith(CHECKED))


def root_tag(path: Path) -> str:
    """The tag of the root element of an XML file; empty if there is none, or if the file is not a regular one."""
    tags: list[str] = []
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda tag, attributes: tags.append(tag)
    if not is_file(path):
        return ""
    with suppress(OSError, ValueError, LookupError, expat.ExpatError), path.open("rb") as file:
        parser.Parse(file.read(HEAD))
    return tags[0] if tags else ""
