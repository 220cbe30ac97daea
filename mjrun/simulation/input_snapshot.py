"""Snapshots of input files: copies that simulations read, so that later edits change no result."""

import hashlib
import io
import os
import shutil
import weakref
from collections.abc import Generator, Iterable, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import field, replace
from functools import lru_cache
from itertools import chain, repeat
from pathlib import Path
from typing import BinaryIO, Self

from mjrun.confinement.confinement import is_readable
from mjrun.dataclass import dataclass
from mjrun.errors import FileError, MjrunError, ModelNotFoundError
from mjrun.formats.input_file import is_file
from mjrun.formats.temporary_output import scratch_folder, temporary_file_errors
from mjrun.model.model_files import redirected
from mjrun.model.xml_source import content_digest
from mjrun.platform.mirrored_paths import mirrored, with_original_paths
from mjrun.suffixes import XML

PIECE = 2**20  # bytes copied at a time
STREAMS = ("/dev/stdin", "/dev/fd/")  # of this process, which can be read only once
ORIGINALS = ".originals"  # folder of the models whose copies have other paths in them, by digest


@dataclass(frozen=True)
class InputSnapshot:
    """Copies of files in a temporary folder, which mirrors their absolute paths; a picklable value.

    The folder exists as long as the original snapshot, or a snapshot derived from it in the same process. In another
    process, `root` may have to be replaced.

    Attributes:
      root: folder of the copies.
      digests: SHA-256 of each original file, by absolute path.
      cwd: working directory, to which relative paths refer.
      folders: absolute folders of the files as models spell them, which may contain `..`.
    """

    root: Path = field(compare=False)
    digests: Mapping[str, str] = field(default_factory=dict[str, str])
    cwd: str = ""
    folders: frozenset[str] = frozenset()
    _owner: object = field(default=None, compare=False, repr=False)

    @classmethod
    def empty(cls) -> Self:
        """Returns a snapshot without files, in a new folder.

        Raises:
          FileError: the folder cannot be created.
        """
        stack = ExitStack()
        root = stack.enter_context(scratch_folder())
        owner = _KeepAlive()
        weakref.finalize(owner, stack.close)
        return cls(root, {}, os.getcwd(), frozenset(), owner)  # noqa: PTH109

    def with_files(self, files: Iterable[Path], *, of_models: Iterable[Path] = ()) -> Self:
        """Returns a snapshot that also contains these files.

        Missing files are left out: reading their copies fails. So are those that a confined process must not read.

        Args:
          of_models: files of models, too.

        Raises:
          ModelNotFoundError: a file of a model cannot be read.
          FileError: another file cannot be read, or a file cannot be copied.
        """
        digests, folders = dict(self.digests), set(self.folders)
        for path, is_of_model in chain(zip(files, repeat(False)), zip(of_models, repeat(True))):
            absolute = _absolute(path, self.cwd)
            if absolute in digests or self._holds(absolute) or absolute.startswith(STREAMS) or not is_file(path):
                continue
            if not is_readable(path):  # and reading it fails with the reason
                continue
            folder = os.path.dirname(os.path.join(self.cwd, path))  # noqa: PTH118, PTH120 – pathlib resolves nothing
            try:
                file = Path(path).open("rb")  # noqa: SIM115 – errors of copying are others
            except OSError as error:
                reason = error.strerror or str(error)
                if is_of_model:
                    raise ModelNotFoundError(path, reason) from None
                raise FileError(path, f"cannot be read: {reason}") from None
            with file:
                digests[absolute] = self._write(absolute, file, folder)
            folders.add(folder)
        return replace(self, digests=digests, folders=frozenset(folders))

    def copied_from(self, contents: Mapping[str, bytes]) -> Self:
        """Returns the same snapshot in a new folder, written from the `contents` of its files.

        Raises:
          FileError: the folder cannot be created, or a content does not match the hash of its file.
        """
        copy = replace(self.empty(), digests=self.digests, cwd=self.cwd, folders=self.folders)
        for path, digest in self.digests.items():
            content = contents.get(path, b"")
            if hashlib.sha256(content).hexdigest() != digest:
                raise FileError(path, "its copy is damaged")
            copy._write(path, io.BytesIO(content), os.path.dirname(path))  # noqa: PTH120
        for folder in self.folders:
            copy._make_folder(folder)
        return copy

    def place(self, path: str | Path) -> Path:
        """Returns the path of the copy of a file or folder, whether or not it is part of the snapshot.

        A file that a confined process must not read stays at its own.
        """
        absolute = _absolute(path, self.cwd)
        is_original = self._holds(absolute) or not is_readable(absolute)
        return Path(absolute) if is_original else self._copy(absolute)

    def digest(self, path: str | Path) -> str:
        """Returns the SHA-256 of an original file; empty if it is not part of the snapshot."""
        return self.digests.get(_absolute(path, self.cwd), "")

    def content_digest(self, path: str | Path) -> str:
        """Returns the SHA-256 of what MuJoCo reads in an original file: not of the comments of a model."""
        absolute, digest = _absolute(path, self.cwd), self.digest(path)
        is_xml = digest and Path(absolute).suffix in XML
        return _content_digest(self._original(absolute, digest), digest) if is_xml else digest

    @property
    def fingerprint(self) -> str:
        """SHA-256 of all paths and contents."""
        listing = "".join(f"{path}\0{self.digests[path]}\0" for path in sorted(self.digests))
        return hashlib.sha256(f"{self.cwd}\0{listing}".encode("utf-8", "surrogateescape")).hexdigest()

    def contents(self) -> dict[str, bytes]:
        """Returns the original contents of all files, by their absolute paths."""
        return {path: self._original(path, digest).read_bytes() for path, digest in self.digests.items()}

    def with_original_names(self, text: str) -> str:
        """Returns a message with the copies' paths replaced by the paths of their originals."""
        return with_original_paths(text, self.root, Path(self.cwd))

    @contextmanager
    def original_names_in_errors(self) -> Generator[None]:
        """Makes errors in a `with` block name the original files."""
        try:
            yield
        except MjrunError as error:
            error.args = tuple(self._renamed(value) for value in error.args)
            vars(error).update({name: self._renamed(value) for name, value in vars(error).items()})
            raise

    def __getstate__(self) -> dict[str, object]:
        return {**vars(self), "_owner": None}

    def _renamed(self, value: object) -> object:
        if isinstance(value, str):
            return self.with_original_names(value)
        return Path(self.with_original_names(str(value))) if isinstance(value, Path) else value

    def _holds(self, absolute: str) -> bool:
        return Path(absolute).is_relative_to(self.root)

    def _copy(self, absolute: str) -> Path:
        return mirrored(self.root, Path(absolute))

    def _write(self, absolute: str, file: BinaryIO, folder: str) -> str:
        """Writes a copy, and returns the hash of its original; only models are read whole."""
        copy = self._copy(absolute)
        self._make_folder(folder)
        with temporary_file_errors():
            copy.parent.mkdir(parents=True, exist_ok=True)
            with copy.open("w+b") as target:
                shutil.copyfileobj(file, target, PIECE)
                target.seek(0)
                digest = hashlib.file_digest(target, "sha256").hexdigest()
            if new := redirected(copy, self.place):
                (self.root / ORIGINALS).mkdir(exist_ok=True)
                copy.replace(self.root / ORIGINALS / digest)
                copy.write_bytes(new)
            return digest

    def _make_folder(self, folder: str) -> None:
        """Creates a folder with every part of its path, since MuJoCo opens `a/../b` only where `a` exists."""
        with temporary_file_errors():
            os.makedirs(self._copy(folder), exist_ok=True)  # noqa: PTH103

    def _original(self, path: str, digest: str) -> Path:
        """Returns the file with the unchanged content of an original."""
        original = self.root / ORIGINALS / digest
        return original if original.exists() else self._copy(path)


class _KeepAlive:
    """A token that keeps the folder of a snapshot while the snapshot, or one derived from it, is in use."""


@lru_cache(1024)
def _content_digest(original: Path, digest: str) -> str:
    """Returns the `content_digest` of the model at `original`, whose SHA-256 is `digest`."""
    return content_digest(original.read_bytes())


def _absolute(path: str | Path, cwd: str) -> str:
    return os.path.normpath(os.path.join(cwd, path))  # noqa: PTH118
