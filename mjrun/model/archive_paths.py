"""Files on disk and in archives, addressed by one kind of path: `robot.mjz/meshes/arm.obj` is in `robot.mjz`."""

import os
import zipfile
from collections.abc import Iterable
from pathlib import Path

from mjrun.confinement.confinement import is_readable
from mjrun.suffixes import ARCHIVES

MOST = 1 << 26  # [bytes] larger files are not read; MJCF files are smaller


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
        with zipfile.ZipFile(archive) as opened:
            return opened.getinfo(_member(path, archive)).file_size
    except (OSError, KeyError, ValueError, zipfile.BadZipFile):
        return None


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
        with zipfile.ZipFile(archive) as opened:
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
            sources = [name for name in opened.namelist() if name.endswith(".xml")]
    except (OSError, zipfile.BadZipFile):
        return None
    expected = [f"{path.stem}.xml", "model.xml", f"{path.stem}/{path.stem}.xml", f"{path.stem}/model.xml"]
    main = next((name for name in expected if name in sources), sources[0] if len(sources) == 1 else None)
    return main and f"{path}/{main}"


def _archive(path: str) -> Path | None:
    """Returns the archive that contains a path."""
    parents = (parent for parent in Path(path).parents if parent.suffix in ARCHIVES)
    return next((parent for parent in parents if parent.is_file()), None)


def _member(path: str, archive: Path) -> str:
    return Path(path).relative_to(archive).as_posix()
