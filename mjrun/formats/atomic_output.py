"""Outputs that appear whole or not at all.

After any failure, kill or full disk there is the old output or the new one, never a mixture.
"""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import BinaryIO

from mjrun.closable import Closable
from mjrun.errors import ClosedPipeError, MjrunError, PartlyDoneError
from mjrun.formats.destinations import Destination, StagedFile, unwritable
from mjrun.formats.temporary_output import one_at_a_time
from mjrun.interruption import uninterrupted
from mjrun.shared_status import completing


class OutputWriter(Closable):
    """Base of all writers: a context manager that leaves nothing behind unless the output was published.

    Creating the destination proves that the output can be written.

    Attributes:
      resources: closed when the writer is, last opened first; the destination is discarded last.
    """

    def __init__(self, destination: Destination) -> None:
        self.destination = destination
        self.resources = contextlib.ExitStack()
        self.resources.callback(destination.discard)
        self._is_finished = False

    def finish(self) -> None:
        """Completes and verifies the output, which then only has to be moved; does nothing the second time.

        All outputs of a pass are finished before any of them is published.

        Raises:
          FileError: the output cannot be written.
          EncoderError: the encoder failed, or frames are missing.
          ClosedPipeError: nobody reads standard output any more.
        """
        if not self._is_finished:
            self.complete()
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
        """Closes what is open, and removes what was not published."""
        self.resources.close()

    @contextlib.contextmanager
    def opening(self) -> Iterator[None]:
        """Wraps the rest of a constructor: if it fails, everything is closed and removed."""
        try:
            with self.writing():
                yield
        except BaseException:
            self.close()
            raise

    @contextlib.contextmanager
    def writing(self) -> Iterator[None]:
        """Turns what the operating system raises into the errors of mjrun."""
        try:
            yield
        except BrokenPipeError:
            raise ClosedPipeError from None
        except OSError as error:
            raise unwritable(self.destination.shown, error) from None

    def open_file(self) -> BinaryIO:
        """The file to write to, closed with the writer."""
        stdout = self.destination.stdout
        file = open(self.destination.path if stdout is None else stdout, "wb", closefd=stdout is None)  # noqa: SIM115
        self.resources.callback(_close_quietly, file)
        return file

    def write_file(self, content: bytes) -> None:
        """Writes all of the output at once."""
        with self.writing(), self.open_file() as file:
            file.write(content)


def written_file(path: Path, content: bytes) -> OutputWriter:
    """A file with its content, still to be published.

    Raises:
      FileError: it cannot be written.
    """
    output = OutputWriter(StagedFile(path))
    with output.opening():
        output.write_file(content)
    return output


def publish_together(
    writers: Sequence[OutputWriter], last: Callable[[Sequence[Path]], OutputWriter] | None = None
) -> list[Path]:
    """Publishes outputs that belong together, and returns their files.

    All are finished and on the disk before the first is moved to its place. If one of them cannot be moved, those that
    were moved are taken back.

    Args:
      last: writes what tells of these files, once they are in their places, and returns its writer, to be published
        with them. Its own file is not among those returned.

    Raises:
      PartlyDoneError: an output cannot be moved, and another could not be taken back.
      MjrunError: as `OutputWriter.finish`, or an output cannot be moved.
    """
    writers = [part for writer in writers for part in writer.together]
    for writer in writers:
        writer.finish()
    destinations = [writer.destination for writer in writers]
    for destination in destinations:
        _sync(destination)

    with nobody_else_publishes(writers), uninterrupted(), completing():
        return _move(destinations, last)


@contextlib.contextmanager
def nobody_else_publishes(writers: Sequence[OutputWriter]) -> Iterator[None]:
    """Within the `with` block, no other process publishes in the folders of these outputs."""
    folders = {part.destination.folder for writer in writers for part in writer.together}
    with contextlib.ExitStack() as locks:
        for folder in sorted(filter(None, folders)):  # in one order, for all processes
            locks.enter_context(one_at_a_time(folder))
        yield


def _move(destinations: Sequence[Destination], last: "Callable[[list[Path]], OutputWriter] | None") -> list[Path]:
    """Moves what is finished to its place, all of it or nothing."""
    files, published = list[Path](), list[Destination]()
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
            _sync(writer.destination)
            writer.destination.publish()
            published.append(writer.destination)
    except BaseException as error:
        remaining = [str(each.shown) for each in reversed(published) if not _is_taken_back(each)]
        if remaining and isinstance(error, MjrunError):
            raise PartlyDoneError(remaining, [(str(failed), error)]) from None
        raise
    for destination in published:
        destination.discard()  # what was there before
    return files


def _sync(destination: Destination) -> None:
    try:
        destination.sync()
    except OSError as error:
        raise unwritable(destination.shown, error) from None


def _is_taken_back(destination: Destination) -> bool:
    try:
        destination.take_back()
    except OSError:
        return False
    return True


def _close_quietly(file: BinaryIO) -> None:
    """Closes `file`, whether or not what is still buffered can be written."""
    with contextlib.suppress(OSError):
        file.close()
