"""The files that a model refers to, checked before MuJoCo opens them: a pipe or a device would block it.

Their names are extracted from the text by regular expressions, which is fast and accepts text that is not well-formed.
Each file is looked up in every place where MuJoCo may look for it.
"""

import math
import os
import re
import stat
import struct
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import field
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, NamedTuple

from mjrun.confinement.confinement import OUTSIDE, advice, confinement, depends_on_processes, is_readable
from mjrun.dataclass import dataclass
from mjrun.errors import BrokenModelError, quoted
from mjrun.model.archive_paths import file_content, file_size
from mjrun.model.xml_source import MAX_FILES, is_regular, with_slashes

if TYPE_CHECKING:
    from mjrun.model.override import Override

_VALUE = rb"\s*=\s*(?:\"([^\"]*)\"|'([^']*)')"
# Patterns that begin with a word are ten times as fast as others. URDF writes the file of a mesh as filename.
_FILE_NAMES = rb"file(?:name|right|left|up|down|front|back)?"
_FOLDER_NAMES = rb"dir(?:(?<=assetdir)|(?<=meshdir)|(?<=texturedir))"
_FILE = re.compile(_FILE_NAMES + _VALUE)
_FOLDER = re.compile(_FOLDER_NAMES + _VALUE)
_PATH = re.compile(rb"((?:" + _FILE_NAMES + rb"|" + _FOLDER_NAMES + rb")\s*=\s*([\"']))(.*?)(?=\2)", re.DOTALL)
_FILE_PATH = re.compile(rb"(" + _FILE_NAMES + rb"\s*=\s*([\"']))(.*?)(?=\2)", re.DOTALL)
_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
_PLUGIN = re.compile(rb"\bplugin\s*=\s*[\"'](?!mujoco\.)")  # one that does not come with MuJoCo
_MODEL = re.compile(rb"<(?:include|model)\b(?:[^>\"']|\"[^\"]*\"|'[^']*')*")
_ROOT = re.compile(rb"(?:\xef\xbb\xbf)?(?:\s+|<\?.*?\?>|<!--.*?-->)*<(\w+)", re.DOTALL)
MOST_PIXELS = 2**28  # per image: 16384x16384 pixels, which MuJoCo decodes into 805 MB
ROOTS = (b"mujoco", b"mujocoinclude", b"robot")

KINDS = {
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


class _NamedFile(NamedTuple):
    """A file name in line `line` of the file `by`."""

    name: str
    by: Path
    line: int


@dataclass
class _NamedFiles:
    """The file names in a model and in its includes and attached models; `models` maps the latter to their texts."""

    files: list[_NamedFile] = field(default_factory=list)
    folders: dict[str, None] = field(default_factory=lambda: {"": None})
    models: dict[str, bytes] = field(default_factory=dict[str, bytes])


def require_regular_files(
    path: Path, text: bytes | None, member: str = "", overrides: "Iterable[Override]" = ()
) -> dict[str, os.stat_result]:
    """Checks that no file named in the MJCF or URDF `text`, or in its includes, is a pipe, a socket or a device.

    In a confined process, no such file may be outside the readable folders either, whether it exists or not.

    Args:
      path: the path of the text; its files may be next to it, or in the working directory.
      member: the path of the text if it is in the archive `path`.
      overrides: overrides of the model, which may name other files.

    Returns:
      The status of each file that exists, by its path.

    Raises:
      BrokenModelError: a file is of such a kind, or outside.
    """
    named = _collect(path, _with_files_of(overrides, text), member)
    if confinement():
        for file in named.files:
            _require_readable(file, path, named.folders)
    seen: dict[str, os.stat_result | None] = {}
    for file in named.files:
        for place in _places(file, path, named.folders):
            if place not in seen:
                seen[place] = _check(file, place)
    return {place: status for place, status in seen.items() if status}


def existing_files(
    path: Path, text: bytes | None, member: str = "", overrides: "Iterable[Override]" = ()
) -> list[Path]:
    """Returns the regular files that MuJoCo may open for the MJCF or URDF `text`, each once, without `path` itself.

    Args:
      path: the path of the text, or of the archive that contains it.
      member: the path of the text if it is in the archive `path`.
      overrides: overrides of the model, which may name other files.
    """
    named = _collect(path, _with_files_of(overrides, text), member)
    places = (place for file in named.files for place in _places(file, path, named.folders, working=False))
    files = dict.fromkeys(filter(is_regular, map(Path, dict.fromkeys(places))))
    files.pop(path, None)
    return [*files]


def places_of_files(path: Path, text: bytes | None, member: str = "") -> list[list[str]] | None:
    """Returns the places where MuJoCo may look for each file that the MJCF or URDF `text` names, existing or not.

    Args:
      path: the path of the text, or of the archive that contains it.
      member: the path of the text if it is in the archive `path`.

    Returns:
      None if the places are not known: plugins other than MuJoCo's may open any file, and not all of very many texts
      are read.
    """
    named = _collect(path, text or b"", member)
    texts = (text or b"", *named.models.values())
    if len(named.models) >= MAX_FILES or any(map(_PLUGIN.search, texts)):
        return None
    return [[*_places(file, path, named.folders)] for file in named.files]


def with_absolute_paths(text: bytes, place: Callable[[str], str | Path]) -> bytes:
    """Returns MJCF or URDF with every absolute path in it replaced by its `place`."""
    return _with_paths(text, _PATH, lambda name: place(name) if PurePath(name).root else name)


def with_file_names(text: bytes, place: Callable[[str], str | Path]) -> bytes:
    """Returns MJCF or URDF with every file name in it, but not those of folders, replaced by its `place`."""
    return _with_paths(text, _FILE_PATH, place)


def _with_paths(text: bytes, pattern: re.Pattern[bytes], place: Callable[[str], str | Path]) -> bytes:
    from html import escape

    def moved(match: re.Match[bytes]) -> bytes:
        name = with_slashes(_unescaped(match[3].decode(errors="surrogateescape")))
        new = str(place(name)) if name else name
        return match[0] if new == name else match[1] + escape(new).encode(errors="surrogateescape")

    return pattern.sub(moved, text)


def file_names(text: bytes) -> list[str]:
    """Returns the names of the files in MJCF or URDF, without those in comments, in order."""
    return [name for name, _ in _values(_FILE, _COMMENT.sub(b"", text))]


def folder_names(text: bytes) -> list[str]:
    """Returns the folders to which file names in MJCF may be relative."""
    return [name for name, _ in _values(_FOLDER, _COMMENT.sub(b"", text))]


def foreign_file(path: Path, text: bytes | None) -> str | None:
    """Returns an included or attached file outside the model's folder that is not MJCF, so errors must not quote it."""
    folder = path.parent.resolve()
    for place, content in _collect(path, text or b"").models.items():
        root = _ROOT.match(content)
        if not (root and root[1] in ROOTS) and not Path(place).resolve().is_relative_to(folder):
            return place
    return None


def _with_files_of(overrides: "Iterable[Override]", text: bytes | None) -> bytes:
    """Returns a text followed by the attributes with file names that overrides set."""
    set_files = [(each.file_attribute, each.value) for each in overrides if each.file_attribute]
    if not set_files:
        return text or b""
    from html import escape

    attributes = "".join(f' {attribute}="{escape(value)}"' for attribute, value in set_files)
    return (text or b"") + attributes.encode(errors="surrogateescape")


def _collect(path: Path, text: bytes, member: str = "") -> _NamedFiles:
    """Collects the file names in a text, and in the files that it includes or attaches."""
    named, waiting, visited = _NamedFiles(), deque([(Path(member or path), text)]), {str(path.absolute())}
    while waiting and len(visited) <= MAX_FILES:
        by, content = waiting.popleft()
        named.folders |= dict.fromkeys(value for value, _ in _values(_FOLDER, content))
        named.files += [_NamedFile(value, by, line) for value, line in _values(_FILE, content)]
        for tag in _MODEL.finditer(content):
            for name, line in _values(_FILE, tag[0]):
                for place in _places(_NamedFile(name, by, line), path, [""]):
                    whole = os.path.abspath(place)  # noqa: PTH100 – pathlib keeps .., and a circle would never end
                    if whole not in visited and (inner := file_content(place)) is not None:
                        visited.add(whole)
                        named.models[place] = inner
                        waiting.append((Path(place), inner))
    if waiting and confinement():
        raise BrokenModelError(path, f"it includes or attaches more than {MAX_FILES} files, which is too many to check")
    return named


def _unescaped(value: str) -> str:
    """Replaces XML entities in the value of an attribute."""
    if "&" not in value:
        return value
    from html import unescape  # slow to import

    return unescape(value)


def _values(attribute: re.Pattern[bytes], text: bytes) -> Iterator[tuple[str, int]]:
    """Yields the values of an attribute in `text`, with their lines."""
    line, position = 1, 0
    for found in attribute.finditer(text):
        line += text.count(b"\n", position, found.start())
        position = found.start()
        value = (found[1] or found[2] or b"").decode(errors="surrogateescape")
        if value:
            yield with_slashes(_unescaped(value)), line


def _places(file: _NamedFile, main: Path, folders: Iterable[str], *, working: bool = True) -> Iterator[str]:
    """Yields the places where MuJoCo may look for a file; URDF drops the folders and the package of a file name.

    Args:
      working: whether the working directory is included.
    """
    bases = dict.fromkeys((str(main.parent), str(file.by.parent)))
    if working:
        bases[""] = None
    names = dict.fromkeys((file.name, file.name.rpartition("://")[2], file.name.rpartition("/")[2]))
    # There are thousands of paths: pathlib takes five times as long.
    yield from (os.path.join(base, folder, name) for base in bases for folder in folders for name in names)  # noqa: PTH118


def _require_readable(file: _NamedFile, main: Path, folders: Iterable[str]) -> None:
    """Checks that this process may read the place where MuJoCo will find a file.

    A missing file must be reported like one outside the folder; otherwise a model could discover which files exist.
    """
    inside = outside = False
    for place in _places(file, main, folders, working=False):
        # MuJoCo opens some paths as written, and others after removing each .. with the name before it.
        readable = is_readable(place) and is_readable(os.path.normpath(place))
        exists = os.path.lexists(place) or os.path.lexists(os.path.normpath(place))
        if not readable and (exists or depends_on_processes(place)):
            raise BrokenModelError(file.by, f"{quoted(file.name)} {OUTSIDE}", file.line, advice())
        inside |= readable and (exists or file_size(place) is not None)
        outside |= not readable
    if outside and not inside:
        raise BrokenModelError(file.by, f"{quoted(file.name)} {OUTSIDE}", file.line, advice())


def _check(file: _NamedFile, place: str) -> os.stat_result | None:
    """Returns the status of a file that MuJoCo can read; None if it does not exist."""
    try:
        status = os.stat(place)  # noqa: PTH116
    except (OSError, ValueError):  # it does not exist, or no file can have this name
        return None
    if kind := KINDS.get(stat.S_IFMT(status.st_mode)):
        message = f"{quoted(file.name)} is {kind}; a model is read from regular files"
        raise BrokenModelError(file.by, message, file.line)
    if place.endswith(".png") and math.prod(size := _png_size(place)) > MOST_PIXELS:
        message = f"{quoted(file.name)} has {size[0]}x{size[1]} pixels, too many for a texture"
        raise BrokenModelError(file.by, message, file.line, "use a smaller image, such as 4096x4096")
    return status


def _png_size(path: str) -> tuple[int, int]:
    """Returns the width and height of a PNG image [pixels]; 0 if it is not one."""
    try:
        with open(path, "rb") as file:  # noqa: PTH123
            head = file.read(24)
    except OSError:
        return 0, 0
    if len(head) < 24 or not head.startswith(b"\x89PNG"):
        return 0, 0
    width, height = struct.unpack(">II", head[16:])
    return width, height
