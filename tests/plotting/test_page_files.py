"""Files in a page, and beside it."""

import base64
from pathlib import Path
from urllib.parse import unquote

import pytest

from mjrun.errors import FileError
from mjrun.plotting.page_files import page_file


def test_a_small_image_is_in_the_page_byte_by_byte(tmp_path: Path) -> None:
    (tmp_path / "a.PNG").write_bytes(bytes(range(256)))
    file = page_file(str(tmp_path / "a.PNG"), str(tmp_path / "page.html"), limit=0.001)
    kind, _, content = file.address.removeprefix("data:").partition(";base64,")
    assert (kind, base64.b64decode(content)) == ("image/png", bytes(range(256)))
    assert file.is_embedded


@pytest.mark.parametrize("name", ["film.mp4", "a film, 100% #1?.webm", "<b>.gif", "ü.png"])
def test_what_is_larger_is_linked_from_where_the_page_is(name: str, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / name).write_bytes(bytes(1001))
    file = page_file(str(tmp_path / name), str(tmp_path / "out" / "page.html"), limit=0.001)
    assert not file.is_embedded
    assert file.address.isascii()
    assert not set(file.address) & set(' #?<>"')
    assert (tmp_path / "out" / unquote(file.address)).resolve() == (tmp_path / name).resolve()


def test_what_no_browser_shows_is_linked(tmp_path: Path) -> None:
    (tmp_path / "run.npz").write_bytes(b"x")
    (tmp_path / "frames.png").mkdir()
    files = [page_file(str(tmp_path / name), str(tmp_path / "p.html"), 10) for name in ("run.npz", "frames.png")]
    assert [(file.kind, file.address, file.size) for file in files] == [
        (None, "./run.npz", 1),
        (None, "./frames.png", None),
    ]


def test_a_file_that_is_missing_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"none\.png"):
        page_file(str(tmp_path / "none.png"), "p.html", 10)
