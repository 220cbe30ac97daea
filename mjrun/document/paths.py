"""Resolution of the paths in a document; all output files are inside one folder, and no two are the same."""

import errno
import os
from dataclasses import field
from pathlib import Path, PurePosixPath

from mjrun.dataclass import dataclass
from mjrun.errors import DocumentProblem, UsageError, clean, option, quoted
from mjrun.model.sources import is_file
from mjrun.options.kinds import AnyKind, CameraKind, GhostKind, MujocoNameKind, ReadingContext
from mjrun.options.number_kinds import InstantKind
from mjrun.outputs.output import ReservedFiles
from mjrun.suffixes import is_url


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
