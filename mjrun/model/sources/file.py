"""Model files as sources: MJCF, URDF, archives of these, and compiled models."""

import errno
import os
import shlex
import stat
import zipfile
from abc import abstractmethod
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from mjrun.confinement.confinement import OUTSIDE, advice, confinement, is_readable
from mjrun.dataclass import dataclass
from mjrun.decompression_limits import HINT, excess
from mjrun.errors import BrokenModelError, CompiledOverrideError, ModelNotFoundError, clean, option
from mjrun.model import model_files
from mjrun.model.compilation import FAULTS, broken_model, check_model, compile_spec, load_confined, refusals_named
from mjrun.model.model_files import existing_files, foreign_file, require_regular_files
from mjrun.model.mujoco_globals import drop_outdated_assets, without_log
from mjrun.model.override import Override
from mjrun.model.parser_hazards import require_finite_nesting
from mjrun.model.source import CollectionModelSource, ModelSource
from mjrun.platform.installation import scene_folder
from mjrun.shared_status import doing
from mjrun.suffixes import ARCHIVES, COMPILED, MODELS, MOTIONS, is_yaml


@dataclass(frozen=True)
class FileSource(ModelSource):
    """A model file: .xml, .urdf, .mjz, .zip or .mjb.

    Attributes:
      label: the source as the user wrote it, if `path` is a copy of its file.
    """

    path: Path
    label: str = ""

    @property
    def text(self) -> str:
        return self.label or str(self.path)

    @property
    def stem(self) -> str:
        return self.path.stem

    @property
    def main_file(self) -> Path:
        return self.path

    @property
    def files(self) -> tuple[Path, ...]:
        return (self.path, *existing_files(self.path, *model_files.main_text(self.path), self.overrides))

    def stored_at(self, place: Callable[[Path], Path]) -> ModelSource:
        return replace(self, path=place(self.path), label=self.text)

    def compile(self) -> tuple[mujoco.MjSpec | None, mujoco.MjModel]:
        return load_confined(self._compile)

    def _compile(self) -> tuple[mujoco.MjSpec | None, mujoco.MjModel]:
        self._check_file()
        if self.path.suffix in COMPILED:
            return None, self._load_compiled()
        name = Path(self.text)
        advice = f"mjrun check {clean(shlex.quote(self.text))} shows the place and a remedy"
        with refusals_named(name, advice):
            text, main = model_files.main_text(self.path)
            with parsing_checked(self.path, text, main, self.overrides):
                spec = self._parse()
        return compile_spec(spec, self.overrides, name, advice)

    def _not_found(self) -> ModelNotFoundError:
        """Returns the error for a missing file, whose path may be a URL or name an unknown collection."""
        from mjrun.model.sources import model_collections  # which imports this module

        path, reason = self.path, "no such model file"
        prefix, colon, _ = self.text.partition(":")
        if prefix in ("http", "https"):
            reason += "; mjrun downloads nothing: save the model, with the files that it names, and give its path"
            return ModelNotFoundError(path, reason)
        if colon and "/" not in prefix:
            collections = [f"{each}:" for each in sorted(model_collections())]
            return ModelNotFoundError(path, reason, collections, "collections of models", f"{prefix}:")
        meant = [f"scene:{path}"] if _is_scene(path) else []
        return ModelNotFoundError(path, reason, *_models_in(path.parent), meant=meant)

    def _check_file(self) -> None:
        path = self.path
        if not is_readable(path):
            raise ModelNotFoundError(path, f"{OUTSIDE}\n{advice()}")
        try:
            mode = path.stat().st_mode
        except FileNotFoundError:
            raise self._not_found() from None
        except OSError as error:
            raise ModelNotFoundError(path, error.strerror or str(error)) from None
        except ValueError as error:  # a null character in the path
            raise ModelNotFoundError(path, str(error)) from None

        if stat.S_ISDIR(mode):
            raise ModelNotFoundError(path, "is a folder, not a model file", *_models_in(path))
        if not stat.S_ISREG(mode):
            raise ModelNotFoundError(path, "is not a regular file")
        if not os.access(path, os.R_OK):
            raise ModelNotFoundError(path, os.strerror(errno.EACCES))
        try:
            str(path).encode()
        except UnicodeEncodeError:  # surrogates represent bytes that are not UTF-8
            reason = "MuJoCo opens only paths in UTF-8; rename the file or folder, or cd into the folder"
            raise ModelNotFoundError(path, reason) from None
        if "\\" in str(path) and path.suffix not in COMPILED:
            reason = "MuJoCo reads a backslash in a path as a folder separator; rename the file or folder"
            raise ModelNotFoundError(path, reason)
        if path.suffix not in MODELS:
            lower = "; MuJoCo accepts them in lower case only" if path.suffix.lower() in MODELS else ""
            task = "; in Python, mjrun.read_task reads a task" if is_yaml(path) else ""
            reason = f"is not a model file; model files end in {', '.join(MODELS)}{lower or task}"
            if path.suffix in MOTIONS:
                reason += f"\nto replay it, name its model as well: MODEL {option('replay')} {clean(str(path))}"
            raise ModelNotFoundError(path, reason)

        if path.suffix in model_files.ARCHIVES and (fault := excess(path, model_files.unpacked_size(path))):
            raise BrokenModelError(path, fault, hint=HINT)

    def _load_compiled(self) -> mujoco.MjModel:
        if confinement():
            reason = f"is a compiled model, whose content MuJoCo does not check; {option('untrusted')} loads only XML"
            raise ModelNotFoundError(self.path, reason)
        if self.overrides:
            raise CompiledOverrideError(self.path, [(s.option, s.option_value) for s in self.overrides])
        with without_log(), doing("reading", self.path):
            try:
                model = mujoco.MjModel.from_binary_path(str(self.path))
            except FAULTS as error:
                version = mujoco.mj_versionString()
                hint = f"a .mjb file loads only in the version of MuJoCo that wrote it; this is {version}"
                raise broken_model(self.path, error, hint) from error
        check_model(model, self.path)
        if np.any((model.body_treeid < -1) | (model.body_treeid >= model.ntree)):
            reason = "it is damaged: body_treeid refers to trees that do not exist"
            raise BrokenModelError(self.path, reason, hint="compile it again from its source")
        return model

    def _parse(self) -> mujoco.MjSpec:
        path = self.path
        if path.suffix not in ARCHIVES:
            return mujoco.MjSpec.from_file(str(path))

        # MuJoCo looks for model.xml or a member named like the archive; its own `to_zip` writes neither.
        with zipfile.ZipFile(path) as archive:
            members = [name for name in archive.namelist() if name.endswith(".xml")]
        expected = {"model.xml", f"{path.stem}.xml", f"{path.stem}/{path.stem}.xml", f"{path.stem}/model.xml"}
        if len(members) == 1 and not expected & set(members):
            with path.open("rb") as archive:
                return mujoco.MjSpec.from_zip(archive)
        return mujoco.MjSpec.from_file(str(path))


class CollectionFileSource(CollectionModelSource):
    """A model in a collection of files; `main_file` is its file."""

    @property
    @abstractmethod
    def main_file(self) -> Path:
        """The model file."""

    @property
    def files(self) -> tuple[Path, ...]:
        return FileSource(self.main_file, overrides=self.overrides).files

    def stored_at(self, place: Callable[[Path], Path]) -> ModelSource:
        return FileSource(place(self.main_file), self.text, overrides=self.overrides)

    def compile(self) -> tuple[mujoco.MjSpec | None, mujoco.MjModel]:
        return FileSource(self.main_file, overrides=self.overrides).compile()


@contextmanager
def parsing_checked(path: Path, text: bytes | None, main: str, overrides: Sequence[Override] = ()) -> Generator[None]:
    """Checks a text for hazards before the `with` block, where MuJoCo parses it, and explains a foreign file there.

    Args:
      path: the file that contains the text, or the archive.
      text: the MJCF or URDF; None for a compiled model.
      main: the path of the text, in the archive if it is in one; empty for a compiled model.
      overrides: overrides that will be applied to the specification.

    Raises:
      BrokenModelError: the text would block or crash MuJoCo, or includes a foreign file.
    """
    drop_outdated_assets(require_regular_files(path, text, main, overrides))
    if main:
        require_finite_nesting(path, main, text)
    try:
        yield
    except FAULTS:
        if foreign := foreign_file(path, text):
            raise BrokenModelError(path, f"it includes or attaches {clean(foreign)}, which is not MJCF") from None
        raise


def _is_scene(path: Path) -> bool:
    """Returns whether `path` is the bare name of a scene that comes with mjrun."""
    return path.name == str(path) and (scene_folder() / f"{path}.xml").is_file()


def _models_in(folder: Path) -> tuple[list[str], str]:
    """Returns the names of the model files in `folder`, and a heading for them."""
    try:
        names = sorted(path.name for path in folder.iterdir() if path.suffix in MODELS)
    except OSError:
        names = []
    return names, f"models in {folder}"
