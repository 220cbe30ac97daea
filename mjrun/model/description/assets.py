"""The files and assets of a model: its sources, meshes, textures, height fields and skins.

A compiled model does not record its includes, attached models and cube faces; these are searched for in the MJCF.
"""

import os.path
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.model.model_files import file_content, file_size, first_existing, main_mjcf
from mjrun.model.names import PREFIXES, names
from mjrun.model.xml_source import scan

KINDS = {"include": "include", "model": "attached model", "texture": "texture", "flexcomp": "flexcomp"}
# The fields that hold the size of an asset.
CONTENT = {
    "mesh": {"vertices": "mesh_vertnum", "faces": "mesh_facenum"},
    "texture": {"width": "tex_width", "height": "tex_height", "channels": "tex_nchannel"},
    "hfield": {"rows": "hfield_nrow", "columns": "hfield_ncol"},
    "skin": {"vertices": "skin_vertnum", "faces": "skin_facenum"},
}
NAMING = ("include", "model", "texture", "flexcomp")  # elements that refer to such files
FOLDERS = ("assetdir", "texturedir", "meshdir")
FACES = ("fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")


@dataclass(frozen=True)
class Asset:
    """A file, or an asset without a file: built in, or written in the MJCF.

    Attributes:
      kind: `model`, `include`, `attached model`, `mesh`, `texture`, `hfield`, `skin` or `flexcomp`.
      name: the name of the asset; None for a source.
      path: the path of the file, or None. A path inside an archive begins with the path of the archive.
      bytes: the size on disk; None if the file is missing, as after a compiled model was moved.
      content: the size in the compiled model: `vertices` and `faces`; `width`, `height` and `channels`;
        `rows` and `columns`; empty for a source.
    """

    kind: str
    name: str | None
    path: str | None
    bytes: int | None
    content: dict[str, int]


def assets(model: mujoco.MjModel, path: Path | None) -> tuple[Asset, ...]:
    """Returns all files that exist, the model's own first, and all assets without a file."""
    main = None if path is None else main_mjcf(path)
    referenced = [] if main is None else referenced_files(main)
    faces: dict[str, list[str]] = {}
    for file in referenced:
        if file.kind == "texture":
            faces.setdefault(file.name, []).append(file.path)
    sources = [_file(KINDS[file.kind], file.name or None, file.path) for file in referenced if file.kind != "texture"]
    own = [] if path is None else [_file("model", None, str(path))]
    return (*own, *sources, *_compiled(model, faces))


def _file(kind: str, name: str | None, path: str | None, content: dict[str, int] | None = None) -> Asset:
    return Asset(kind, name, path, None if path is None else file_size(path), content or {})


def _compiled(model: mujoco.MjModel, faces: Mapping[str, Sequence[str]]) -> Iterator[Asset]:
    """Yields the assets of a compiled model; `faces` are the files of textures whose file is not recorded."""
    for kind, sizes in CONTENT.items():
        paths = getattr(model, f"{PREFIXES[kind]}_pathadr")
        for i, name in enumerate(names(model, kind)):
            content = {word: int(getattr(model, field)[i]) for word, field in sizes.items()}
            path = _path(model, paths[i])
            other = faces.get(name) if kind == "texture" and not path else None
            for file in other or [path]:
                yield _file(kind, name, file, content)


def _path(model: mujoco.MjModel, start: np.integer) -> str | None:
    """Returns the path that begins at `start` in the model's list of paths; None for −1."""
    if start < 0:
        return None
    paths = model.paths
    return paths[start : paths.index(b"\0", start)].decode("utf-8", "surrogateescape")


@dataclass(frozen=True)
class ReferencedFile:
    """A file that MJCF refers to: `kind` is `include`, `model`, `texture` or `flexcomp`, `name` that of the element."""

    kind: str
    name: str
    path: str


def referenced_files(main: str) -> list[ReferencedFile]:
    """Returns the existing files that the MJCF at `main`, its includes and its attached models refer to, each once.

    A file that cannot be read or is not XML refers to no files.
    """
    files: dict[str, ReferencedFile] = {}
    queue, visited = [(main, main)], {main}
    while queue:
        path, root = queue.pop(0)
        for file in _references(path, root):
            files.setdefault(file.path, file)
            if file.kind in ("include", "model") and file.path not in visited:
                visited.add(file.path)
                queue.append((file.path, root if file.kind == "include" else file.path))
    return list(files.values())


def _references(path: str, root: str) -> Iterator[ReferencedFile]:
    """Yields the files that the MJCF at `path` refers to, which `root` includes."""
    elements: list[tuple[str, dict[str, str]]] = []
    folders: dict[str, str] = {}  # set by the compiler element, which may come last

    def start(tag: str, attributes: dict[str, str], line: int) -> None:
        if tag in NAMING:
            elements.append((tag, attributes))
        elif tag == "compiler":
            folders.update({key: attributes[key] for key in FOLDERS if key in attributes})

    scan(file_content(path) or b"", start)
    for tag, attributes in elements:
        for key in FACES if tag == "texture" else ("file",):
            if place := _resolve(attributes.get(key, ""), path, root, folders):
                yield ReferencedFile(tag, attributes.get("name", ""), place)


def _resolve(file: str, path: str, root: str, folders: dict[str, str]) -> str | None:
    """Returns the path of a file next to the source that refers to it, next to the main one, or in an asset folder."""
    if not file:
        return None
    bases = [os.path.dirname(path), os.path.dirname(root)]  # noqa: PTH120 – a pathlib path would drop the leading ./
    places = [os.path.join(base, folder, file) for folder in ("", *folders.values()) for base in bases]  # noqa: PTH118
    # MuJoCo may strip the folders from a file name; both forms are tried.
    places += [os.path.join(base, folder, Path(file).name) for folder in folders.values() for base in bases]  # noqa: PTH118
    return first_existing(places)
