"""Model files as sources: MJCF, URDF, archives of these, and compiled models.

Hazards in their text that would crash MuJoCo or keep it busy forever are found before MuJoCo reads it, which reads
attached models recursively: a circle overflows the stack, and the time for a chain grows with the cube of its length.
"""

import errno
import os
import shlex
import stat
import zipfile
from abc import abstractmethod
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from mjrun.confinement.confinement import OUTSIDE, advice, confinement, is_readable
from mjrun.dataclass import dataclass
from mjrun.decompression_limits import HINT, excess
from mjrun.errors import BrokenModelError, CompiledOverrideError, ModelNotFoundError, clean, option, quoted
from mjrun.model import model_files
from mjrun.model.model_files import (
    existing_files,
    file_content,
    first_existing,
    foreign_file,
    main_mjcf,
    require_regular_files,
)
from mjrun.model.mujoco_globals import drop_outdated_assets, refuse_python_callbacks, without_log
from mjrun.model.override import Override
from mjrun.model.source import (
    FAULTS,
    CollectionModelSource,
    ModelSource,
    broken_model,
    check_model,
    compile_spec,
    load_respecting_confinement,
    model_errors,
)
from mjrun.model.xml_source import scan, with_slashes
from mjrun.platform.installation import scene_folder
from mjrun.shared_status import doing
from mjrun.suffixes import ARCHIVES, COMPILED, MODELS, MOTIONS, is_yaml

# A stack of 8 MiB overflows at about 2,500 includes, and below 2,000 models; a hundred models take a second.
MOST_INCLUDES = 500
MOST_MODELS = 100
MOST_KEYFRAMES = 20_000  # allocated by nkey: MuJoCo compares the name of each with all others
MOST_POINTS = 32_000  # of a flexcomp: MuJoCo compares each with all others
MOST_LINKS = 1000  # in a chain of a URDF: MuJoCo compares all joints; 2,000 links take 15 s, 3,000 a minute
MOST_COPIES = 1_000_000  # made by <replicate>: more take MuJoCo minutes and gigabytes
LARGEST = 10**15  # larger counts are as excessive, and cannot always be written
NESTED = (b"<include", b"<model", b"nkey", b"<flexcomp", b"<replicate")


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
        return load_respecting_confinement(self._compile)

    def _compile(self) -> tuple[mujoco.MjSpec | None, mujoco.MjModel]:
        self._check_file()
        if self.path.suffix in COMPILED:
            return None, self._load_compiled()
        name = Path(self.text)
        advice = f"mjrun check {clean(shlex.quote(self.text))} shows the place and a remedy"
        with model_errors(name, advice):
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
        is_scene = path.name == str(path) and (scene_folder() / f"{path}.xml").is_file()
        meant = [f"scene:{path}"] if is_scene else []
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
        refuse_python_callbacks()
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


def _models_in(folder: Path) -> tuple[list[str], str]:
    """Returns the names of the model files in `folder`, and a heading for them."""
    try:
        names = sorted(path.name for path in folder.iterdir() if path.suffix in MODELS)
    except OSError:
        names = []
    return names, f"models in {folder}"


class _Tag(NamedTuple):
    """An element in line `line` of the file `file`."""

    tag: str
    attributes: dict[str, str]
    file: str
    line: int
    copies: int  # of its content, made by this and the surrounding <replicate> elements


class _Model(NamedTuple):
    """A model in a chain of attached models, with its <model> elements that are still to be followed."""

    path: str
    real: str
    attached: Iterator[_Tag]


def require_finite_nesting(path: Path, main: str, text: bytes | None) -> None:
    """Checks that models do not attach each other in a circle or too deeply, and that no count is excessive.

    Args:
      path: the name of the model in errors.
      main: the file with its `text`; a path within an archive if the model is one.

    Raises:
      BrokenModelError: a check fails.
    """
    if text is not None and path.suffix == ".urdf":
        _check_links(path, text)
    if text is None or not any(word in text for word in NESTED):
        return
    known = {os.path.realpath(main)}
    waiting = [_Model(main, os.path.realpath(main), _attached(main, text))]
    while waiting:
        tag = next(waiting[-1].attached, None)
        if tag is None:
            waiting.pop()
            continue
        inner = _attached_file(tag, waiting[-1].path)
        if inner is None:
            continue
        real = os.path.realpath(inner)
        if real in [model.real for model in waiting]:
            what = f"attaches {quoted(tag.attributes['file'])}, which is or attaches this model again"
            raise _broken(tag, f"{what}: MuJoCo would never finish", "remove one of the <model> elements")
        if len(waiting) >= MOST_MODELS:
            what = f"attaches a model at nesting level {len(waiting) + 1}; the limit is {MOST_MODELS}"
            raise _broken(tag, what, "attach the models side by side, or write them into fewer files")
        if real not in known and (content := file_content(inner)) is not None:
            known.add(real)
            waiting.append(_Model(inner, real, _attached(inner, content)))


def _attached(main: str, text: bytes) -> Iterator[_Tag]:
    """Yields the `<model>` elements of a model and of its includes, whose counts it checks."""
    files, included = [(main, text, 1)], {os.path.realpath(main)}
    while files:
        path, content, depth = files.pop()
        for tag in _tags(path, content):
            if tag.tag == "model":
                yield tag
            elif tag.tag == "include":
                place = _file_of(tag, main)
                if place is None or os.path.realpath(place) in included:  # MuJoCo reports the circle
                    continue
                if depth >= MOST_INCLUDES:
                    what = f"is included at nesting level {depth}; the limit is {MOST_INCLUDES}"
                    raise _broken(tag, f"{quoted(tag.attributes['file'])} {what}", "include the files side by side")
                included.add(os.path.realpath(place))
                if (inner := file_content(place)) is not None:
                    files.append((place, inner, depth + 1))
            else:
                _check_counts(tag)


def _check_links(path: Path, text: bytes) -> None:
    """Checks the length of the chains of links in a URDF."""
    parents, ends = dict[str, str](), dict[str, str]()

    def start(tag: str, attributes: dict[str, str], line: int) -> None:
        if tag == "joint":
            ends.clear()
        elif tag in ("parent", "child"):
            ends[tag] = attributes.get("link", "")
            if len(ends) == 2:
                parents[ends["child"]] = ends["parent"]

    scan(text, start)
    for link in parents.keys() - set(parents.values()):  # the last of each chain
        length, above = 1, link
        while (above := parents.get(above, "")) and length <= MOST_LINKS:
            length += 1
        if length > MOST_LINKS:
            message = f"more than {MOST_LINKS} links form a chain to {quoted(link)}, which takes MuJoCo minutes"
            raise BrokenModelError(path, message, hint="merge links that are fixed to each other, or convert to MJCF")


def _check_counts(tag: _Tag) -> None:
    if tag.tag == "size" and _whole(tag.attributes.get("nkey", "")) > MOST_KEYFRAMES:
        what = f"nkey allocates {tag.attributes['nkey']} keyframes; MuJoCo needs hours for more than {MOST_KEYFRAMES}"
        raise _broken(tag, what, "omit nkey: by default it is the number of keyframes in the model")
    if tag.tag == "replicate" and tag.copies > MOST_COPIES:
        what = f"replicate makes {tag.copies:.3g} copies; MuJoCo needs hours and too much memory"
        raise _broken(tag, f"{what} for more than {MOST_COPIES}", "lower its count")
    if tag.tag == "flexcomp":
        points = 1
        for count in tag.attributes.get("count", "").split():
            points = min(points * max(1, _whole(count)), LARGEST)
        if points > MOST_POINTS:
            what = f"flexcomp has {points} points; MuJoCo needs hours for more than {MOST_POINTS}"
            raise _broken(tag, what, "lower its count")


def _whole(text: str) -> int:
    try:
        return min(int(float(text)), LARGEST)
    except (ValueError, OverflowError):
        return 0


def _tags(path: str, content: bytes) -> list[_Tag]:
    """Returns the elements of interest in a file; those before the fault if it is not well-formed."""
    tags, copies = list[_Tag](), [1]

    def start(tag: str, attributes: dict[str, str], line: int) -> None:
        if tag == "replicate":
            copies.append(copies[-1] * max(1, _whole(attributes.get("count", ""))))
        if (tag in ("include", "model") and attributes.get("file")) or tag in ("size", "flexcomp", "replicate"):
            tags.append(_Tag(tag, attributes, path, line, copies[-1]))

    def end(tag: str) -> None:
        if tag == "replicate":
            copies.pop()

    scan(content, start, end)
    return tags


def _file_of(tag: _Tag, model: str) -> str | None:
    """Returns the file of an `<include>` or `<model>`, beside the model or beside the file with the element."""
    folders = (os.path.dirname(base) for base in (model, tag.file))  # noqa: PTH120
    return first_existing(os.path.join(folder, with_slashes(tag.attributes["file"])) for folder in folders)  # noqa: PTH118


def _attached_file(tag: _Tag, model: str) -> str | None:
    """Returns the file of a `<model>` element, and the main member of an archive; None if it does not exist."""
    place = _file_of(tag, model)
    if place and place.endswith(ARCHIVES):
        return main_mjcf(Path(place))
    return place


def _broken(tag: _Tag, message: str, hint: str) -> BrokenModelError:
    return BrokenModelError(Path(tag.file), message, tag.line, hint)
