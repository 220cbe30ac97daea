"""Files that a model refers to: every path at which MuJoCo looks for them, and what lies near when there is none.

The paths are those that the installed MuJoCo opens, in its order.
"""

import os
from collections.abc import Iterator
from pathlib import Path

from mjrun.check.finding import Sighting
from mjrun.check.xml_source import POINTER, PULL, Element, Source, attached, included, regular, slashed
from mjrun.errors import clean, listing, near, quoted

MISSING, CYCLE = "MJ107", "MJ113"
FACES = ("fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")
HOLDERS = {"mesh": "meshdir", "hfield": "meshdir", "skin": "meshdir", "flexcomp": "meshdir", "texture": "texturedir"}
PACKAGE = "package://"  # of ROS, in URDF
LOOKED = 2000  # files that are looked at for one of the same name


def missing(source: Source) -> Iterator[tuple[str, Sighting]]:
    """Every file that the XML refers to and that is at none of the paths tried."""
    folders = _folders(source)
    for element in source.elements():
        for name in _named(element):
            tried = _tried(element, name, source, folders)
            if any(regular(path) for path in tried):
                continue
            message = f"no file {quoted(name)} for {element}; tried {listing([str(path) for path in tried])}"
            yield MISSING, Sighting(message, _remedy(name, tried, source), str(element), (element.file, element.line))


def pointers(source: Source) -> Iterator[tuple[str, Sighting]]:
    """Every asset in whose place Git LFS has left a pointer; in that of XML it is a fault of the XML."""
    folders = _folders(source)
    for element in (e for e in source.elements() if e.tag in HOLDERS):
        for name in _named(element):
            found = next(filter(regular, _tried(element, name, source, folders)), None)
            if found and _begins(found, POINTER):
                message = f"{quoted(name)} of {element} is a pointer of Git LFS, and not the file itself"
                yield MISSING, Sighting(message, PULL, str(element), (element.file, element.line))


def _begins(path: Path, with_: bytes) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(len(with_)) == with_
    except OSError:
        return False


def dangers(source: Source) -> Iterator[tuple[str, Sighting]]:
    """What ends or stops MuJoCo's process: models that attach themselves, and files that are pipes or devices."""
    folders, own = _folders(source), source.path.resolve()
    for element in source.elements():
        for name in _named(element):
            found = next((path for path in _tried(element, name, source, folders) if path.exists()), None)
            if found is None or found.is_dir():
                continue
            place = (element.file, element.line)
            if not regular(found):
                message = f"{quoted(name)} of {element} is a pipe or a device, for which MuJoCo would wait"
                yield MISSING, Sighting(message, "name a regular file", str(element), place)
            elif element.tag == "model" and found.resolve() == own:
                message = f"{element} attaches {quoted(name)}, which is the model itself"
                remedy = "attach another file; <replicate> repeats a part of this one"
                yield CYCLE, Sighting(message, remedy, str(element), place)


def _folders(source: Source) -> dict[str, str]:
    """What `<compiler>` says of folders and paths; the last one wins."""
    said: dict[str, str] = {}
    for element in source.elements():
        if element.tag == "compiler":
            if "assetdir" in element.attributes:
                said |= dict.fromkeys(("meshdir", "texturedir"), element.attributes["assetdir"])
            said |= {k: v for k, v in element.attributes.items() if k in ("meshdir", "texturedir", "strippath")}
    return said


def _named(element: Element) -> list[str]:
    """The files that `element` names."""
    keys = ("file", *FACES) if element.tag == "texture" else ("file", "filename")  # the latter in URDF
    kinds = (*HOLDERS, "include", "model")
    return [element.attributes[key] for key in keys if element.tag in kinds and element.attributes.get(key)]


def _tried(element: Element, name: str, source: Source, folders: dict[str, str]) -> list[Path]:
    """The paths at which MuJoCo looks for the file `name` of `element`."""
    home = source.path.parent
    if PACKAGE in name and folders.get("strippath") != "true":
        return [Path(name)]
    if element.tag == "include":
        return included(element, source.path)
    if element.tag == "model":
        return attached(element, source.path)
    name = slashed(name)
    if folders.get("strippath") == "true":
        name = os.path.basename(name)  # noqa: PTH119, a name that may end in a slash
    folder = home / folders.get(HOLDERS[element.tag], "")
    tried = [home / name] if element.tag == "flexcomp" else []
    tried.append(folder / name)
    if element.file != source.path:
        tried.append(folder / element.file.parent / name)
    return list(dict.fromkeys(tried))


def _remedy(name: str, tried: list[Path], source: Source) -> str:
    """What lies near: a file of this name in another folder, or one with a similar name."""
    base = Path(slashed(name)).name
    if PACKAGE in name:
        return 'MuJoCo knows no packages: write a path, or <mujoco><compiler strippath="true" meshdir=…/></mujoco>'
    below = list(_below(source.path.parent))
    cased = next((path for path in below if any(_folded(path) == _folded(other) for other in tried)), None)
    if cased:
        return f"there is {clean(str(cased))}: capitals and small letters differ in names of files and folders"
    close = near(base, _siblings(tried[0].parent))
    if close:
        return f"did you mean {quoted(close[0])}? it lies in {clean(str(tried[0].parent))}"
    elsewhere = next((path for path in below if path.name == base), None)
    if elsewhere:
        return f"there is {clean(str(elsewhere))}; meshdir, texturedir and assetdir of <compiler> say where files are"
    if not tried[0].parent.is_dir():
        folder = clean(str(tried[0].parent))
        return f"there is no folder {folder}; meshdir, texturedir and assetdir of <compiler> name it"
    return "paths are relative to the folder of the model, and to meshdir, texturedir or assetdir of <compiler>"


def _folded(path: Path) -> str:
    return os.path.normpath(path).casefold()


def _siblings(folder: Path) -> list[str]:
    try:
        return [entry.name for entry in folder.iterdir()]
    except OSError:
        return []


def _below(folder: Path) -> Iterator[Path]:
    """The first `LOOKED` files below `folder`."""
    count = 0
    for parent, folders, files in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(files):
            yield Path(parent) / name
            count += 1
            if count >= LOOKED:
                return
