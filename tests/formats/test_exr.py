"""OpenEXR files, read back by ffmpeg, which has its own decoder."""

import struct
import subprocess
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest

from mjrun.formats.exr import encode_exr

RAW = ("-f", "rawvideo", "-pix_fmt", "grayf32le", "-")


def decoded(file: bytes, folder: Path) -> bytes:
    (folder / "a.exr").write_bytes(file)
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", str(folder / "a.exr"), *RAW]
    return subprocess.run(command, capture_output=True, check=True).stdout


def smooth(height: int, width: int) -> np.ndarray:
    values = np.add.outer(np.arange(height), np.arange(width)).astype(np.float32) / 7
    values[: height // 2, : width // 2] = np.inf
    return values


@pytest.mark.parametrize("size", [(1, 1), (15, 4), (16, 1), (17, 3), (40, 33)])
@pytest.mark.parametrize("kind", ["bits", "smooth"])
def test_every_bit_reads_back_whether_a_block_is_worth_compressing_or_not(
    tmp_path: Path, size: tuple[int, int], kind: str
) -> None:
    noise = np.random.default_rng(3).integers(0, 2**32, size, dtype=np.uint32).view(np.float32)
    values = noise if kind == "bits" else smooth(*size)
    assert decoded(encode_exr(values), tmp_path) == values.astype("<f4").tobytes()


def test_what_is_no_number_or_hardly_one_reads_back(tmp_path: Path) -> None:
    values = np.array([[np.inf, -np.inf, np.nan, -0.0, 1e-45, 3.4028235e38]], np.float32)
    assert decoded(encode_exr(values), tmp_path) == values.tobytes()


def test_lines_may_lie_in_memory_in_any_way() -> None:
    values = smooth(20, 18)
    for laid in (np.asfortranarray(values), np.flipud(np.flipud(values).copy())):
        assert encode_exr(laid) == encode_exr(values)


def test_texts_are_attributes(tmp_path: Path) -> None:
    file = encode_exr(smooth(3, 3), {"comment": "grün", "title": ""})
    assert b"comment\0string\0" + struct.pack("<i", 5) + "grün".encode() + b"title\0string\0" + bytes(4) in file
    assert decoded(file, tmp_path) == smooth(3, 3).tobytes()


def test_smooth_depth_is_compressed() -> None:
    assert len(encode_exr(smooth(200, 300))) < 200 * 300 * 4 / 3
