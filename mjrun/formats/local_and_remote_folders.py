"""Folders of results: of a file system, and of object stores, which fsspec reaches by the scheme of their URL.

Both offer what a store can do: a file appears whole in one step, may be created only where none exists, and is never
renamed. An error of a store is tried again a few times before it is raised.
"""

import errno
import os
import secrets
import stat
import tempfile
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

from mjrun.confinement.confinement import require_unconfined
from mjrun.errors import FileError, UsageError, clean, file_errors, listing, option
from mjrun.formats.input_file import exists, is_folder, opened
from mjrun.formats.output_writer import Destination, OutputWriter, StagedFile
from mjrun.formats.temporary_output import (
    NAME,
    TRIES,
    remove_left_behind,
    require_no_dangling_link,
    require_short,
    scratch_folder,
    temporary_file,
)
from mjrun.packages import require
from mjrun.platform import system
from mjrun.suffixes import URL, is_url

DELAYS = (1.0, 4.0)  # [s] before each new try; the libraries of most stores try several times themselves
LASTING = (FileNotFoundError, FileExistsError, PermissionError, NotImplementedError, ImportError, TypeError, ValueError)
UNCONDITIONAL = (errno.ENOSYS, errno.EINVAL)  # errors of a store that does not know conditional requests
EXTRA = "cloud"

T = TypeVar("T")


class LocalFolder:
    """A folder of a file system. Each method raises FileError where it fails."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def path(self, name: str = "") -> str:
        """Returns the path or the URL of the folder, or of a file in it."""
        return str(self._path / name)

    def __truediv__(self, name: str) -> "LocalFolder":
        """Returns the folder of this name in this one."""
        return LocalFolder(self._path / name)

    def create(self, *, is_cleaned: bool = True) -> None:
        """Creates the folder if it does not exist; requires that files can be created in it.

        Args:
          is_cleaned: removes what ended processes have left in it.
        """
        target = Path(os.path.realpath(self._path))
        require_short(self._path, target)
        require_no_dangling_link(self._path, target)
        with file_errors(self.path(), "made"):
            _make(self._path)
        if not os.access(self._path, os.W_OK | os.X_OK) and exists(self._path):  # or it has just been removed
            raise FileError(self.path(), "the folder is not writable")
        if is_cleaned:
            remove_left_behind(self._path)

    def remove_if_empty(self) -> None:
        """Removes the folder if it contains nothing."""
        with suppress(OSError):
            self._path.rmdir()

    def exists(self) -> bool:
        """Returns whether the folder exists."""
        return is_folder(self._path)

    def has(self, name: str) -> bool:
        """Returns whether a file exists."""
        with file_errors(self.path(name)):
            try:
                return stat.S_ISREG((self._path / name).stat().st_mode)
            except PermissionError:
                raise
            except (OSError, ValueError):  # as of a name that is too long
                return False

    def names(self, suffix: str | tuple[str, ...]) -> list[str]:
        """Returns the names of files and folders that end with `suffix`, sorted; none if the folder does not exist."""
        with file_errors(self.path()), suppress(FileNotFoundError, NotADirectoryError):
            return sorted(name for name in os.listdir(self._path) if name.endswith(suffix))  # noqa: PTH208
        return []

    def size(self, name: str) -> int:
        """Returns the size of a file [bytes]; 0 if it does not exist."""
        with file_errors(self.path(name)), suppress(FileNotFoundError):
            return (self._path / name).stat().st_size
        return 0

    def age(self, name: str) -> float:
        """Returns the time since a file was changed, by the clock of this machine [s].

        Raises:
          FileNotFoundError: it does not exist.
        """
        with file_errors(self.path(name), unless=FileNotFoundError):
            return time.time() - (self._path / name).stat().st_mtime

    def seconds_ahead(self) -> float:
        """Returns how far the clock of this machine is ahead of the clock that dates the files in the folder [s]."""
        with file_errors(self.path(), "written"), tempfile.TemporaryFile(dir=self._path) as probe:  # without a name
            return time.time() - os.fstat(probe.fileno()).st_mtime

    def open(self, name: str) -> BinaryIO:
        """Opens a file for reading at any place.

        Raises:
          FileNotFoundError: it does not exist.
        """
        with file_errors(self.path(name), unless=FileNotFoundError):
            return (self._path / name).open("rb")

    def create_file(self, name: str, content: bytes) -> None:
        """Creates a small file, which must not exist, and appears whole; also folders in this one."""
        path = self._path / name
        with file_errors(self.path(name), "written"):
            for attempt in range(TRIES):
                try:
                    _create(path, content)
                except FileNotFoundError:  # another process has just removed an inner folder, which was empty
                    if attempt == TRIES - 1 or not self.exists():
                        raise
                    _make(path.parent)
                else:
                    return

    def rewrite(self, name: str, content: bytes) -> None:
        """Replaces the content of a small file, which must exist."""
        with file_errors(self.path(name), "written"), (self._path / name).open("r+b") as stream:
            stream.write(content)
            stream.truncate()

    def remove(self, name: str) -> None:
        """Removes a file if it exists."""
        with file_errors(self.path(name), "removed"):
            (self._path / name).unlink(missing_ok=True)

    def destination(self, name: str) -> StagedFile:
        """Returns the destination of a file that is written whole."""
        return StagedFile(self._path / name)


def _make(folder: Path) -> None:
    """Creates a folder, whatever empty folders other processes remove meanwhile."""
    for attempt in range(TRIES):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except (FileNotFoundError, FileExistsError):
            if attempt == TRIES - 1 or (exists(folder) and not is_folder(folder)):
                raise
        else:
            return


def _create(path: Path, content: bytes) -> None:
    """Creates a file, which must not exist, and appears whole, in an existing folder."""
    with temporary_file(path, content, "") as whole:
        try:
            system.hard_link(whole, path)
        except OSError as error:
            if isinstance(error, FileExistsError) or os.path.lexists(path):
                raise
            whole.rename(path)  # the file system has no hard links


class RemoteFolder:
    """A folder of an object store, or of anything else that fsspec reaches.

    Args:
      url: its URL, without a slash at the end.
      delays: pauses before each new try [s].

    Raises:
      UsageError: no library reads such URLs, or this process is confined.
    """

    def __init__(self, url: str, delays: Sequence[float]) -> None:
        require_unconfined(f"{clean(url)} is not a folder of this machine")
        require(clean(url), EXTRA, "fsspec")
        import fsspec

        self._url, self._delays, (scheme, _, _) = url, delays, url.partition("://")
        try:
            # Other processes change the folder: what it contained earlier does not count.
            self._store, self._key = fsspec.url_to_fs(url, use_listings_cache=False)
        except ImportError:
            raise _missing_library(url, scheme) from None
        except ValueError as error:
            raise UsageError(f"{clean(url)}: {clean(str(error))}") from None

    def path(self, name: str = "") -> str:
        return f"{self._url}/{name}" if name else self._url

    def __truediv__(self, name: str) -> "RemoteFolder":
        return RemoteFolder(self.path(name), self._delays)

    def create(self, *, is_cleaned: bool = True) -> None:
        # Some file systems need it, object stores do not; buckets are not made.
        with suppress(Exception):
            self._store.mkdir(self._key, create_parents=False)

    def remove_if_empty(self) -> None:
        """Does nothing: in stores, such folders do not exist."""

    def exists(self) -> bool:
        with file_errors(self._url):
            return self._call(lambda: self._store.exists(self._key))

    def has(self, name: str) -> bool:
        with file_errors(self.path(name)):
            return self._call(lambda: self._store.isfile(self._place(name)))

    def names(self, suffix: str | tuple[str, ...]) -> list[str]:
        places: list[str] = []
        with file_errors(self._url), suppress(FileNotFoundError):
            places = self._call(lambda: self._store.ls(self._key, detail=False, refresh=True))
        return sorted(name for place in places if (name := place.rstrip("/").rpartition("/")[2]).endswith(suffix))

    def size(self, name: str) -> int:
        with file_errors(self.path(name)), suppress(FileNotFoundError):
            return self._call(lambda: self._store.size(self._place(name)))
        return 0

    def age(self, name: str) -> float:
        with file_errors(self.path(name), unless=FileNotFoundError):
            return time.time() - self._call(lambda: self._store.modified(self._place(name))).timestamp()

    def seconds_ahead(self) -> float:
        probe = f".{secrets.token_hex(8)}.probe"
        self.create_file(probe, b"")
        ahead = self.age(probe)
        self.remove(probe)
        return ahead

    def open(self, name: str) -> BinaryIO:
        with file_errors(self.path(name), unless=FileNotFoundError), scratch_folder() as folder:
            copy = folder / "copy"
            self._call(lambda: self._store.get_file(self._place(name), str(copy)))
            return copy.open("rb")  # which stays readable without its name

    def create_file(self, name: str, content: bytes) -> None:
        tries = 0

        def create() -> None:
            nonlocal tries
            tries += 1
            try:
                self._store.pipe_file(self._place(name), content, mode="create")
            except FileExistsError:
                if tries == 1:  # a later one finds what the first has created in spite of its error
                    raise

        with file_errors(self.path(name), "written"):
            try:
                self._call(create)
            except OSError as error:
                if error.errno not in UNCONDITIONAL or self.has(name):
                    raise
                self._call(lambda: self._store.pipe_file(self._place(name), content))

    def rewrite(self, name: str, content: bytes) -> None:
        if not self.has(name):
            raise FileError(self.path(name), "cannot be written: it is removed")
        with file_errors(self.path(name), "written"):
            self._call(lambda: self._store.pipe_file(self._place(name), content))

    def remove(self, name: str) -> None:
        with file_errors(self.path(name), "removed"), suppress(FileNotFoundError):
            self._call(lambda: self._store.rm_file(self._place(name)))

    def destination(self, name: str) -> "StagedUpload":
        return StagedUpload(self, name)

    def upload(self, file: str, name: str) -> None:
        """Writes the content of a local file as a file of the folder."""
        with file_errors(self.path(name), "written"):
            self._call(lambda: self._store.put_file(file, self._place(name)))

    def _place(self, name: str) -> str:
        return f"{self._key}/{name}"

    def _call(self, function: Callable[[], T]) -> T:
        """Calls a function of the store, again where it fails for a reason that may pass.

        Raises:
          OSError: it fails still.
        """
        for delay in (*self._delays, None):
            try:
                return function()
            except OSError as error:
                if delay is None or isinstance(error, LASTING) or error.errno in UNCONDITIONAL:
                    raise
            except Exception as error:  # of whatever library
                if delay is None or isinstance(error, LASTING) or "Credential" in type(error).__name__:
                    raise OSError(errno.EIO, f"{error or type(error).__name__}") from error
            time.sleep(delay)
        raise AssertionError


class StagedUpload(Destination):
    """A file that is written on this machine, and uploaded when it is complete."""

    def __init__(self, folder: RemoteFolder, name: str) -> None:
        self._folder, self._name, self.shown = folder, name, folder.path(name)
        self._scratch = scratch_folder()
        self.path = str(self._scratch.__enter__() / "file")

    def publish(self) -> list[Path]:
        self._folder.upload(self.path, self._name)
        return []  # which is not on this machine

    def take_back(self) -> None:
        raise OSError(errno.EOPNOTSUPP, os.strerror(errno.EOPNOTSUPP))

    def cleanup(self) -> None:
        self._scratch.__exit__(None, None, None)


Folder = LocalFolder | RemoteFolder


def folder_at(path: "str | Path | Folder", delays: Sequence[float] = DELAYS) -> Folder:
    """Returns the folder of a path or a URL.

    Args:
      delays: pauses before new tries of what fails in a store [s]; empty where an answer is wanted soon.

    Raises:
      UsageError: no library reads such URLs, or this process is confined.
    """
    if isinstance(path, Folder):
        return path
    if isinstance(path, str) and (match := URL.fullmatch(path)):
        if match[1].lower() == "file":
            return LocalFolder(Path(path.partition("://")[2]))
        return RemoteFolder(path.rstrip("/"), delays)
    return LocalFolder(Path(path))


def require_own_folder(folder: Folder, manifest: str, content: str, replaced: Collection[str] | None = None) -> None:
    """Refuses a folder in which `content` would replace files of others.

    Args:
      replaced: names of the files that it may replace; by default, the folder must not contain any other file.

    Raises:
      FileError: it has such files and no manifest, cannot be read, or is not a folder.
    """
    path = folder.path()
    if isinstance(folder, LocalFolder) and exists(path) and not is_folder(path):
        raise FileError(path, "is not a folder", f"{option('output')} names the folder of the results")
    if folder.has(manifest):
        return
    others = [name for name in folder.names("") if not NAME.fullmatch(name) and (replaced is None or name in replaced)]
    if others:
        found = "other files" if replaced is None else listing(others)
        hint = f"{option('output')} names a folder that is new, empty, or of an earlier {content}"
        raise FileError(path, f"contains {found}, but no {content}: it has no {manifest}", hint)


def destination_at(path: str | Path) -> Destination:
    """Returns the destination of a file at a path or a URL.

    Raises:
      FileError: it cannot be written.
      UsageError: no library writes to such URLs.
    """
    if not is_url(path):
        return StagedFile(Path(path))
    folder, _, name = str(path).rpartition("/")
    return folder_at(folder).destination(name)


def written_file(path: Path | str, content: bytes) -> OutputWriter:
    """Writes a file, given by its path or its URL, that is still to be published.

    Raises:
      FileError: it cannot be written.
    """
    output = OutputWriter(destination_at(path))
    with output.opening():
        output.write_file(content)
    return output


@contextmanager
def opened_at(path: str | Path, what: str, suffixes: Collection[str], hint: str = "") -> Iterator[BinaryIO]:
    """Opens the file at a path or a URL for reading, as `input_file.opened`.

    Raises:
      FileError: the file is missing or cannot be read.
      UsageError: no library reads such URLs.
    """
    if not is_url(path):
        with opened(Path(path), what, suffixes, hint) as file:
            yield file
        return
    try:
        file = open_url(str(path))
    except FileNotFoundError:
        raise FileError(path, "no such file", hint) from None
    with file:
        yield file


def open_url(url: str) -> BinaryIO:
    """Opens the file at a URL for reading at any place.

    Raises:
      FileNotFoundError: it does not exist.
      FileError: it cannot be read.
      UsageError: no library reads such URLs.
    """
    folder, _, name = url.rpartition("/")
    return folder_at(folder).open(name)


def _missing_library(url: str, scheme: str) -> UsageError:
    """Returns the error for URLs whose library is not installed."""
    from fsspec.registry import known_implementations

    known: dict[str, Any] = known_implementations.get(scheme, {})
    reason = str(known.get("err", "")).partition("\n")[0]
    return UsageError(f"{clean(url)} needs a library for {clean(scheme)}://, which is not installed\n{clean(reason)}")
