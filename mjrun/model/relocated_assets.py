"""The files of a model that was compiled on another machine, found here by the ends of their paths.

Models in demonstrations name their meshes and textures by the absolute paths of the machine that recorded them. The
file `/home/someone/robosuite/robosuite/models/assets/robots/panda/link0.stl` is found in an installed robosuite, or in
a folder with `robosuite/models/assets/robots/panda/link0.stl`, or any shorter end of the path.
"""

import importlib.util
import os
import posixpath
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from functools import cache
from pathlib import Path, PurePosixPath

from mjrun.dataclass import dataclass
from mjrun.model.referenced_files import file_names, folder_names, with_file_names
from mjrun.model.xml_source import is_regular, with_slashes

# Packages with assets, which are not imported.
PACKAGES = ("robosuite", "robosuite_models", "robosuite_task_zoo", "libero", "robocasa", "mimicgen", "dexmimicgen")
CACHES = {"libero": "~/.cache/libero/assets"}  # folders to which packages download their assets
FORMER_NAMES = {"chiliocosm": "libero"}  # folders in the paths of public files
NESTED = ("assets", "*/assets", "*/*/assets")  # folders of assets in a package or a clone
SHORTEST = 2  # parts of the end of a path that is looked up in packages


@dataclass(frozen=True)
class AbsolutePathModel:
    """The text of a model in which every file is named by its place on this machine.

    Attributes:
      text: the MJCF.
      files: the files.
      missing: the names of files that were not found, as in the original text.
    """

    text: bytes
    files: Sequence[Path]
    missing: Sequence[str] = field(default=())


def placed(text: bytes, folder: Path, given: Sequence[Path] = ()) -> AbsolutePathModel:
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
    return AbsolutePathModel(with_file_names(text, here), files, [name for name, path in places.items() if not path])


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


def folders_of_assets(root: Path) -> Sequence[Path]:
    """Returns a folder, and the folders of assets in it, as in a package or in a clone."""
    return _folders(root)


@cache
def _folders(root: Path) -> tuple[Path, ...]:
    return (root, *(place for pattern in NESTED for place in sorted(root.glob(pattern))))


@cache
def _installed() -> Mapping[str, Sequence[Path]]:
    found: dict[str, Sequence[Path]] = {}
    for package in PACKAGES:
        spec = importlib.util.find_spec(package)
        places = [Path(place) for place in (spec.submodule_search_locations or [])[:1]] if spec else []
        folders = [folder for place in places for folder in _folders(place)]
        cache = os.path.expanduser(CACHES.get(package, ""))  # noqa: PTH111 – a user may have no home
        if cache and os.path.isdir(cache):  # noqa: PTH112
            folders.append(Path(cache))
        if folders:
            found[package] = folders
    return found
