"""The models in files of demonstrations as sources, written `demo.hdf5:demo_3`."""

import posixpath
import re
import shlex
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

import mujoco

from mjrun.confinement.confinement import OUTSIDE, advice, is_readable
from mjrun.dataclass import dataclass
from mjrun.errors import BrokenModelError, FileError, MjrunError, ModelError, clean, counted, option, quoted
from mjrun.hdf5.demonstration_list import DemonstrationFileOrigin, DemonstrationList
from mjrun.model.model_files import AbsolutePathMjcf, file_content, installed_packages, packages_in, placed
from mjrun.model.override import ASSETS
from mjrun.model.source import ModelSource, compile_spec, load_respecting_confinement, model_errors
from mjrun.model.sources.file import parsing_checked
from mjrun.model.xml_source import is_regular
from mjrun.packages import require

if TYPE_CHECKING:
    from mjrun.hdf5.demonstrations import DemonstrationFile


CAMERA = re.compile(rb"<camera\b[^>]*?\bname=\"([^\"]*)\"")
FOLDER = "models"  # with the files that old demonstrations name
FOLDERS, NAMES = 4, 3  # folders with missing files in a message, and files of each
REPOSITORIES = {"libero": "https://github.com/Lifelong-Robot-Learning/LIBERO"}  # with assets that no package has
# Geoms that only collide, and sites, which robosuite shows during teleoperation.
HIDDEN_IN_ROBOSUITE = {"geom": (0,), "site": tuple(range(mujoco.mjNGROUP))}
TARGET = "assets"  # folder for packages with assets, in advice


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


@dataclass(frozen=True)
class DemonstrationSource(ModelSource):
    """The model of a demonstration.

    Attributes:
      path: the file of demonstrations.
      episode: the name of the demonstration in it; empty for the only one.
      label: the source as the user wrote it, if `path` is a copy.
    """

    path: Path
    episode: str = ""
    label: str = ""

    @property
    def text(self) -> str:
        return self.label or (f"{self.path}:{self.episode}" if self.episode else str(self.path))

    @property
    def stem(self) -> str:
        return re.sub(r"\W+", "_", f"{self.path.stem}_{self.episode}").strip("_")

    @property
    def files(self) -> tuple[Path, ...]:
        with suppress(MjrunError):  # loading raises it
            return (self.path, *self._model()[0].files)
        return (self.path,)

    @property
    def code(self) -> str:
        return self.episode

    @property
    def hidden_groups(self) -> Mapping[str, Sequence[int]]:
        with suppress(MjrunError), open_demonstrations(self.path) as file:
            return HIDDEN_IN_ROBOSUITE if file.origin(file.named(self.episode)).is_robosuite else {}
        return {}

    def stored_at(self, place: Callable[[Path], Path]) -> ModelSource:
        return replace(self, path=place(self.path), label=self.text)

    def mjcf(self) -> str:
        """Returns the text of the model, in which files have their places on this machine, unless they are missing.

        Raises:
          ModelError: it cannot be read.
        """
        with errors_of_models():
            return self._model()[0].text.decode("utf-8", "replace")

    def compile(self) -> tuple[mujoco.MjSpec | None, mujoco.MjModel]:
        return load_respecting_confinement(self._compile)

    def _compile(self) -> tuple[mujoco.MjSpec | None, mujoco.MjModel]:
        name = Path(self.text)
        with errors_of_models():
            model, origin = self._model()
        if model.missing:
            raise _missing_files(name, model, origin)
        overrides = [each for each in self.overrides if each.option != ASSETS]
        text, shown = model.text.decode("utf-8", "replace"), clean(shlex.quote(self.text))
        advice = (
            f"`mjrun info {shown} --xml > fixed.xml` writes its MJCF, `mjrun check --fix fixed.xml` corrects what is "
            f"certain, and {option('replay')} {shown} replays the states on the corrected model"
        )
        with model_errors(name, advice), parsing_checked(self.path, model.text, str(self.path), overrides):
            spec = mujoco.MjSpec.from_string(text)
        return compile_spec(spec, overrides, name, advice)

    def _model(self) -> tuple[AbsolutePathMjcf, DemonstrationFileOrigin]:
        """Reads the text of the model, in which files have their places on this machine."""
        with open_demonstrations(self.path) as file:
            name = file.named(self.episode)
            text, origin = model_text(file, name), file.origin(name)
        given = [Path(each.value) for each in self.overrides if each.option == ASSETS]
        return placed(text, self.path.parent, given), origin


def _missing_files(name: Path, model: AbsolutePathMjcf, origin: DemonstrationFileOrigin) -> BrokenModelError:
    """Returns an error that lists the missing files by folder, and states how to provide them."""
    paths = [PurePosixPath(posixpath.normpath(file)) for file in model.missing]
    folders = {path.parent for path in paths}
    common = posixpath.commonpath(folders) if len({folder.is_absolute() for folder in folders}) == 1 else ""
    by_folder: dict[str, list[str]] = {}
    for path in paths:
        folder = posixpath.relpath(path.parent, common) if common else str(path.parent)
        by_folder.setdefault(folder, []).append(path.name)

    count = len(model.files) + len(paths)
    lines = [f"{len(paths)} of the {counted(count, 'file')} that its model names are missing here: {common}"]
    lines += [f"  {folder}: {_few(files)}" for folder, files in [*by_folder.items()][:FOLDERS]]
    if len(by_folder) > FOLDERS:
        lines.append(f"  and in {counted(len(by_folder) - FOLDERS, 'other folder')}")
    example = clean(f"DIR/{paths[0].parent.name}/{paths[0].name}")
    ends = f"{option(ASSETS)} DIR finds them by any end of their paths, as in {example}"
    return BrokenModelError(name, "\n".join(lines), hint="\n".join([*_advice(model.missing, origin), ends]))


def _few(names: Sequence[str]) -> str:
    """Lists the first names, and the number of all if there are more."""
    more = f", … ({len(names)} in all)" if len(names) > NAMES else ""
    return ", ".join(names[:NAMES]) + more


def _advice(missing: Sequence[str], origin: DemonstrationFileOrigin) -> list[str]:
    """Returns the commands that provide the packages with missing files, as far as their paths name them."""
    lines: list[str] = []
    for package in dict.fromkeys(package for file in missing for package in packages_in(file)):
        version = origin.robosuite if package == "robosuite" and re.fullmatch(r"[\d.]+", origin.robosuite) else ""
        how = f"pip install --no-deps --target {TARGET} {package}{f'=={version}' if version else ''}"
        if package in REPOSITORIES:
            how = f"git clone {REPOSITORIES[package]} {TARGET}"
        other = f"the {package} that is installed does not have them; " if package in installed_packages() else ""
        lines.append(f"{other}to get those of {package}: {how}, then {option(ASSETS)} {TARGET}")
    return lines
