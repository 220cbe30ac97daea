"""Images are read as Pillow, numpy and mjrun's own writer made them."""

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import mjrun
from mjrun.errors import FileError, UnknownNameError
from mjrun.formats.image_and_video_reader import ANIMATIONS, IMAGE_SUFFIXES, read_image, read_palette, read_video
from mjrun.formats.image_encoding import encode_exr

RGB = np.random.default_rng(2).integers(0, 256, (7, 9, 3), np.uint8)
METRES = np.array([[0.5, np.inf, 1e-3], [2.0, 3.25, np.inf]], np.float32)


@pytest.mark.parametrize("suffix", [".png", ".webp", ".tiff", ".npy"])
def test_colours_come_back(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    np.save(path, RGB) if suffix == ".npy" else Image.fromarray(RGB).save(path, lossless=True)
    assert np.array_equal(read_image(path), RGB)


def test_numbers_come_back_with_their_type(tmp_path: Path) -> None:
    millimetres = np.array([[0, 1, 65535]], np.uint16)
    Image.fromarray(millimetres).save(tmp_path / "a.png")
    Image.fromarray(METRES).save(tmp_path / "a.tiff")
    np.save(tmp_path / "a.npy", np.asfortranarray(METRES))
    (tmp_path / "a.exr").write_bytes(encode_exr(METRES))
    assert np.array_equal(read_image(tmp_path / "a.png"), millimetres)
    for name in ("a.tiff", "a.npy", "a.exr"):
        assert np.array_equal(read_image(tmp_path / name), METRES)
        assert read_image(tmp_path / name).dtype == np.float32


def test_a_palette_is_read_as_colours_or_as_indices(tmp_path: Path) -> None:
    image = Image.fromarray(np.array([[0, 1, 2]], np.uint8))
    image.putpalette(bytes([0, 0, 0, 255, 0, 0, 0, 0, 255]))
    image.save(tmp_path / "a.png")
    assert read_image(tmp_path / "a.png").tolist() == [[[0, 0, 0], [255, 0, 0], [0, 0, 255]]]
    assert read_image(tmp_path / "a.png", indices=True).tolist() == [[0, 1, 2]]
    assert read_palette(tmp_path / "a.png")[:9] == bytes([0, 0, 0, 255, 0, 0, 0, 0, 255])
    Image.fromarray(RGB).save(tmp_path / "b.png")
    assert read_palette(tmp_path / "b.png") == read_palette("a.jpg") == b""


def test_translucent_colours_have_a_fourth_channel(tmp_path: Path) -> None:
    rgba = np.dstack([RGB, RGB[..., :1]])
    Image.fromarray(rgba).save(tmp_path / "a.png")
    assert np.array_equal(read_image(tmp_path / "a.png"), rgba)


@pytest.mark.parametrize("suffix", IMAGE_SUFFIXES)
def test_what_cannot_be_decoded_is_reported(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_bytes(b"\x93NUMPY\1\0 broken")
    with pytest.raises(FileError, match=f"a{suffix}: cannot be read as {suffix}: "):
        read_image(path)


def test_what_is_no_image_is_reported(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.zeros(3))
    np.save(tmp_path / "b.npy", np.array([["a"]]))
    (tmp_path / "a.xyz").write_bytes(b"")
    for name, kind, message in (
        ("a.npy", FileError, r"it has the shape \(3,\), not \(height, width\)"),
        ("b.npy", FileError, "it holds text, not numbers"),
        ("a.xyz", UnknownNameError, "no image format '.xyz'"),
        ("none.png", FileError, "none.png: no such file"),
    ):
        with pytest.raises(kind, match=message):
            read_image(tmp_path / name)


POSTSCRIPT = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n%%EndComments\nshowpage\n%%EOF\n"


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".webp", ".tiff", ".gif", ".apng"])
def test_a_file_is_read_as_its_suffix_says_and_starts_no_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str
) -> None:
    program, trace = tmp_path / "bin/gs", tmp_path / "started"
    program.parent.mkdir()
    program.write_text(f"#!/bin/sh\ntouch {trace}\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(program.parent), prepend=":")
    monkeypatch.setattr("PIL.EpsImagePlugin.gs_binary", None)
    path = tmp_path / f"a{suffix}"
    path.write_bytes(POSTSCRIPT)
    with pytest.raises(FileError, match="cannot be read as"):
        list(read_video(path)) if suffix in ANIMATIONS else read_image(path)
    assert not trace.exists()
    with pytest.raises(OSError, match="cannot identify"), Image.open(path) as image:  # by Ghostscript
        image.load()
    assert trace.exists()


def test_no_image_is_opened_by_its_content() -> None:
    calls = [
        f"{path.name}: {match[0]}"
        for path in Path(mjrun.__file__).parent.rglob("*.py")
        for match in re.finditer(r"\b(Image\.open|imread|iio\.\w+)\(.*", path.read_text())
    ]
    assert [call for call in calls if not re.search(r'formats=|plugin="FFMPEG", input_params=', call)] == []
    assert len(calls) == 2


def test_an_image_of_a_few_bytes_does_not_fill_the_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Image.fromarray(np.zeros((2000, 2000), np.uint8)).save(tmp_path / "a.png")
    assert read_image(tmp_path / "a.png").shape == (2000, 2000, 3)
    monkeypatch.setattr("mjrun.decompression_limits.FREE", 2**20)
    with pytest.raises(FileError, match=r"a\.png: would expand to 0\.016 GB in memory, [\d,]+ times its size"):
        read_image(tmp_path / "a.png")
