"""Outputs that appear whole, or not.

After any failure, kill or full disk the target is the old output or the new one, never a mixture.
"""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO, Self, TypeVar

from mjrun.errors import ClosedPipeError, MjrunError, PartlyDoneError, file_errors
from mjrun.formats.destinations import Destination
from mjrun.formats.folders import destination_at
from mjrun.formats.temporary_output import one_at_a_time
from mjrun.interruption import uninterrupted
from mjrun.shared_status import completing

T = TypeVar("T", bound=Any)


class OutputWriter:
    """Base of all writers: a context manager that leaves nothing behind unless the output was published.

    Creating the destination checks that the output can be written.

    Attributes:
      resources: open files and processes, closed with the writer, last opened first; the destination is discarded last.
    """

    def __init__(self, destination: Destination) -> None:
        self.destination = destination
        self.resources = contextlib.ExitStack()
        self.resources.callback(destination.discard)
        self._is_finished = False

    def finish(self) -> None:
        """Completes, verifies and syncs the output, which then only has to be moved; does nothing the second time.

        All outputs of a pass are finished before any of them is published.

        Raises:
          FileError: the output cannot be written.
          EncoderError: the encoder failed, or frames are missing.
          ClosedPipeError: the reader of standard output closed the pipe.
        """
        if not self._is_finished:
            self.complete()
            with file_errors(self.destination.shown, "written"):
                self.destination.sync()
            self._is_finished = True

    def complete(self) -> None:
        """Writes the end of the output and verifies it; for subclasses, called once by `finish`."""

    def publish(self) -> list[Path]:
        """Finishes the output, moves it to its final place, and returns its files.

        Raises:
          MjrunError: as `finish`, or the output cannot be moved.
        """
        return publish_together([self])

    @property
    def together(self) -> Sequence["OutputWriter"]:
        """The writers of all files that are published with this one."""
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


def publish_together(writers: Sequence[OutputWriter]) -> list[Path]:
    """Finishes outputs, moves them to their places, and returns their files.

    Raises:
      MjrunError: as `OutputWriter.finish` and `move_together`.
    """
    for part in (part for writer in writers for part in writer.together):
        part.finish()
    with publishing(writers):
        return move_together(writers)


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


def move_together(
    writers: Sequence[OutputWriter], last: Callable[[Sequence[Path]], OutputWriter] | None = None
) -> list[Path]:
    """Moves finished outputs to their places, all of them or none, and returns their files; used in `publishing`.

    Args:
      last: writes a file about these files, once they are in their places, and returns its writer, which is published
        with them. Its own file is not among those returned.

    Raises:
      PartlyDoneError: an output cannot be moved, and another could not be restored.
      MjrunError: an output cannot be moved.
    """
    destinations = [part.destination for writer in writers for part in writer.together]
    files: list[Path] = []
    published: list[Destination] = []
    failed = destinations[0].shown if destinations else Path()
    try:
        for destination in destinations:
            failed = destination.shown
            files += destination.publish()
            published.append(destination)
        if last:
            writer = last(files)
            failed = writer.destination.shown
            writer.finish()
            writer.destination.publish()
            published.append(writer.destination)
    except BaseException as error:
        remaining = [str(each.shown) for each in reversed(published) if not _is_taken_back(each)]
        if remaining and isinstance(error, MjrunError):
            raise PartlyDoneError(remaining, [(str(failed), error)]) from None
        raise
    for destination in published:
        destination.discard()  # the older output
    return files


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
