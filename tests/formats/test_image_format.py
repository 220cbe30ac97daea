"""Which pictures can be held by which files."""

import re
import struct
import subprocess
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest

from mjrun.errors import UnknownNameError, UsageError
from mjrun.formats.image_format import FORMATS, encode_exr, figure_format, figure_suffixes, image_format, suffixes


@pytest.mark.parametrize(
    ("output", "view", "asked", "name"),
    [
        ("still.png", "rgb", None, "png"),
        ("STILL.PNG", "rgb", None, "png"),
        ("a.b/still.jpg", "rgb", None, "jpeg"),
        ("still.jpeg", "rgb", None, "jpeg"),
        ("still.webp", "rgb", None, "webp"),
        ("still.tif", "rgb", None, "tiff"),
        ("still.tiff", "depth", None, "tiff"),
        ("still.png", "depth", None, "png"),
        ("still.exr", "depth", None, "exr"),
        ("still.npy", "depth", None, "npy"),
        ("still.npy", "seg", None, "npy"),
        ("still.png", "seg", None, "png"),
        ("still.png", "seg", "palette", "palette"),
        ("still.json", "seg", None, "coco"),
        ("still.json", "seg", "coco", "coco"),
        ("still", "rgb", "jpg", "jpeg"),
        ("still.dat", "depth", "npy", "npy"),
        (None, "rgb", None, "png"),
        (None, "depth", None, "png"),
        (None, "seg", None, "png"),
        (None, "depth", "exr", "exr"),
        (None, "seg", "json", "coco"),
    ],
)
def test_the_suffix_and_the_view_choose_the_format(output: str | None, view: str, asked: str | None, name: str) -> None:
    assert image_format(output, view, asked) == name


@pytest.mark.parametrize(
    ("output", "view", "asked", "kind", "message"),
    [
        ("a.bmp", "rgb", None, UnknownNameError, "in a.bmp (did you mean '.webp'?)\nimage formats: .png, .jpg, "),
        ("a.pgn", "seg", None, UnknownNameError, "in a.pgn (did you mean '.png'"),
        ("still", "rgb", None, UnknownNameError, "no image format '' in still\nimage formats: .png, "),
        ("a.png", "normals", None, UnknownNameError, "no view 'normals'\nviews: rgb, depth, seg"),
        ("a.png", "rgb", "gif", UnknownNameError, "no format 'gif'\nformats: png, jpeg, webp, tiff"),
        (
            "a.jpg",
            "depth",
            None,
            UsageError,
            "a.jpg: a .jpg cannot hold exact depth\n.png, .npy, .exr, .tiff, .tif can",
        ),
        ("a.webp", "seg", None, UsageError, "a .webp cannot hold exact segmentation\n.png, .npy, .json can"),
        ("a.exr", "rgb", None, UsageError, "a .exr cannot hold colours\n.png, .jpg, .jpeg, .webp, .tiff, .tif can"),
        (None, "depth", "jpeg", UsageError, "format jpeg cannot hold exact depth\npng, npy, exr, tiff can"),
        ("a.png", "rgb", "palette", UsageError, "format palette cannot hold colours\npng, jpeg, webp, tiff can"),
        ("a.png", "depth", "exr", UsageError, "format exr and the suffix of a.png disagree"),
        ("a.jpg", "depth", "npy", UsageError, "format npy and the suffix of a.jpg disagree"),
        ("\x1b[2J.jpg", "depth", None, UsageError, r"\x1b[2J.jpg: a .jpg cannot"),
    ],
)
def test_what_does_not_fit_is_refused_with_what_does(
    output: str | None, view: str, asked: str | None, kind: type[UsageError], message: str
) -> None:
    with pytest.raises(kind, match=re.escape(message)) as caught:
        image_format(output, view, asked, "THE HINT")
    assert str(caught.value).endswith("\nTHE HINT") == ("cannot" in message)


def test_suffixes_are_those_of_the_table() -> None:
    assert suffixes("rgb") == [".png", ".jpg", ".jpeg", ".webp", ".tiff", ".tif"]
    for view, known in FORMATS.items():
        assert all(image_format(f"a{suffix}", view) in known for suffix in suffixes(view))


@pytest.mark.parametrize(
    ("output", "named", "name"),
    [
        ("a.png", None, "png"),
        ("a.SVG", None, "svg"),
        ("a.pdf", None, "pdf"),
        ("a.jpg", None, "jpeg"),
        ("a.pdf", "pdf", "pdf"),
        ("a", "svg", "svg"),
        (None, None, "png"),
        (None, "pdf", "pdf"),
        (None, ".svg", "svg"),
    ],
)
def test_the_suffix_or_the_option_decides(output: str | None, named: str | None, name: str) -> None:
    assert figure_format(output, named) == name


@pytest.mark.parametrize(
    ("output", "named", "kind", "message"),
    [
        ("a.png", "svg", UsageError, "format svg and the suffix of a.png disagree"),
        ("a.svg", "png", UsageError, "format png and the suffix of a.svg disagree"),
        ("a.svg", "pdf", UsageError, "disagree"),
        ("a.npy", None, UsageError, "npy cannot hold"),
        ("a.gif", None, UnknownNameError, r"no figure format '.gif' in a.gif"),
        (None, "bmp", UnknownNameError, "no figure format 'bmp' in format"),
    ],
)
def test_what_holds_no_figure_is_refused(output: str | None, named: str | None, kind: type, message: str) -> None:
    with pytest.raises(kind, match=message):
        figure_format(output, named)


def test_every_suffix_has_a_format() -> None:
    assert {".png", ".svg", ".pdf"} <= set(figure_suffixes())
    assert all(figure_format(f"a{suffix}") for suffix in figure_suffixes())


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
