"""The files that an MJCF refers to and its compiled model does not record: includes, attached models, cube faces."""

import os.path
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from xml.parsers import expat

from mjrun.model.description.archive_files import file_content, file_size

NAMING = ("include", "model", "texture", "flexcomp")  # elements that name such files
FACES = ("fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")


@dataclass(frozen=True)
class ReferencedFile:
    """A file that MJCF refers to: `kind` is `include`, `model`, `texture` or `flexcomp`, `name` is the element's."""

    kind: str
    name: str
    path: str


@dataclass
class _SourceFile:
    """One file of MJCF: its elements that refer to files, and the folders that its compiler element sets."""

    elements: list[tuple[str, dict[str, str]]]
    folders: dict[str, str]


def referenced_files(main: str) -> list[ReferencedFile]:
    """Every existing file that the MJCF at `main`, and what it includes or attaches, refers to; each once.

    A file that cannot be read or is not XML refers to none.
    """
    files: dict[str, ReferencedFile] = {}
    queue, visited = [(main, main)], {main}
    while queue:
        path, root = queue.pop(0)
        for file in _references(_parse(path), path, root):
            files.setdefault(file.path, file)
            if file.kind in ("include", "model") and file.path not in visited:
                visited.add(file.path)
                queue.append((file.path, root if file.kind == "include" else file.path))
    return list(files.values())


def _parse(path: str) -> _SourceFile:
    source = _SourceFile([], {})
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        if tag in NAMING:
            source.elements.append((tag, attributes))
        elif tag == "compiler":
            source.folders |= {
                key: attributes[key] for key in ("assetdir", "texturedir", "meshdir") if key in attributes
            }

    parser.StartElementHandler = start
    with suppress(expat.ExpatError, ValueError, LookupError):  # what precedes the fault counts; no such encoding
        parser.Parse(file_content(path) or b"", True)
    return source


def _references(source: _SourceFile, path: str, root: str) -> Iterator[ReferencedFile]:
    for tag, attributes in source.elements:
        keys = FACES if tag == "texture" else ("file",)
        for key in keys:
            if place := _resolve(attributes.get(key, ""), path, root, source.folders):
                yield ReferencedFile(tag, attributes.get("name", ""), place)


def _resolve(file: str, path: str, root: str, folders: dict[str, str]) -> str | None:
    """The path of a file: beside the source that refers to it, beside the main one, or in a folder of assets."""
    if not file:
        return None
    bases = [os.path.dirname(path), os.path.dirname(root)]  # noqa: PTH120 – a pathlib path would drop the leading ./
    places = [os.path.join(base, folder, file) for folder in ("", *folders.values()) for base in bases]  # noqa: PTH118
    # A folder name counts only for the file name where MuJoCo strips paths; both are tried.
    places += [os.path.join(base, folder, Path(file).name) for folder in folders.values() for base in bases]  # noqa: PTH118
    normal = (os.path.normpath(place) for place in places)
    return next((place for place in normal if file_size(place) is not None), None)
