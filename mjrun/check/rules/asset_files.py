"""Files that a model refers to, and the paths at which the installed MuJoCo looks for them, in its order."""

import os
from collections.abc import Iterator
from functools import partial
from itertools import islice
from pathlib import Path

from mjrun.check.finding import Finding, Fix
from mjrun.check.rule import SAFE, Rule
from mjrun.errors import clean, listing, near, quoted
from mjrun.formats.input_file import files_below, in_any_case
from mjrun.model import xml_source
from mjrun.model.text_edits import ElementEditor

MISSING_FILE = Rule("MJ107", "error", "missing file", fix=SAFE)

FOLDER_ATTRIBUTES = {
    "mesh": "meshdir",
    "hfield": "meshdir",
    "skin": "meshdir",
    "flexcomp": "meshdir",
    "texture": "texturedir",
}
ROS_PACKAGE = "package://"  # in URDF
MAX_SEARCHED = 2000  # files in the search for a file of the same name


def missing_files(source: xml_source.XmlSource) -> Iterator[Finding]:
    """Yields a finding for each file that the XML refers to and that is missing wherever MuJoCo looks."""
    for element, name, paths in _missing(source):
        message = f"no file {quoted(name)} for {element}; tried {listing([str(path) for path in paths])}"
        fix = partial(_in_right_case, source, element, name, paths)
        yield MISSING_FILE.in_element(element, message, _remedy(name, paths, source), fix)


def elements_without_file(source: xml_source.XmlSource) -> set[xml_source.Element]:
    """Returns the elements that refer to missing files."""
    return {element for element, *_ in _missing(source)}


def asset_of_other_file(source: xml_source.XmlSource, kind: str, name: str) -> xml_source.Element | None:
    """Returns the element that would be called `name`, if its missing file were the one beside it; None without one."""
    for element, _, paths in _missing(source):
        named = element.tag != kind or "name" in element.attributes
        if not named and any(Path(file).stem == name for path in paths for file in _siblings(path.parent)):
            return element
    return None


def _missing(source: xml_source.XmlSource) -> Iterator[tuple[xml_source.Element, str, list[Path]]]:
    """Yields the elements that refer to missing files, the names of these files, and the paths that MuJoCo tries.

    The folders of assets are unknown if `source` is not well-formed, since a `<compiler>` may follow the error.
    """
    folders = asset_folders(source)
    for element in source.elements():
        for name in () if source.errors and element.tag in FOLDER_ATTRIBUTES else _file_names(element):
            paths = _paths(element, name, source, folders)
            if not any(xml_source.is_regular(path) for path in paths):
                yield element, name, paths


def lfs_pointers(source: xml_source.XmlSource) -> Iterator[Finding]:
    """Yields a finding for each asset of which only a Git LFS pointer exists; as XML they are not well-formed."""
    folders = asset_folders(source)
    for element in (e for e in source.elements() if e.tag in FOLDER_ATTRIBUTES):
        for name in _file_names(element):
            path = _found(element, name, source, folders)
            if path and _starts_with(path, xml_source.LFS_POINTER):
                message = f"{quoted(name)} of {element} is a Git LFS pointer, not the file itself"
                yield MISSING_FILE.in_element(element, message, xml_source.LFS_REMEDY)


def file_of(element: xml_source.Element, source: xml_source.XmlSource) -> Path | None:
    """Returns the file that MuJoCo opens for an element; None without one."""
    found = (_found(element, name, source, asset_folders(source)) for name in _file_names(element))
    return next(found, None)


def _found(
    element: xml_source.Element, name: str, source: xml_source.XmlSource, folders: dict[str, str]
) -> Path | None:
    return next(filter(xml_source.is_regular, _paths(element, name, source, folders)), None)


def _starts_with(path: Path, prefix: bytes) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(len(prefix)) == prefix
    except OSError:
        return False


def asset_folders(source: xml_source.XmlSource) -> dict[str, str]:
    """Returns the attributes of `<compiler>` that concern paths; the last one wins."""
    folders: dict[str, str] = {}
    for element in source.elements():
        if element.tag == "compiler":
            if "assetdir" in element.attributes:
                folders |= dict.fromkeys(("meshdir", "texturedir"), element.attributes["assetdir"])
            folders |= {k: v for k, v in element.attributes.items() if k in ("meshdir", "texturedir", "strippath")}
    return folders


def _file_names(element: xml_source.Element) -> list[str]:
    """Returns the names of files in the attributes of `element`."""
    return [element.attributes[key] for key in file_attributes(element) if element.attributes.get(key)]


def file_attributes(element: xml_source.Element) -> tuple[str, ...]:
    """Returns the attributes of `element` that name files."""
    if element.tag not in (*FOLDER_ATTRIBUTES, "include", "model"):
        return ()
    return ("file", *xml_source.CUBE_FACES) if element.tag == "texture" else ("file", "filename")  # the latter in URDF


def _paths(element: xml_source.Element, name: str, source: xml_source.XmlSource, folders: dict[str, str]) -> list[Path]:
    """Returns the paths at which MuJoCo looks for the file `name` of `element`."""
    home = source.path.parent
    if ROS_PACKAGE in name and folders.get("strippath") != "true":
        return [Path(name)]
    if element.tag in ("include", "model"):
        return xml_source.xml_paths(element, source.path)
    name = xml_source.with_slashes(name)
    if folders.get("strippath") == "true":
        name = os.path.basename(name)  # noqa: PTH119, a name that may end in a slash
    folder = home / folders.get(FOLDER_ATTRIBUTES[element.tag], "")
    paths = [home / name] if element.tag == "flexcomp" else []
    paths.append(folder / name)
    if element.file != source.path:
        paths.append(folder / element.file.parent / name)
    return list(dict.fromkeys(paths))


def _remedy(name: str, paths: list[Path], source: xml_source.XmlSource) -> str:
    """Returns the file that may be meant: one with a similar name, or with the same name in another folder."""
    base = Path(xml_source.with_slashes(name)).name
    if ROS_PACKAGE in name:
        return 'MuJoCo resolves no packages: write a path, or <mujoco><compiler strippath="true" meshdir=…/></mujoco>'
    if other_case := next(_in_other_case(paths), None):
        return f"{clean(str(other_case))} exists: names of files and folders are case-sensitive"
    close = near(base, [each for each in _siblings(paths[0].parent) if each != source.path.name])
    if close:
        return f"did you mean {quoted(close[0])}? it is in {clean(str(paths[0].parent))}"
    below = islice(files_below(source.path.parent), MAX_SEARCHED)
    elsewhere = next((path for path in below if path.name == base), None)
    if elsewhere:
        return f"{clean(str(elsewhere))} exists; meshdir, texturedir and assetdir of <compiler> set the folder of files"
    if Path(name).is_absolute():
        return "write the path relative to the folder of the model, so that other machines find the file, too"
    if not paths[0].parent.is_dir():
        folder = clean(str(paths[0].parent))
        return f"the folder {folder} does not exist; meshdir, texturedir and assetdir of <compiler> set it"
    return "paths are relative to the folder of the model, and to meshdir, texturedir or assetdir of <compiler>"


def _in_right_case(
    source: xml_source.XmlSource, element: xml_source.Element, name: str, paths: list[Path]
) -> Fix | str:
    """Returns the fix that writes the name of a file with the letters that it has on disk."""
    for found in _in_other_case(paths):
        written = Path(xml_source.with_slashes(name))
        new = Path(*found.parts[-len(written.parts) :]).as_posix()
        attribute = next(key for key in file_attributes(element) if element.attributes.get(key) == name)
        if new.casefold() == written.as_posix().casefold():
            edit = ElementEditor(source.mjcf_texts).with_value(element, attribute, new)
            return Fix((edit,), files=(str(found),))
    return "no file has this name in other letters"


def _in_other_case(paths: list[Path]) -> Iterator[Path]:
    """Yields the files with one of `paths`, but for the case of letters."""
    return (file for path in paths for file in in_any_case(path) if xml_source.is_regular(file))


def _siblings(folder: Path) -> list[str]:
    try:
        return [entry.name for entry in folder.iterdir()]
    except OSError:
        return []
