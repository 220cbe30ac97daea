"""Outputs that appear whole, or not.

After any failure, kill or full disk the target is the old output or the new one, never a mixture.
"""

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO, Self, TypeVar

from mjrun.errors import ClosedPipeError, FileError, MjrunError, PartlyDoneError, file_errors
from mjrun.formats.destinations import Destination
from mjrun.formats.input_file import is_file
from mjrun.formats.local_and_remote_folders import destination_at
from mjrun.formats.temporary_output import one_at_a_time
from mjrun.interruption import uninterrupted
from mjrun.shared_status import completing

T = TypeVar("T", bound=Any)


class OutputWriter:
    """Base of all writers: a context manager that leaves nothing behind unless the output was published.

    Creating the destination checks that the output can be written.

    Attributes:
      resources: open files and processes, closed with the writer, last opened first; then the destination cleans up.
    """

    def __init__(self, destination: Destination) -> None:
        self.destination = destination
        self.resources = contextlib.ExitStack()
        self.resources.callback(destination.cleanup)

    def finish(self) -> None:
        """Syncs the output, which then only has to be moved; called once. Writers first write its end and verify it.

        All outputs of a pass are finished before any of them is published.

        Raises:
          FileError: the output cannot be written.
          EncoderError: the encoder failed, or frames are missing.
          ClosedPipeError: the reader of standard output closed the pipe.
        """
        with file_errors(self.destination.shown, "written"):
            self.destination.sync()

    def publish(self) -> list[Path]:
        """Finishes the output, moves it to its final place, and returns its files.

        Raises:
          MjrunError: as `finish`, or the output cannot be moved.
        """
        return publish_together([self])

    @property
    def together(self) -> Sequence["OutputWriter"]:
        """The writers of all files that are finished and published with this one."""
        return [self]

    def close(self) -> None:
        """Closes open resources, and removes output that was not published."""
        self.resources.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextlib.contextmanager
    def opening(self) -> Iterator[None]:
        """Wraps the rest of a constructor: a failure closes and removes everything."""
        try:
            with self.writing():
                yield
        except BaseException:
            self.close()
            raise

    @contextlib.contextmanager
    def writing(self) -> Iterator[None]:
        """Turns errors of the operating system into those of mjrun."""
        try:
            with file_errors(self.destination.shown, "written", unless=BrokenPipeError):
                yield
        except BrokenPipeError:
            raise ClosedPipeError from None

    def open_file(self) -> BinaryIO:
        """Opens the file to write to, which is closed with the writer."""
        stdout = self.destination.stdout
        file = open(self.destination.path if stdout is None else stdout, "wb", closefd=stdout is None)  # noqa: SIM115
        self.resources.enter_context(closing_quietly(file))
        return file

    def write_file(self, content: bytes) -> None:
        """Writes the whole output at once."""
        with self.writing(), self.open_file() as file:
            file.write(content)


def written_file(path: Path | str, content: bytes) -> OutputWriter:
    """Writes a file, given by its path or its URL, that is still to be published.

    Raises:
      FileError: it cannot be written.
    """
    output = OutputWriter(destination_at(path))
    with output.opening():
        output.write_file(content)
    return output


def require_own(path: Path, mark: str, kind: str) -> None:
    """Refuses to replace a file of another kind, which was named by mistake.

    Args:
      mark: text that every file of this kind contains.
      kind: the kind in messages: "a baseline of mjrun check".

    Raises:
      FileError: the file has content, and not the mark.
    """
    with contextlib.suppress(OSError):  # which writing it reports
        if is_file(path) and (content := path.read_bytes()) and mark.encode() not in content:
            raise FileError(path, f"is not {kind}, and is not replaced", "choose another name, or remove the file")


def publish_together(writers: Sequence[OutputWriter]) -> list[Path]:
    """Finishes outputs, moves them to their places, and returns their files.

    Raises:
      MjrunError: as `OutputWriter.finish` and `PublishingTransaction`.
    """
    for writer in writers:
        writer.finish()
    with publishing(writers), PublishingTransaction() as together:
        return [file for writer in writers for file in together.move(writer)]


@contextlib.contextmanager
def publishing(writers: Sequence[OutputWriter]) -> Iterator[None]:
    """Moves finished outputs to their places in the `with` block.

    Signals wait for its end, and other processes do not publish in the folders of these outputs meanwhile.
    """
    folders = {part.destination.folder for writer in writers for part in writer.together}
    with contextlib.ExitStack() as locks:
        for folder in sorted(filter(None, folders)):  # in one order, for all processes
            locks.enter_context(one_at_a_time(folder))
        with uninterrupted(), completing():
            yield


class PublishingTransaction:
    """A context manager in which outputs move to their places, all of them or none; used in `publishing`.

    Raises:
      PartlyDoneError: the `with` block fails, and an output that was moved cannot be replaced by the older one.
    """

    def __init__(self) -> None:
        self._moved: list[Destination] = []
        self._last = Path()

    def __enter__(self) -> Self:
        return self

    def move(self, writer: OutputWriter) -> list[Path]:
        """Moves a finished output to its place, and returns its files.

        Raises:
          MjrunError: the output cannot be moved.
        """
        files: list[Path] = []
        for part in writer.together:
            self._last = part.destination.shown
            files += part.destination.publish()
            self._moved.append(part.destination)
        return files

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        if error is None:
            for destination in self._moved:
                destination.cleanup()  # removes the older output
            return
        remaining = [str(each.shown) for each in reversed(self._moved) if not _is_taken_back(each)]
        if remaining and isinstance(error, MjrunError):
            raise PartlyDoneError(remaining, [(str(self._last), error)]) from None


def _is_taken_back(destination: Destination) -> bool:
    try:
        destination.take_back()
    except OSError:
        return False
    return True


@contextlib.contextmanager
def closing_quietly(file: T) -> Iterator[T]:
    """Closes a file at the end, even if the rest of its buffer cannot be written."""
    try:
        yield file
    finally:
        with contextlib.suppress(OSError, ValueError):
            file.close()
