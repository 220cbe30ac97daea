"""Images are read as Pillow, numpy and mjrun's own writer made them."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mjrun.errors import FileError, UnknownNameError
from mjrun.formats.exr import encode_exr
from mjrun.formats.image_reader import SUFFIXES, read_image, read_palette

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


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_cannot_be_decoded_is_told(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_bytes(b"\x93NUMPY\1\0 broken")
    with pytest.raises(FileError, match=f"a{suffix}: cannot be read as {suffix}: "):
        read_image(path)


def test_what_is_no_image_is_told(tmp_path: Path) -> None:
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
