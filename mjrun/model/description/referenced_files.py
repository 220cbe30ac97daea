"""Which files an MJCF names that its compiled model does not remember: included and attached ones, faces of cubes."""

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
    """A file that a source names: `kind` is `include`, `model`, `texture` or `flexcomp`, `name` that of the element."""

    kind: str
    name: str
    path: str


@dataclass
class _Scan:
    """What one source file says: its elements of interest, and the folders that its compiler element sets."""

    elements: list[tuple[str, dict[str, str]]]
    folders: dict[str, str]


def referenced_files(main: str) -> list[ReferencedFile]:
    """Every file that the MJCF at `main`, and all that it includes or attaches, name; each once, if it is there.

    A file that cannot be read or is not XML names nothing.
    """
    found: dict[str, ReferencedFile] = {}
    waiting, seen = [(main, main)], {main}
    while waiting:
        path, root = waiting.pop(0)
        scan = _scanned(path)
        for thing in _things(scan, path, root):
            found.setdefault(thing.path, thing)
            if thing.kind in ("include", "model") and thing.path not in seen:
                seen.add(thing.path)
                waiting.append((thing.path, root if thing.kind == "include" else thing.path))
    return list(found.values())


def _scanned(path: str) -> _Scan:
    scan = _Scan([], {})
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        if tag in NAMING:
            scan.elements.append((tag, attributes))
        elif tag == "compiler":
            scan.folders |= {key: attributes[key] for key in ("assetdir", "texturedir", "meshdir") if key in attributes}

    parser.StartElementHandler = start
    with suppress(expat.ExpatError, ValueError):  # what was found up to there holds
        parser.Parse(file_content(path) or b"", True)
    return scan


def _things(scan: _Scan, path: str, root: str) -> Iterator[ReferencedFile]:
    for tag, attributes in scan.elements:
        keys = FACES if tag == "texture" else ("file",)
        for key in keys:
            if place := _found(attributes.get(key, ""), path, root, scan.folders):
                yield ReferencedFile(tag, attributes.get("name", ""), place)


def _found(file: str, path: str, root: str, folders: dict[str, str]) -> str | None:
    """Where a file is: beside the source that names it, beside the main one, or in a folder of assets."""
    if not file:
        return None
    bases = [os.path.dirname(path), os.path.dirname(root)]  # noqa: PTH120 – a pathlib path would drop the leading ./
    places = [os.path.join(base, folder, file) for folder in ("", *folders.values()) for base in bases]  # noqa: PTH118
    # A folder name counts only for the file name where MuJoCo strips paths; both are tried.
    places += [os.path.join(base, folder, Path(file).name) for folder in folders.values() for base in bases]  # noqa: PTH118
    tidy = (os.path.normpath(place) for place in places)
    return next((place for place in tidy if file_size(place) is not None), None)
