"""The files of a model, on disk and in archives: `robot.mjz/meshes/arm.obj` is in `robot.mjz`.

Files that a model refers to are checked before MuJoCo opens them: a pipe or a device would block it. Their names are
extracted from the text by regular expressions, which is fast and accepts text that is not well-formed. Each file is
looked up in every place where MuJoCo may look for it.

Models in demonstrations name their meshes and textures by the absolute paths of the machine that recorded them. The
file `/home/someone/robosuite/robosuite/models/assets/robots/panda/link0.stl` is found in an installed robosuite, or in
a folder with `robosuite/models/assets/robots/panda/link0.stl`, or any shorter end of the path.
"""

import errno
import importlib.util
import io
import math
import os
import posixpath
import re
import stat
import struct
import zipfile
import zlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from dataclasses import field
from functools import cache
from pathlib import Path, PurePath, PurePosixPath
from typing import TYPE_CHECKING, NamedTuple

from mjrun.confinement.confinement import OUTSIDE, advice, confinement, depends_on_processes, is_readable
from mjrun.dataclass import dataclass
from mjrun.decompression_limits import excess
from mjrun.errors import BrokenModelError, quoted
from mjrun.model.xml_source import MAX_FILES, is_regular, with_slashes
from mjrun.suffixes import ARCHIVES

if TYPE_CHECKING:
    from mjrun.model.override import Override


MOST = 1 << 26  # [bytes] larger files are not read; MJCF files are smaller
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
_TEXT = re.compile(rb"(?:\xef\xbb\xbf)?\s*<")
MOST_BLANKS = 1 << 12  # [bytes] within which the text of a model begins
_ROOT = re.compile(rb"(?:\xef\xbb\xbf)?(?:\s+|<\?.*?\?>|<!--.*?-->)*<(\w+)", re.DOTALL)
MOST_PIXELS = 2**28  # per image: 16384x16384 pixels, which MuJoCo decodes into 805 MB
ROOTS = (b"mujoco", b"mujocoinclude", b"robot")
KINDS = {
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}
# Packages with assets, which are not imported.
PACKAGES = ("robosuite", "robosuite_models", "robosuite_task_zoo", "libero", "robocasa", "mimicgen", "dexmimicgen")
CACHES = {"libero": "~/.cache/libero/assets"}  # folders to which packages download their assets
FORMER_NAMES = {"chiliocosm": "libero"}  # folders in the paths of public files
NESTED = ("assets", "*/assets", "*/*/assets")  # folders of assets in a package or a clone
SHORTEST = 2  # parts of the end of a path that is looked up in packages
# Archives that stay open by their path, and what closes them; none outside of `_archives_stay_open`.
_open_archives = ContextVar[tuple[ExitStack, dict[Path, zipfile.ZipFile]] | None]("archives", default=None)


def main_text(path: Path) -> tuple[bytes | None, str]:
    """Returns the text that MuJoCo parses first, and its path; None and an empty path for a compiled model."""
    main = str(path) if path.suffix == ".urdf" else main_mjcf(path)
    return (file_content(main), main) if main else (None, "")


def file_size(path: str) -> int | None:
    """Returns the size of a file [bytes]; None if it does not exist."""
    if not is_readable(path):
        return None
    archive = _archive(path)
    try:
        if archive is None:
            return Path(path).stat().st_size if Path(path).is_file() else None
        with _opened(archive) as opened:
            return opened.getinfo(_member(path, archive)).file_size
    except (OSError, KeyError, ValueError, zipfile.BadZipFile):
        return None


@contextmanager
def _archives_stay_open() -> Iterator[None]:
    """Opens each archive once: to read the list of its files for each of thousands of files would take minutes."""
    with ExitStack() as stack:
        stack.callback(_open_archives.reset, _open_archives.set((stack, {})))
        yield


@contextmanager
def _opened(path: Path) -> Iterator[zipfile.ZipFile]:
    with ExitStack() as stack:
        staying, archives = _open_archives.get() or (stack, dict[Path, zipfile.ZipFile]())
        if path not in archives:
            archives[path] = staying.enter_context(zipfile.ZipFile(path))
        yield archives[path]


def first_existing(places: Iterable[str]) -> str | None:
    """Returns the first of some paths that exists, without `..`; None if none does."""
    normal = (os.path.normpath(place) for place in places)
    return next((place for place in normal if file_size(place) is not None), None)


def file_content(path: str) -> bytes | None:
    """Returns the content of a file; None if it does not exist or is larger than `MOST`."""
    if (file_size(path) or MOST + 1) > MOST:
        return None
    archive = _archive(path)
    try:
        if archive is None:
            return Path(path).read_bytes()
        with _opened(archive) as opened:
            return opened.read(_member(path, archive))
    except (OSError, KeyError, RuntimeError, ValueError, zipfile.BadZipFile):
        return None


def unpacked_size(path: Path) -> int:
    """Returns the total size of the files in an archive [bytes], according to the archive; 0 if it is damaged."""
    try:
        with zipfile.ZipFile(path) as opened:
            return sum(info.file_size for info in opened.infolist())
    except (OSError, ValueError, zipfile.BadZipFile):
        return 0


def main_mjcf(path: Path) -> str | None:
    """Returns the MJCF that MuJoCo reads first: `path` itself, or a member of an archive, or None."""
    if path.suffix not in ARCHIVES:
        return str(path) if path.suffix == ".xml" else None
    try:
        if not path.is_file():  # opening a pipe would block
            return None
        with zipfile.ZipFile(path) as opened:
            sources = {posixpath.normpath(name): name for name in opened.namelist() if name.endswith(".xml")}
    except (OSError, zipfile.BadZipFile):
        return None
    expected = ["model.xml", f"{path.stem}.xml", f"{path.stem}/{path.stem}.xml", f"{path.stem}/model.xml"]
    main = next((name for name in expected if name in sources), next(iter(sources)) if len(sources) == 1 else None)
    return main and f"{path}/{sources[main]}"


def _texts_in(archive: Path) -> Iterator[tuple[str, bytes]]:
    """Yields the paths and contents of all MJCF files in an archive, of which MuJoCo may read any."""
    faults = (OSError, RuntimeError, ValueError, EOFError, zlib.error, zipfile.BadZipFile)
    with suppress(*faults), zipfile.ZipFile(archive) as opened:
        if excess(archive, sum(info.file_size for info in opened.infolist())):  # which is refused when it is loaded
            return
        for info in opened.infolist():
            if info.filename.endswith(".xml") and info.file_size <= MOST:
                yield f"{archive}/{info.filename}", opened.read(info)


def _on_disk(places: Iterable[str]) -> Iterator[str]:
    """Yields the files on disk in which MuJoCo may read `places`: these, or the archives that contain them.

    MuJoCo opens some paths as written, and others, such as those of files in archives, after removing each `..`.
    """
    for place in places:
        for path in (place, os.path.normpath(place)) if ".." in place else (place,):
            is_within = any(f"{suffix}/" in path for suffix in ARCHIVES)
            yield str((_archive(path) if is_within else None) or path)


def _archive(path: str) -> Path | None:
    """Returns the archive that contains a path."""
    parents = (parent for parent in Path(path).parents if parent.suffix in ARCHIVES)
    return next((parent for parent in parents if parent.is_file()), None)


def _member(path: str, archive: Path) -> str:
    return Path(path).relative_to(archive).as_posix()


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
    """Checks that each file named in the MJCF or URDF `text`, or in its includes, is a regular file, and readable.

    In a confined process, no such file may be outside the readable folders either, whether it exists or not.

    Args:
      path: the path of the text; its files may be next to it, or in the working directory.
      member: the path of the text if it is in the archive `path`.
      overrides: overrides of the model, which may name other files.

    Returns:
      The status of each file that exists, by its path.

    Raises:
      BrokenModelError: a file is a pipe, a socket or a device, cannot be read, or is outside.
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
    files = dict.fromkeys(filter(is_regular, map(Path, dict.fromkeys(_on_disk(places)))))
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
    return [[*_on_disk(_places(file, path, named.folders))] for file in named.files]


def with_absolute_paths(text: bytes, place: Callable[[str], str | Path]) -> bytes:
    """Returns MJCF or URDF with every absolute path in it replaced by its `place`."""
    return _with_paths(text, _PATH, lambda name: place(name) if PurePath(name).root else name)


def redirected(path: Path, place: Callable[[str], str | Path]) -> bytes | None:
    """Returns a model, or an archive of models, with every absolute path in its texts replaced by its `place`.

    A text is recognized by its beginning, since an included file may have any suffix.

    Returns:
      None if the file has no such paths, or is neither.

    Raises:
      OSError: the file cannot be read.
    """
    if path.suffix in ARCHIVES:
        return _redirected_archive(path, place)
    with path.open("rb") as file:
        if not _TEXT.match(file.read(MOST_BLANKS)):
            return None
        file.seek(0)
        text = file.read()
    new = with_absolute_paths(text, place)
    return None if new == text else new


def _redirected_archive(path: Path, place: Callable[[str], str | Path]) -> bytes | None:
    try:
        with zipfile.ZipFile(path) as old:
            if excess(path, sum(info.file_size for info in old.infolist())):  # which is refused when it is loaded
                return None
            texts = {name: old.read(name) for name in old.namelist() if _is_text(old, name)}
            new = {name: with_absolute_paths(text, place) for name, text in texts.items()}
            if new == texts:
                return None
            with zipfile.ZipFile(written := io.BytesIO(), "w") as archive:
                for info in old.infolist():
                    archive.writestr(info, new.get(info.filename) or old.read(info))
            return written.getvalue()
    except (RuntimeError, ValueError, EOFError, zlib.error, zipfile.BadZipFile):  # encrypted, or damaged
        return None


def _is_text(archive: zipfile.ZipFile, member: str) -> bool:
    with archive.open(member) as file:
        return bool(_TEXT.match(file.read(MOST_BLANKS)))


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


@_archives_stay_open()
def _collect(path: Path, text: bytes, member: str = "") -> _NamedFiles:
    """Collects the file names in a text, and in the files that it includes or attaches."""
    named, waiting, visited = _NamedFiles(), deque([(Path(member or path), text)]), {str(path.absolute())}
    if path.suffix in ARCHIVES and is_regular(path):
        waiting.extend((Path(name), inner) for name, inner in _texts_in(path) if name != member or inner != text)
    while waiting and len(visited) <= MAX_FILES:
        by, content = waiting.popleft()
        named.folders |= dict.fromkeys(value for value, _ in _values(_FOLDER, content))
        named.files += [_NamedFile(value, by, line) for value, line in _values(_FILE, content)]
        for tag in _MODEL.finditer(content):
            for name, line in _values(_FILE, tag[0]):
                for place in _places(_NamedFile(name, by, line), path, [""]):
                    whole = os.path.abspath(place)  # noqa: PTH100 – pathlib keeps .., and a circle would never end
                    if whole in visited or file_size(place) is None:
                        continue
                    visited.add(whole)
                    is_archive = whole.endswith(ARCHIVES)
                    if is_archive and confinement() and _archive(place):
                        message = f"{quoted(name)} is an archive in an archive, whose files cannot be checked"
                        raise BrokenModelError(by, message, line, "unpack the inner archive into the outer one")
                    texts = [*_texts_in(Path(whole))] if is_archive else [(place, file_content(place))]
                    for inner, inner_text in texts:
                        if inner_text is not None:
                            named.models[inner] = inner_text
                            waiting.append((Path(inner), inner_text))
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
        if not os.access(place, os.R_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except PermissionError as error:  # MuJoCo would call it empty
        raise BrokenModelError(file.by, f"{quoted(file.name)} cannot be read: {error.strerror}", file.line) from None
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


@dataclass(frozen=True)
class AbsolutePathMjcf:
    """The text of a model in which every file is named by its place on this machine.

    Attributes:
      text: the MJCF.
      files: the files.
      missing: the names of files that were not found, as in the original text.
    """

    text: bytes
    files: Sequence[Path]
    missing: Sequence[str] = field(default=())


def placed(text: bytes, folder: Path, given: Sequence[Path] = ()) -> AbsolutePathMjcf:
    """Looks up the files that a model names.

    Each is searched in the `given` folders, then at its own path, relative to `folder`, and then in installed packages.
    In folders and packages, the longest end of its path that exists there counts.
    """
    prefixes = ["", *folder_names(text)]
    places: dict[str, Path | None] = {}
    roots: dict[str, Path] = {}  # by the folder of the original path: those of later files are tried first
    for name in dict.fromkeys(file_names(text)):
        paths = [posixpath.normpath(posixpath.join(prefix, name)) for prefix in prefixes]
        places[name] = next((place for path in paths if (place := _place(path, folder, given, roots))), None)

    def here(name: str) -> str:
        return str(path.absolute()) if (path := places.get(name)) else name

    files = [path for path in places.values() if path]
    return AbsolutePathMjcf(with_file_names(text, here), files, [name for name, path in places.items() if not path])


def packages_in(path: str) -> list[str]:
    """Returns the packages whose assets a path may name, by its folders."""
    parts = PurePosixPath(with_slashes(path)).parts
    exact = [package for package in PACKAGES if package in parts]
    return exact or [package for package in PACKAGES if _rank(package, parts) == 1]


def installed_packages() -> Mapping[str, Sequence[Path]]:
    """Returns the folders of assets of each package that is installed or has downloaded some."""
    return _installed()


def _place(path: str, folder: Path, given: Sequence[Path], roots: dict[str, Path]) -> Path | None:
    """Returns the place of a file; None if it is missing."""
    home = posixpath.dirname(path)
    if home in roots and is_regular(nearby := roots[home] / posixpath.basename(path)):
        return nearby
    found = _searched(path, folder, given)
    if found:
        roots[home] = found.parent
    return found


def _searched(path: str, folder: Path, given: Sequence[Path]) -> Path | None:
    parts = [part for part in path.split("/") if part not in ("", ".", "..")]
    ends = ["/".join(parts[start:]) for start in range(len(parts))]
    candidates = [place / end for end in ends for root in given for place in folders_of_assets(root)]
    candidates.append(folder / path)
    candidates += _in_packages(ends, parts)
    return next(filter(is_regular, candidates), None)


def _in_packages(ends: Sequence[str], parts: Sequence[str]) -> Iterator[Path]:
    """Yields the places of a file in packages, the longest end of its path first."""
    packages = sorted(_installed().items(), key=lambda item: _rank(item[0], parts))
    for end in ends[: len(ends) - SHORTEST + 1]:
        for package, folders in packages:
            if end.startswith(f"{package}/"):
                yield folders[0].parent / end
            yield from (place / end for place in folders)


def _rank(package: str, parts: Sequence[str]) -> int:
    """Returns how likely a path names a file of a package, 0 being the likeliest."""
    if package in parts:
        return 0
    return 1 if any(FORMER_NAMES.get(part, part).startswith(package) for part in parts) else 2


@cache
def folders_of_assets(root: Path) -> Sequence[Path]:
    """Returns a folder, and the folders of assets in it, as in a package or in a clone."""
    return (root, *(place for pattern in NESTED for place in sorted(root.glob(pattern))))


@cache
def _installed() -> Mapping[str, Sequence[Path]]:
    found: dict[str, Sequence[Path]] = {}
    for package in PACKAGES:
        spec = importlib.util.find_spec(package)
        places = [Path(place) for place in (spec.submodule_search_locations or [])[:1]] if spec else []
        folders = [folder for place in places for folder in folders_of_assets(place)]
        cache = os.path.expanduser(CACHES.get(package, ""))  # noqa: PTH111 – a user may have no home
        if cache and os.path.isdir(cache):  # noqa: PTH112
            folders.append(Path(cache))
        if folders:
            found[package] = folders
    return found
