"""Images, read back by Pillow and by ffmpeg."""

import json
import struct
import subprocess
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image, JpegImagePlugin

from mjrun.errors import BadValueError, FileError, UsageError
from mjrun.formats.image_format import FORMATS, image_format
from mjrun.formats.image_writer import ImageWriter
from mjrun.model.camera_images import SegmentedObject
from tests.formats.outputs import names

LEGEND = [
    SegmentedObject("geom", 7, "box", "torso"),
    SegmentedObject("geom", 8, "geom:8", "torso"),
    SegmentedObject("site", 0, "tip", "hand"),
]
COLOURS = np.array([[255, 0, 0], [0, 0, 0], [9, 8, 7]], np.uint8)
TAGS = {"title": "still", "comment": "grün\x1b", "description": '{"mjrun": "0.1.0"}'}
HEIGHT, WIDTH = 24, 37


def rgb() -> np.ndarray:
    """A smooth picture, as drawn ones are."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return np.stack([6 * x, 10 * y, 128 + 3 * (x - y)], axis=-1).astype(np.uint8)


def depth() -> np.ndarray:
    values = np.linspace(0.0001, 80, HEIGHT * WIDTH, dtype=np.float32).reshape(HEIGHT, WIDTH)
    values[:5, :9] = np.inf
    return values


def ids() -> np.ndarray:
    return np.random.default_rng(2).integers(-1, 3, (HEIGHT, WIDTH)).astype(np.int32)


VIEWS = {"rgb": rgb, "depth": depth, "seg": ids}
EVERY = [(view, name) for view, known in FORMATS.items() for name in known]


def write(path: Path, view: str, pixels: np.ndarray, form: str | None = None, **settings: Any) -> Path:
    """A published picture, in the format that the path's suffix means or in `form`."""
    size = (pixels.shape[1], pixels.shape[0])
    with ImageWriter(str(path), view, image_format(str(path), view, form), size, settings.pop("tags", None)) as out:
        out.write(pixels, **({"legend": LEGEND, "colours": COLOURS} if view == "seg" else {}), **settings)
        out.publish()
    return path


def target(folder: Path, view: str, form: str) -> Path:
    return folder / f"a{FORMATS[view][form].suffixes[0]}"


def read_tiff(data: bytes) -> np.ndarray:
    """The bits of a picture of one float32 channel, as uint32; its strips are deflated by zlib."""
    assert data[:4] == b"II*\0"
    (at,) = struct.unpack_from("<I", data, 4)
    (count,) = struct.unpack_from("<H", data, at)
    said = {277: (1,)}  # one sample is what is meant when nothing is said
    for entry in range(at + 2, at + 2 + 12 * count, 12):
        tag, kind, number = struct.unpack_from("<HHI", data, entry)
        if kind in (3, 4):
            form = f"<{number}{'H' if kind == 3 else 'I'}"
            (elsewhere,) = struct.unpack_from("<I", data, entry + 8)
            said[tag] = struct.unpack_from(form, data, entry + 8 if struct.calcsize(form) <= 4 else elsewhere)
    width, height, bits, compression, samples, sample_format = (said[tag] for tag in (256, 257, 258, 259, 277, 339))
    assert (bits, compression, samples, sample_format) == ((32,), (8,), (1,), (3,))
    strips = [zlib.decompress(data[start : start + size]) for start, size in zip(said[273], said[279], strict=True)]
    return np.frombuffer(b"".join(strips), "<u4").reshape(*height, *width)


def ffmpeg(path: Path, pixels: str, dtype: str) -> np.ndarray:
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-err_detect", "crccheck+explode", "-f", "png_pipe"]
    command = command if path.suffix == ".png" else command[:3]
    done = subprocess.run(
        [*command, "-i", str(path), "-f", "rawvideo", "-pix_fmt", pixels, "-"], capture_output=True, check=True
    )
    assert done.stderr == b""
    return np.frombuffer(done.stdout, dtype)


@dataclass(frozen=True)
class Png:
    """The content of a PNG: bits of a sample, colour type, samples `(h, w)` or `(h, w, 3)`, palette `(n, 3)`, texts."""

    bits: int
    colour: int
    samples: np.ndarray
    palette: np.ndarray
    texts: Mapping[str, str]


def read_png(path: Path) -> Png:
    """Reads an image with ffmpeg; palette and texts, which it does not show, with Pillow."""
    width, height, bits, colour = struct.unpack_from(">IIBB", path.read_bytes(), 16)  # of the header, which comes first
    with Image.open(path) as image:
        palette = np.array(image.getpalette() or [], np.uint8).reshape(-1, 3)
        texts, samples = dict(image.text), np.asarray(image)  # type: ignore[attr-defined]
    if colour == 3:
        assert (ffmpeg(path, "rgb24", "u1").reshape(height, width, 3) == palette[samples]).all()
    else:
        pixels, dtype = ("rgb24", "u1") if colour == 2 else ("gray16le", "<u2")
        samples = ffmpeg(path, pixels, dtype).reshape(height, width, *[3][: colour == 2])
    return Png(bits, colour, samples, palette, texts)


# --- colours ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".png", ".webp", ".tif", ".tiff"])
def test_colours_read_back_exactly(tmp_path: Path, suffix: str) -> None:
    path = write(tmp_path / f"a{suffix}", "rgb", rgb())
    with Image.open(path) as image:
        assert image.mode == "RGB"
        assert (np.asarray(image) == rgb()).all()
    if suffix != ".webp":  # ffmpeg turns it to YUV on the way
        assert (ffmpeg(path, "rgb24", "u1") == rgb().ravel()).all()


@pytest.mark.parametrize("suffix", [".jpg", ".jpeg"])
def test_a_jpeg_is_near_and_keeps_colour_at_full_size(tmp_path: Path, suffix: str) -> None:
    path = write(tmp_path / f"a{suffix}", "rgb", rgb())
    with Image.open(path) as image:
        assert image.format == "JPEG"
        assert JpegImagePlugin.get_sampling(image) == 0  # 4:4:4
        assert np.sqrt(np.mean((np.asarray(image, float) - rgb()) ** 2)) < 3


@pytest.mark.parametrize("size", [(1, 1), (9, 7), (33, 40)])
def test_a_png_of_any_colours_is_what_ffmpeg_reads(tmp_path: Path, size: tuple[int, int]) -> None:
    pixels = np.random.default_rng(4).integers(0, 256, (*size, 3)).astype(np.uint8)
    png = read_png(write(tmp_path / "a.png", "rgb", pixels))
    assert (png.bits, png.colour) == (8, 2)
    assert (png.samples == pixels).all()


# --- depth -----------------------------------------------------------------------------------------


def test_depth_in_a_png_is_millimetres_and_the_clipped_share_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    with ImageWriter(str(path), "depth", "png", (WIDTH, HEIGHT)) as out:
        out.write(depth())
        out.publish()
    found = read_png(path)
    seen = np.isfinite(depth())
    far = seen & (depth().astype(float) > 65.5355)
    assert (found.bits, found.colour) == (16, 0)
    assert (found.samples[~seen] == 0).all()
    assert (found.samples[far] == 65535).all()
    assert found.samples[5, 9] == round(float(depth()[5, 9]) * 1000)
    assert np.abs(found.samples[seen & ~far] / 1000.0 - depth()[seen & ~far]).max() <= 0.000501
    assert out.clipped == far.sum() / seen.sum() > 0
    with Image.open(path) as image:
        assert (np.asarray(image) == found.samples).all()


ODD_DEPTH = np.array([[0.0, -0.0, 1e-45, 0.1], [3.4e38, np.inf, 1e-3, 65.5355]], np.float32)


@pytest.mark.parametrize("values", [depth(), ODD_DEPTH], ids=["many", "odd"])
@pytest.mark.parametrize("suffix", [".exr", ".tif", ".npy"])
def test_exact_depth_reads_back_bit_for_bit(tmp_path: Path, suffix: str, values: np.ndarray) -> None:
    path = write(tmp_path / f"a{suffix}", "depth", values)
    expected = values.view(np.uint32)
    if suffix == ".exr":
        assert (ffmpeg(path, "grayf32le", "<u4") == expected.ravel()).all()
    if suffix == ".tif":
        assert (read_tiff(path.read_bytes()) == expected).all()
        with Image.open(path) as image:
            assert image.mode == "F"
            assert (np.asarray(image).view(np.uint32) == expected).all()
    if suffix == ".npy":
        found = np.load(path)
        assert found.dtype == np.float32
        assert (found.view(np.uint32) == expected).all()


def test_only_millimetres_are_clipped(tmp_path: Path) -> None:
    with ImageWriter(str(tmp_path / "a.npy"), "depth", "npy", (WIDTH, HEIGHT)) as out:
        out.write(depth())
        assert out.clipped == 0


# --- segmentation ----------------------------------------------------------------------------------


def test_ids_in_a_png_are_16_bits_with_labels_beside_it(tmp_path: Path) -> None:
    path = write(tmp_path / "a.png", "seg", ids())
    found = read_png(path)
    assert (found.bits, found.colour) == (16, 0)
    assert (found.samples.astype(int) == ids() + 1).all()
    with Image.open(path) as image:
        assert (np.asarray(image) == ids() + 1).all()
    assert names(tmp_path) == ["a.labels.json", "a.png"]


@pytest.mark.parametrize("count", [1, 2, 4, 5, 16, 17, 255])
def test_a_palette_of_any_size_reads_back(tmp_path: Path, count: int) -> None:
    random = np.random.default_rng(count)
    ids = random.integers(-1, count, (7, 11)).astype(np.int32)
    colours = random.integers(0, 256, (count, 3)).astype(np.uint8)
    with ImageWriter(str(tmp_path / "a.png"), "seg", "palette", (11, 7)) as out:
        out.write(ids, [SegmentedObject("geom", k, f"g{k}") for k in range(count)], colours)
        out.publish()
    png = read_png(tmp_path / "a.png")
    assert (png.bits, png.colour) == (8, 3)
    assert (png.samples.astype(int) == ids + 1).all()
    assert png.palette[: count + 1].tolist() == [[0, 0, 0], *colours.tolist()]


def test_raw_ids_are_int32_with_nothing_at_minus_one(tmp_path: Path) -> None:
    found = np.load(write(tmp_path / "a.npy", "seg", ids()))
    assert found.dtype == np.int32
    assert (found == ids()).all()


@pytest.mark.parametrize(("suffix", "form"), [(".png", "png"), (".png", "palette"), (".npy", "npy")])
def test_labels_name_the_values_that_are_in_the_picture(tmp_path: Path, suffix: str, form: str) -> None:
    path = write(tmp_path / f"a{suffix}", "seg", ids(), form)
    stored = np.load(path) if form == "npy" else read_png(path).samples
    said = json.loads((tmp_path / "a.labels.json").read_text())
    assert said["file"] == path.name
    assert said["size"] == [WIDTH, HEIGHT]
    for index, (entry, thing) in enumerate(zip(said["labels"], LEGEND, strict=True)):
        assert ((stored == entry["id"]) == (ids() == index)).all()
        assert entry["pixels"] == (ids() == index).sum()
        assert (entry["type"], entry["mujoco_id"], entry["name"], entry["body"]) == (
            thing.type,
            thing.id,
            thing.name,
            thing.body,
        )
        assert entry["rgb"] == COLOURS[index].tolist()
    assert ((stored == said["nothing"]) == (ids() == -1)).all()


def test_a_coco_document_holds_several_images(tmp_path: Path) -> None:
    path = tmp_path / "many.json"
    with ImageWriter(str(path), "seg", "coco", (WIDTH, HEIGHT)) as out:
        out.write(ids(), LEGEND)
        out.write(ids(), LEGEND, image={"file_name": "b.png", "camera": "side"})
        assert out.publish() == [path]
    said = json.loads(path.read_text())
    assert [image["file_name"] for image in said["images"]] == ["many.png", "b.png"]
    assert said["images"][1]["camera"] == "side"
    assert [a["area"] for a in said["annotations"]] == 2 * [int((ids() == k).sum()) for k in range(3)]
    assert names(tmp_path) == ["many.json"]


# --- every format ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("view", "form"), EVERY)
def test_the_same_picture_is_the_same_bytes_however_it_lies_in_memory(tmp_path: Path, view: str, form: str) -> None:
    pixels = VIEWS[view]()
    wide = np.zeros((2 * HEIGHT, 3 * WIDTH, *pixels.shape[2:]), pixels.dtype)
    wide[::2, ::3] = pixels
    path = target(tmp_path, view, form)
    plain = write(path, view, pixels, form).read_bytes()
    for laid in (wide[::2, ::3], np.flipud(np.flipud(pixels).copy()), np.asfortranarray(pixels)):
        assert write(path, view, laid, form).read_bytes() == plain


def test_texts_go_where_a_format_has_room_for_them(tmp_path: Path) -> None:
    for view in VIEWS:
        texts = read_png(write(tmp_path / "a.png", view, VIEWS[view](), tags=TAGS)).texts
        assert texts == {"Title": "still", "Comment": r"grün\x1b", "Description": '{"mjrun": "0.1.0"}'}
    assert r"grün\x1b".encode() in write(tmp_path / "a.exr", "depth", depth(), tags=TAGS).read_bytes()
    with Image.open(write(tmp_path / "a.tif", "depth", depth(), tags=TAGS)) as image:
        assert dict(image.getexif())[270] == '{"mjrun": "0.1.0"}'
    for name in ("a.jpg", "a.webp"):
        plain = write(tmp_path / name, "rgb", rgb()).read_bytes()
        assert write(tmp_path / name, "rgb", rgb(), tags=TAGS).read_bytes() == plain


# --- refusals --------------------------------------------------------------------------------------


def test_labels_that_cannot_be_written_are_named_at_opening(tmp_path: Path) -> None:
    (tmp_path / "a.labels.json").mkdir()
    with pytest.raises(FileError, match=r"a\.labels\.json: exists and is not a regular file"):
        ImageWriter(str(tmp_path / "a.png"), "seg", "png", (4, 4))
    assert names(tmp_path) == ["a.labels.json"]


def test_a_picture_too_large_for_its_format_is_refused_at_opening(tmp_path: Path) -> None:
    with pytest.raises(BadValueError, match="size: '16384x8' is not at most 16383 pixels per side for webp"):
        ImageWriter(str(tmp_path / "a.webp"), "rgb", "webp", (16384, 8))
    write(tmp_path / "a.webp", "rgb", np.zeros((1, 16383, 3), np.uint8))
    write(tmp_path / "a.jpg", "rgb", np.zeros((1, 65500, 3), np.uint8))


@pytest.mark.parametrize(("form", "most"), [("png", 65535), ("palette", 255)])
def test_too_many_things_are_refused_with_the_number_there_may_be(tmp_path: Path, form: str, most: int) -> None:
    with ImageWriter(str(tmp_path / "a.png"), "seg", form, (1, 1)) as out:
        out.check_segments(most)
        for fails in (
            lambda: out.check_segments(most + 1),
            lambda: out.write(np.zeros((1, 1), np.int32), LEGEND[:1] * (most + 1)),
        ):
            with pytest.raises(
                UsageError,
                match=f"segmentation of {most + 1} objects does not fit in an image that can hold at most {most}",
            ):
                fails()


@pytest.mark.parametrize(
    ("view", "form", "pixels"),
    [
        ("rgb", "png", np.zeros((2, 3), np.uint8)),
        ("rgb", "png", np.zeros((2, 3, 4), np.uint8)),
        ("rgb", "png", np.zeros((3, 2, 3), np.uint8)),
        ("rgb", "png", np.zeros((2, 3, 3), np.float32)),
        ("depth", "npy", np.zeros((2, 3), np.float64)),
        ("seg", "npy", np.zeros((2, 3), np.int64)),
        ("seg", "npy", np.full((2, 3), 3, np.int32)),
        ("seg", "npy", np.full((2, 3), -2, np.int32)),
    ],
)
def test_pixels_of_another_kind_are_a_fault_of_the_caller(
    tmp_path: Path, view: str, form: str, pixels: np.ndarray
) -> None:
    with ImageWriter(str(tmp_path / "a"), view, form, (3, 2)) as out, pytest.raises(ValueError, match="must be"):
        out.write(pixels, LEGEND)


def test_one_file_is_one_picture_with_its_colours(tmp_path: Path) -> None:
    with ImageWriter(str(tmp_path / "a.png"), "seg", "palette", (WIDTH, HEIGHT)) as out:
        with pytest.raises(ValueError, match="no image yet"):
            out.publish()
        with pytest.raises(ValueError, match="colours must be uint8"):
            out.write(ids(), LEGEND, COLOURS[:2])
        out.write(ids(), LEGEND, COLOURS)
        with pytest.raises(ValueError, match="holds one image"):
            out.write(ids(), LEGEND, COLOURS)


# --- standard output -------------------------------------------------------------------------------


@pytest.mark.parametrize(("view", "form"), EVERY)
def test_standard_output_gets_the_image_and_no_file_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfdbinary: pytest.CaptureFixture[bytes], view: str, form: str
) -> None:
    monkeypatch.chdir(tmp_path)
    pixels, legend = VIEWS[view](), {"legend": LEGEND, "colours": COLOURS} if view == "seg" else {}
    with ImageWriter(None, view, form, (WIDTH, HEIGHT)) as out:
        out.write(pixels, **legend)
        assert out.publish() == []
    printed = capfdbinary.readouterr().out
    assert names(tmp_path) == []
    with ImageWriter("image", view, form, (WIDTH, HEIGHT)) as file:
        file.write(pixels, **legend)
        assert file.publish()[0].read_bytes() == printed
