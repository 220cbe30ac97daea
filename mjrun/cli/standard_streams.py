"""Standard output that fails with mjrun's errors, and standard error that never ends a command."""

import errno
import io
import os
import sys
from typing import Any, TextIO

from mjrun.platform import system

STDIN, STDOUT, STDERR = 0, 1, 2

# Modes for opening streams that the caller closed, so that no file opened later takes their place and receives output
# for the user. Input is opened for writing and output for reading: using them is an error.
MODES = {STDIN: os.O_WRONLY, STDOUT: os.O_RDONLY, STDERR: os.O_WRONLY}


class PayloadStream(io.FileIO):
    """A raw stream for the payload.

    Raises:
      FileError: the stream cannot be written.
      ClosedPipeError: the reader is gone.
    """

    def write(self, data: Any, /) -> int | None:
        try:
            return super().write(data)
        except OSError as error:
            from mjrun.errors import ClosedPipeError, FileError  # not before the command forks

            _write_nowhere(self.fileno())  # Python would complain once more when it exits
            if isinstance(error, BrokenPipeError):
                raise ClosedPipeError from None
            reason = "it is closed" if error.errno == errno.EBADF else error.strerror or error
            raise FileError("standard output", f"cannot be written: {reason}") from None


class _MessageStream(io.FileIO):
    """A raw stream for messages, which are dropped if they cannot be written."""

    def write(self, data: Any, /) -> int | None:
        try:
            return super().write(data)
        except OSError:
            _write_nowhere(self.fileno())
            return len(memoryview(data))


def open_standard_streams() -> None:
    """Opens the standard streams that the caller closed, and makes writing to them raise mjrun's errors."""
    for number, mode in MODES.items():
        if _is_closed(number):
            os.set_inheritable(os.open(os.devnull, mode), True)  # the lowest that is free, which is `number`
    system.show_utf8()
    sys.stdout = text_stream(PayloadStream(STDOUT, "w", closefd=False))
    sys.stderr = text_stream(_MessageStream(STDERR, "w", closefd=False), line_buffering=True)


def text_stream(raw: io.FileIO, *, line_buffering: bool = False) -> TextIO:
    """Returns a UTF-8 stream on `raw`; file names that are not UTF-8 are written unchanged."""
    return io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding="utf-8",
        errors="surrogateescape" if isinstance(raw, PayloadStream) else "backslashreplace",
        newline="\n",
        line_buffering=line_buffering or raw.isatty(),
    )


def _is_closed(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:
        return True
    return False


def _write_nowhere(number: int) -> None:
    """Discards all further output to a file descriptor."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, number, inheritable=number <= STDERR)
    os.close(nowhere)
