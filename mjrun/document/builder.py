"""Construction of typed values from the contents of a document, with errors at their lines.

All output files of a document are inside one folder, and no two are the same.
"""

import dataclasses
import errno
import os
import sys
from collections.abc import Callable, Collection, Generator, Mapping
from contextlib import contextmanager
from dataclasses import field
from pathlib import Path, PurePosixPath
from typing import TypeVar

from mjrun.dataclass import dataclass
from mjrun.document.tree import (
    DeclaredAt,
    DocumentFault,
    DocumentPath,
    MappingNode,
    document_error,
    located_files,
    option_fault,
)
from mjrun.errors import DocumentError, DocumentProblem, UsageError, clean, option, quoted
from mjrun.model.sources import is_file
from mjrun.options.kinds import AnyKind, CameraKind, GhostKind, MujocoNameKind, ReadingContext, TextKind
from mjrun.options.number_kinds import InstantKind
from mjrun.options.option import Options, document_key, document_options, requirements_of
from mjrun.outputs.output import ReservedFiles
from mjrun.suffixes import MODELS, is_url

MODEL = document_key(
    "model",
    TextKind(),
    f"The model: a file ({', '.join(MODELS)}), relative to the folder of this document, or another source such as "
    "scene:dominos.",
    dataclasses.MISSING,
)

Values = dict[str, object]  # Python arguments, by attribute
T = TypeVar("T")


def refusal(text: str) -> str:
    """Returns why a document must not write to the path `text`, judged by the text alone; empty if it may."""
    parts = PurePosixPath(text).parts
    depths = [sum(-1 if part == ".." else 1 for part in parts[:end]) for end in range(1, len(parts) + 1)]
    if is_url(text):
        return f"a document cannot write to the URL {quoted(text)}; only {option('output')} can, on the command line"
    if text == "-":
        return "a document cannot write to standard output (-)"
    if text.startswith(("/", "~")):
        return f"{quoted(text)} is not a path inside the folder of outputs"
    if min(depths, default=0) < 0:
        return f"{quoted(text)} leaves the folder of outputs"
    return "" if depths and depths[-1] > 0 else f"{quoted(text)} is the folder of outputs itself"


def _require_no_circle(path: Path) -> None:
    """Follows the links of a path: from Python 3.13 on, `resolve` accepts links in a circle.

    Raises:
      OSError: they lead in a circle.
    """
    try:
        path.stat()
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise


class OutputFolder:
    """A folder that contains all outputs of a run: `folder`, which messages call `name`."""

    def __init__(self, folder: Path, name: str = "the folder of outputs") -> None:
        self._folder, self._name, self._taken = folder, name, ReservedFiles()

    def path(self, text: str) -> str:
        """Resolves an output path inside the folder; a folder of frames keeps its trailing slash.

        Raises:
          UsageError: it leads out of the folder, directly or by a link.
        """
        if reason := refusal(text):
            raise UsageError(reason)
        path = self._folder / text
        self._check(path)
        return f"{path}/" if text.endswith("/") else str(path)

    def reserve(self, path: str, owner: str, *, anywhere: bool = False) -> None:
        """Reserves a file for one output, which may be `anywhere`; `owner` names the option and its place.

        Raises:
          UsageError: another output has this file, or a link leads out of the folder.
        """
        if not anywhere:
            self._check(Path(path))
        self._taken.reserve(path, owner)

    def _check(self, path: Path) -> None:
        try:
            file, folder = path.resolve(), self._folder.resolve()
            _require_no_circle(path)
        except FileNotFoundError:  # the working folder has been removed
            raise
        except (OSError, RuntimeError) as error:  # links in a circle
            raise UsageError(f"{clean(str(path))} cannot be reached: {clean(str(error))}") from None
        if folder not in file.parents:
            is_named_inside = Path(os.path.abspath(self._folder)) in Path(os.path.abspath(path)).parents  # noqa: PTH100
            cause = ", by a link" if is_named_inside else ""
            raise UsageError(f"{clean(str(path))} leads out of {self._name}{cause}")


@dataclass(frozen=True)
class DocumentContext(ReadingContext):
    """The folders that resolve relative paths in a document, and the forms of its values.

    Attributes:
      inputs: the folder of input files, usually that of the document.
      outputs: the folder of output files, by default the current one.
      lexical: resolve `a/../b` to `b` regardless of links, so that a path that was made relative is restored exactly.
    """

    inputs: Path
    outputs: OutputFolder = field(default_factory=lambda: OutputFolder(Path()))
    lexical: bool = False
    problems: list[DocumentProblem] = field(default_factory=list[DocumentProblem])
    documents: list[str] = field(default_factory=list[str])

    def model(self, text: str) -> str:
        return self.input(text) if is_file(text) else text

    def output(self, path: str) -> str:
        return self.outputs.path(path)

    def input(self, path: str) -> str:
        joined = path if self.inputs == Path() else str(self.inputs / path)
        return os.path.normpath(joined) if self.lexical else joined

    def form(self, kind: AnyKind) -> AnyKind:
        if not isinstance(kind, CameraKind | GhostKind | InstantKind | MujocoNameKind):
            return kind
        from mjrun.document.camera_and_ghost_forms import form_of  # slow to import, and few documents need it

        return form_of(kind)


class DocumentValueBuilder:
    """A builder of values from the options of a document, which collects their faults.

    Args:
      tree: the document with the places of its values.
      folders: the folders that resolve its relative paths.
      declared_at: returns the options at a place.
      overriding: options of the command line, whose errors have no place in the document.
    """

    def __init__(
        self, tree: MappingNode, folders: DocumentContext, declared_at: DeclaredAt, overriding: Collection[str] = ()
    ) -> None:
        self.tree, self.folders = tree, folders
        self._declared_at, self._overriding = declared_at, overriding
        self._faults: list[DocumentFault] = []

    def raise_faults(self) -> None:
        """Raises DocumentError with all faults, if there are any."""
        if self._faults or self.folders.problems:
            raise document_error(self._faults, self.folders.problems)

    def made(self, make: Callable[[], T]) -> T:
        """Calls `make` and returns its value.

        Raises:
          DocumentError: the document is faulty; all faults are listed.
        """
        self.raise_faults()
        made = self.attempt((), make)
        self.raise_faults()
        assert made is not None
        return made

    def attempt(self, place: DocumentPath, make: Callable[[], T]) -> T | None:
        """Calls `make`; collects its error and returns None if it fails."""
        try:
            with located_files(self.tree, self.folders.input):
                return make()
        except DocumentError as error:
            self.folders.problems.extend(error.problems)
        except UsageError as error:
            if error.path and error.path[0] in self._overriding:
                raise
            self._faults.append(option_fault(self.tree, place, error, self._declared_at))
        return None


def values_of(declared: type[Options], document: Mapping[str, object]) -> Values:
    """Returns the values of a document that are options of a class."""
    attributes = (each.attribute for each in document_options(declared))
    return {attribute: document[attribute] for attribute in attributes if attribute in document}


def merged_values(
    declared: type[Options], tree: MappingNode, document: Mapping[str, object], values: Mapping[str, object]
) -> Values:
    """Returns the values of a document that are options of a class, overridden by `values` of the command line.

    An option loses its effect if its partner is overridden: `videos=0` for a document that sets the size of its videos.
    It is left out then, instead of being refused.
    """
    merged = {**values_of(declared, document), **values}
    names = {each.key: each.attribute for each in document_options(declared)}
    by_key = {key: merged[name] for key, name in names.items() if name in merged}

    def order(key: str) -> int:
        """Returns the rank of the place that sets an option: the command line is above assignments and documents."""
        if names.get(key) in values:
            return sys.maxsize
        return tree.keys[key].precedence if key in tree.keys else -1

    for each in requirements_of(declared):
        partners = (each.partner, *each.alternatives)
        if each.name in by_key and not each.is_met(by_key) and order(each.name) < max(map(order, partners)):
            del merged[names[each.name]]
    return merged


@contextmanager
def located_errors(
    tree: MappingNode, folders: DocumentContext, declared_at: DeclaredAt, overriding: Collection[str] = ()
) -> Generator[None]:
    """Converts errors about options to errors at lines of the document, and adds these to errors of its files.

    Args:
      overriding: options of the command line, whose errors have no place in the document.

    Raises:
      DocumentError: an option is invalid.
    """
    try:
        with located_files(tree, folders.input):
            yield
    except DocumentError:
        raise
    except UsageError as error:
        if not error.path or error.path[0] in overriding:
            raise
        raise document_error([option_fault(tree, (), error, declared_at)]) from error
