"""Files on disk and inside archives by one kind of path: `robot.mjz/meshes/arm.obj` lies in `robot.mjz`."""

import zipfile
from pathlib import Path

from mjrun.confinement.confinement import is_readable
from mjrun.suffixes import ARCHIVES

MOST = 1 << 26  # [bytes] files beyond this are not read; MJCF is smaller


def file_size(path: str) -> int | None:
    """The size of a file [bytes]; None if there is none."""
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


def file_content(path: str) -> bytes | None:
    """The content of a file; None if there is none, or more than `MOST`."""
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
    """The bytes of all files in the archive `path`, according to it; 0 of what is none, or damaged."""
    try:
        with zipfile.ZipFile(path) as opened:
            return sum(info.file_size for info in opened.infolist())
    except (OSError, ValueError, zipfile.BadZipFile):
        return 0


def main_mjcf(path: Path) -> str | None:
    """The MJCF that MuJoCo reads first: `path` itself, or the one in an archive; None of a compiled model."""
    if path.suffix not in ARCHIVES:
        return str(path) if path.suffix == ".xml" else None
    try:
        if not path.is_file():  # a pipe would be waited for
            return None
        with zipfile.ZipFile(path) as opened:
            sources = [name for name in opened.namelist() if name.endswith(".xml")]
    except (OSError, zipfile.BadZipFile):
        return None
    expected = [f"{path.stem}.xml", "model.xml", f"{path.stem}/{path.stem}.xml", f"{path.stem}/model.xml"]
    main = next((name for name in expected if name in sources), sources[0] if len(sources) == 1 else None)
    return main and f"{path}/{main}"


def _archive(path: str) -> Path | None:
    """The archive that a path lies in."""
    parents = (parent for parent in Path(path).parents if parent.suffix in ARCHIVES)
    return next((parent for parent in parents if parent.is_file()), None)


def _member(path: str, archive: Path) -> str:
    return Path(path).relative_to(archive).as_posix()
