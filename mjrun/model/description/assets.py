"""The files and assets of a model: its sources, meshes, textures, height fields and skins."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from mjrun.model.description import archive_files
from mjrun.model.description.plain_values import object_name
from mjrun.model.description.referenced_files import ReferencedFile, referenced_files

KINDS = {"include": "include", "model": "attached model", "texture": "texture", "flexcomp": "flexcomp"}


@dataclass(frozen=True)
class Asset:
    """A file, or an asset without one: built in, or written in the MJCF.

    Attributes:
      kind: `model`, `include`, `attached model`, `mesh`, `texture`, `hfield`, `skin` or `flexcomp`.
      name: of the asset; None of a source.
      path: None without a file. One inside an archive begins with the archive's path.
      bytes: on disk; None if it is not there, as for a compiled model that was moved.
      content: its size in the compiled model: `vertices` and `faces`; `width`, `height` and `channels`;
        `rows` and `columns`; empty for a source.
    """

    kind: str
    name: str | None
    path: str | None
    bytes: int | None
    content: dict[str, int]


def assets(model: mujoco.MjModel, path: Path | None) -> tuple[Asset, ...]:
    """Every file that can be found, the model's own first, and every asset without one."""
    referenced = _referenced(path)
    faces: dict[str, list[str]] = {}
    for file in referenced:
        if file.kind == "texture":
            faces.setdefault(file.name, []).append(file.path)
    sources = [_file(KINDS[file.kind], file.name or None, file.path) for file in referenced if file.kind != "texture"]
    own = [] if path is None else [_file("model", None, str(path))]
    return (*own, *sources, *_meshes(model), *_textures(model, faces), *_hfields(model), *_skins(model))


def _referenced(path: Path | None) -> list[ReferencedFile]:
    main = None if path is None else archive_files.main_mjcf(path)
    return [] if main is None else referenced_files(main)


def _file(kind: str, name: str | None, path: str | None, content: dict[str, int] | None = None) -> Asset:
    return Asset(kind, name, path, None if path is None else archive_files.file_size(path), content or {})


def _meshes(model: mujoco.MjModel) -> Iterator[Asset]:
    for i in range(model.nmesh):
        content = {"vertices": int(model.mesh_vertnum[i]), "faces": int(model.mesh_facenum[i])}
        name = object_name(model, mujoco.mjtObj.mjOBJ_MESH, i)
        yield _file("mesh", name, _path(model, model.mesh_pathadr[i]), content)


def _textures(model: mujoco.MjModel, faces: dict[str, list[str]]) -> Iterator[Asset]:
    for i in range(model.ntex):
        width, height, channels = (int(size[i]) for size in (model.tex_width, model.tex_height, model.tex_nchannel))
        content = {"width": width, "height": height, "channels": channels}
        name, path = object_name(model, mujoco.mjtObj.mjOBJ_TEXTURE, i), _path(model, model.tex_pathadr[i])
        for file in [path] if path else faces.get(name or "") or [None]:
            yield _file("texture", name, file, content)


def _hfields(model: mujoco.MjModel) -> Iterator[Asset]:
    for i in range(model.nhfield):
        content = {"rows": int(model.hfield_nrow[i]), "columns": int(model.hfield_ncol[i])}
        name = object_name(model, mujoco.mjtObj.mjOBJ_HFIELD, i)
        yield _file("hfield", name, _path(model, model.hfield_pathadr[i]), content)


def _skins(model: mujoco.MjModel) -> Iterator[Asset]:
    for i in range(model.nskin):
        content = {"vertices": int(model.skin_vertnum[i]), "faces": int(model.skin_facenum[i])}
        name = object_name(model, mujoco.mjtObj.mjOBJ_SKIN, i)
        yield _file("skin", name, _path(model, model.skin_pathadr[i]), content)


def _path(model: mujoco.MjModel, start: np.integer) -> str | None:
    """The path that begins at `start` in the model's list of them; None at −1."""
    if start < 0:
        return None
    paths = model.paths
    return paths[start : paths.index(b"\0", start)].decode("utf-8", "surrogateescape")
