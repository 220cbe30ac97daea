"""Opens files of demonstrations, and finds the text of their models."""

import re
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from mjrun.confinement.confinement import OUTSIDE, advice, is_readable
from mjrun.errors import FileError, MjrunError, ModelError, clean, option, quoted
from mjrun.hdf5.demonstration_summary import DemonstrationList
from mjrun.model.archive_paths import file_content
from mjrun.model.xml_source import is_regular
from mjrun.packages import require

if TYPE_CHECKING:
    from mjrun.hdf5.demonstrations import DemonstrationFile

CAMERA = re.compile(rb"<camera\b[^>]*?\bname=\"([^\"]*)\"")
FOLDER = "models"  # with the files that old demonstrations name


def open_demonstrations(path: Path) -> "DemonstrationFile":
    """Opens a file of demonstrations.

    Raises:
      FileError: the file cannot be read, or has no demonstrations.
      MissingExtraError: h5py is not installed.
    """
    if not is_readable(path):
        raise FileError(path, OUTSIDE, advice())
    if not is_regular(path):
        raise FileError(path, "is not a regular file" if path.exists() else "no such file")
    require(f"reading {path.suffix.lower()}", "hdf5", "h5py")
    from mjrun.hdf5.demonstrations import DemonstrationFile

    return DemonstrationFile(path)


def is_demonstration_file(path: Path) -> bool:
    """Returns whether an HDF5 file contains demonstrations; false if it cannot be read."""
    try:
        with open_demonstrations(path):
            return True
    except MjrunError:
        return False


def model_text(file: "DemonstrationFile", name: str) -> bytes:
    """Returns the MJCF of a demonstration.

    Raises:
      FileError: the file contains none, or the file that it names is missing.
    """
    text, source = file.model_text(name), f"{file.path}:{name}"
    if not text:
        example = f"mjrun video MODEL.xml {option('replay')} {clean(source)}"
        raise FileError(source, "contains no model", f"replay its states on another one, as in {example}")
    if text.startswith("<"):
        return text.encode()
    folder = file.path.parent / FOLDER
    content = file_content(str(folder / text)) if Path(text).name == text else None
    if content is None:
        reason = f"its model {quoted(text)} is missing in the folder {clean(str(folder))}"
        raise FileError(source, reason, "copy the folder of models of the demonstrations there")
    return content


def list_demonstrations(path: Path) -> DemonstrationList:
    """Describes all demonstrations in a file; their states and models are not checked.

    Raises:
      ModelError: the file cannot be read, or has no demonstrations.
      MissingExtraError: h5py is not installed.
    """
    with errors_of_models(), open_demonstrations(path) as file:
        cameras = list[str]()
        with suppress(FileError):  # not every file contains models
            cameras = [name.decode("utf-8", "replace") for name in CAMERA.findall(model_text(file, file.names[0]))]
        episodes = [file.episode(name) for name in file.names]
        return DemonstrationList(str(path), file.origin(), cameras, file.subsets, episodes)


@contextmanager
def errors_of_models() -> Generator[None]:
    """Turns errors about a file of demonstrations into errors about a model."""
    try:
        yield
    except FileError as error:
        raise ModelError(str(error)) from None
