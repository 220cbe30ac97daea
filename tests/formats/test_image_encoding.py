"""Encoded images: EXR as ffmpeg decodes it, and whole numbers against exact rationals."""

import io
import struct
import subprocess
from fractions import Fraction
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mjrun.errors import UsageError
from mjrun.formats import image_encoding
from mjrun.formats.image_encoding import clipped_share, depth_millimetres, encode_exr, segment_numbers
from mjrun.formats.image_format import FORMATS


def test_every_format_but_that_of_documents_names_its_encoder() -> None:
    encoders = {name: form.encoder for known in FORMATS.values() for name, form in known.items()}
    assert [name for name, encoder in encoders.items() if not encoder] == ["coco"]
    assert all(callable(getattr(image_encoding, encoder)) for encoder in encoders.values() if encoder)


depths = st.floats(0, 2e5, width=32)


@given(depths)
@example(0.0)
@example(float(np.float32(1e-30)))
@example(65.535)
@example(65.5355)
def test_a_millimetre_is_the_nearest_one_within_reach(metres: float) -> None:
    value = np.float32(metres)
    found = int(depth_millimetres(np.array([[value]]))[0, 0])
    exact = Fraction(float(value)) * 1000
    nearest = [k for k in (int(exact), int(exact) + 1) if abs(k - exact) <= Fraction(1, 2)]
    assert found in [min(max(k, 1), 65535) for k in nearest]


def test_nothing_is_zero_and_what_touches_the_lens_is_not_nothing() -> None:
    depth = np.array([[np.inf, 0, 0.0004, -1, np.nan]], np.float32)
    assert depth_millimetres(depth).tolist() == [[0, 1, 1, 1, 0]]


@given(st.lists(depths | st.just(float("inf")), min_size=1, max_size=20))
@example([65.535, 65.5355])  # the last millimetre within reach is not clipped
def test_the_clipped_share_counts_what_is_seen_and_would_need_more_than_16_bits(metres: list[float]) -> None:
    depth = np.array([metres], np.float32)
    seen = [Fraction(float(d)) for d in depth[0] if np.isfinite(d)]
    beyond = sum(d * 1000 > Fraction(131071, 2) for d in seen)
    assert clipped_share(depth) == (beyond / len(seen) if seen else 0)


@given(st.lists(st.integers(-1, 65534), min_size=1, max_size=20))
def test_ids_are_moved_up_by_one(ids: list[int]) -> None:
    stored = segment_numbers(np.array([ids], np.int32), 65535)
    assert stored.dtype == np.uint16
    assert stored.tolist() == [[k + 1 for k in ids]]


def test_more_things_than_16_bits_are_refused() -> None:
    with pytest.raises(
        UsageError, match="a segmentation of 65536 objects does not fit in an image that can hold at most 65535"
    ):
        segment_numbers(np.zeros((1, 1), np.int32), 65536)


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


def test_texts_are_attributes(tmp_path: Path) -> None:
    file = encode_exr(smooth(3, 3), {"comment": "grün", "title": ""})
    assert b"comment\0string\0" + struct.pack("<i", 5) + "grün".encode() + b"title\0string\0" + bytes(4) in file
    assert decoded(file, tmp_path) == smooth(3, 3).tobytes()


def header(file: bytes) -> dict[str, tuple[str, bytes]]:
    """Returns the type and the bytes of each attribute, read as the layout of OpenEXR files defines them."""
    attributes = dict[str, tuple[str, bytes]]()
    stream = io.BytesIO(file)
    assert stream.read(8) == bytes.fromhex("762f3101 02000000")  # magic number; version 2, single part of scan lines

    def text() -> str:
        return b"".join(iter(lambda: stream.read(1), b"\0")).decode()

    while name := text():
        kind = text()
        (size,) = struct.unpack("<i", stream.read(4))
        attributes[name] = (kind, stream.read(size))
    return attributes


def test_the_header_is_what_the_layout_of_openexr_requires() -> None:
    whole = struct.pack("<4i", 0, 0, 6, 4)  # the first and the last pixel, included
    channel = b"Y\0" + struct.pack("<i", 2) + bytes(4) + struct.pack("<ii", 1, 1)  # FLOAT, not pLinear, every pixel
    assert header(encode_exr(smooth(5, 7))) == {
        "channels": ("chlist", channel + b"\0"),
        "compression": ("compression", b"\3"),  # ZIP: 16 lines in a block
        "dataWindow": ("box2i", whole),
        "displayWindow": ("box2i", whole),
        "lineOrder": ("lineOrder", b"\0"),  # increasing y
        "pixelAspectRatio": ("float", struct.pack("<f", 1)),
        "screenWindowCenter": ("v2f", bytes(8)),
        "screenWindowWidth": ("float", struct.pack("<f", 1)),
    }


def test_smooth_depth_is_compressed() -> None:
    assert len(encode_exr(smooth(200, 300))) < 200 * 300 * 4 / 3
