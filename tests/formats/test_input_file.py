"""Files that somebody else made."""

import os
import struct
import warnings
from pathlib import Path

import pytest

from mjrun.errors import FileError, UsageError
from mjrun.formats.input_file import decoding, opened, require_file


def test_a_regular_file_is_opened(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"content")
    require_file(tmp_path / "a.csv", "table", [".csv"])
    with opened(tmp_path / "a.csv", "table", [".csv"]) as file:
        assert file.read() == b"content"
    assert file.closed


def test_what_is_no_file_is_refused_with_one_that_is(tmp_path: Path) -> None:
    (tmp_path / "throw.csv").write_text("")
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(ValueError, match="embedded null") as null:
        (tmp_path / "\0").stat()
    for name, message in (
        ("thrwo.csv", "no such file (did you mean 'throw.csv'?)\nthe hint"),
        (".", "is a folder, not a table\nthe hint"),
        ("pipe.csv", "is not a regular file\nthe hint"),
        ("\0", f"cannot be read: {null.value}\nthe hint"),
    ):
        with pytest.raises(FileError) as caught:
            require_file(tmp_path / name, "table", [".csv"], "the hint")
        assert str(caught.value).endswith(f": {message}")
        with pytest.raises(FileError), opened(tmp_path / name, "table", [".csv"]):
            pass


def test_whatever_a_decoder_raises_is_reported_in_a_sentence() -> None:
    def decode(error: Exception) -> None:
        with decoding(Path("a.npz"), "cannot be read as .npz", "try another"):
            raise error

    with pytest.raises(FileError) as caught:
        decode(struct.error("bad\x1b size\nmore"))
    assert str(caught.value) == "a.npz: cannot be read as .npz: bad\\x1b size\ntry another"
    with pytest.raises(FileError, match=r"cannot be read as .npz: it ends early"):
        decode(EOFError())
    with pytest.raises(FileError, match=r"^a.npz: cannot be read: Input/output error$"):
        decode(OSError(5, "Input/output error"))
    for passed in (UsageError("no"), MemoryError()):
        with pytest.raises(type(passed)):
            decode(passed)


def test_warnings_of_a_decoder_are_not_shown() -> None:
    with decoding(Path("a"), "cannot be read"):
        warnings.warn("strange", UserWarning, stacklevel=1)
