"""Videos, read back by a decoder."""

import io
import os
import re
import shutil
import struct
import subprocess
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image, ImageSequence

from mjrun.errors import EncoderError, FileError, MjrunError, UsageError
from mjrun.formats.codecs import encoding
from mjrun.formats.ffmpeg import VideoWriter, write_video
from tests.cases import cases

SIZE = (64, 48)
FPS = Fraction(25)
GREY, RED, GREEN, BLUE = (128, 128, 128), (200, 30, 30), (30, 180, 60), (40, 60, 200)


def frames(count: int, size: tuple[int, int] = SIZE, moving: bool = True) -> np.ndarray:
    """Four flat colours, and a white square that moves two pixels per frame."""
    width, height = size
    video = np.empty((count, height, width, 3), np.uint8)
    video[:, : height // 2, : width // 2] = GREY
    video[:, : height // 2, width // 2 :] = RED
    video[:, height // 2 :, : width // 2] = GREEN
    video[:, height // 2 :, width // 2 :] = BLUE
    for k in range(count if moving else 0):
        video[k, 4:12, 2 * k % (width - 8) : 2 * k % (width - 8) + 8] = 255
    return video


def write(output: str, pictures: np.ndarray, promised: int | None = None, fps: Fraction = FPS, **how: object) -> None:
    chosen = encoding(output, **how)  # type: ignore[arg-type]
    size = (pictures.shape[2], pictures.shape[1])
    with VideoWriter(output, chosen, size, fps, len(pictures) if promised is None else promised) as video:
        for picture in pictures:
            video.write(picture)
        video.publish()


@cases("name, how, error")
def test_a_video_of_an_iterable_has_every_frame_in_order_and_in_its_colours(
    tmp_path: Path, decode: Callable, name: str, how: dict[str, Any], error: float
) -> None:
    original = frames(12)
    assert write_video(tmp_path / name, iter(original), 25, **how) == [tmp_path / name]
    video = decode(tmp_path / name)
    assert video.frames.shape == original.shape
    assert video.fps == 25
    difference = np.abs(video.frames.astype(int) - original)
    assert np.sqrt((difference**2).mean(axis=(1, 2, 3))).max() <= error * 2.5
    for colour, corner in ((GREY, (20, 10)), (RED, (20, 54)), (GREEN, (40, 10)), (BLUE, (40, 54))):
        assert np.abs(video.frames[:, *corner].astype(int) - colour).max() <= error
    for k in (0, 5, 11):
        assert video.frames[k, 8, 2 * k + 4].min() > 200


@pytest.mark.parametrize("name", ["f.mp4", "f.mov", "f.mkv", "f.webm", "f.gif", "f.apng", "f.webp"])
def test_the_same_frames_are_the_same_file(tmp_path: Path, name: str) -> None:
    contents = []
    for _ in range(2):
        write(str(tmp_path / name), frames(3))
        contents.append((tmp_path / name).read_bytes())
    assert contents[0] == contents[1]


@pytest.mark.parametrize("length", [10, 30_000])
def test_tags_of_any_length_are_kept(tmp_path: Path, length: int) -> None:
    path, text = tmp_path / "f.mkv", "a=b;#c\\ é" * length
    with VideoWriter(str(path), encoding(str(path)), SIZE, FPS, 2, tags={"description": text}) as video:
        for picture in frames(2):
            video.write(picture)
        video.publish()
    assert text.encode() in path.read_bytes()
    assert [path] == list(tmp_path.iterdir())


def test_bare_pixels_are_the_frames(tmp_path: Path) -> None:
    original = frames(5)
    write(str(tmp_path / "f.rgb"), original)
    write(str(tmp_path / "g.bin"), original, format="rgb")
    for name in ("f.rgb", "g.bin"):
        found = np.frombuffer((tmp_path / name).read_bytes(), np.uint8)
        assert np.array_equal(found.reshape(original.shape), original)


@pytest.mark.parametrize(("name", "codec"), [("n.mkv", "ffv1-gray16"), ("n/", "png-gray16")])
def test_numbers_of_sixteen_bits_stay_as_they_are(tmp_path: Path, name: str, codec: str) -> None:
    original = np.random.default_rng(0).integers(0, 2**16, (3, 48, 64)).astype(np.uint16)
    chosen = encoding(f"{tmp_path}/{name}", content="exact")
    assert chosen.codec == codec
    with VideoWriter(f"{tmp_path}/{name}", chosen, SIZE, FPS, 3) as video:
        for numbers in original:
            video.write(numbers)
        video.publish()
    if name.endswith("/"):
        found = np.stack([np.array(Image.open(file)) for file in sorted((tmp_path / name).iterdir())])
    else:
        program = imageio_ffmpeg.get_ffmpeg_exe()
        raw = [program, "-v", "error", "-i", f"{tmp_path}/{name}", "-f", "rawvideo", "-pix_fmt", "gray16le", "-"]
        done = subprocess.run(raw, capture_output=True, check=True)
        found = np.frombuffer(done.stdout, "<u2").reshape(original.shape)
    assert np.array_equal(found, original)


def test_an_animated_webp_has_every_frame(tmp_path: Path) -> None:
    original = frames(12)
    write(str(tmp_path / "f.webp"), original)
    with Image.open(tmp_path / "f.webp") as video:
        found = np.stack([np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(video)])
    assert found.shape == original.shape
    assert np.abs(found[:, 40, 54].astype(int) - BLUE).max() < 12


@pytest.mark.parametrize("name", ["f.webp", "f.gif", "f.apng", "f.mp4"])
def test_a_video_in_which_nothing_moves_is_a_video(tmp_path: Path, name: str) -> None:
    write(str(tmp_path / name), frames(8, moving=False))
    assert (tmp_path / name).stat().st_size > 100


def test_a_webp_with_pauses_lasts_as_long_as_promised(tmp_path: Path) -> None:
    original = frames(12)
    original[3:9] = original[3]
    write(str(tmp_path / "f.webp"), original)
    with Image.open(tmp_path / "f.webp") as video:
        lasts = []
        for frame in ImageSequence.Iterator(video):
            frame.load()
            lasts.append(video.info["duration"])
    assert sum(lasts) == 12 * 40


@pytest.mark.parametrize("name", ["frames/", "f_%03d.png"])
def test_pngs_are_the_frames_to_the_last_bit(tmp_path: Path, name: str) -> None:
    original = frames(5)
    write(f"{tmp_path}/{name}", original)
    files = sorted(tmp_path.rglob("*.png"))
    assert np.array_equal(np.stack([np.asarray(Image.open(file)) for file in files]), original)


def test_an_mp4_plays_in_a_browser(tmp_path: Path, decode: Callable) -> None:
    write(str(tmp_path / "f.mp4"), frames(5))
    stream = decode(tmp_path / "f.mp4").stream
    assert "h264" in stream
    assert "yuv420p(tv, bt709" in stream
    boxes = [kind for kind, _ in top_boxes((tmp_path / "f.mp4").read_bytes())]
    assert boxes.index(b"moov") < boxes.index(b"mdat")


def top_boxes(video: bytes) -> Iterator[tuple[bytes, int]]:
    """Kind and size of an ISO media file's outermost boxes."""
    stream = io.BytesIO(video)
    while head := stream.read(8):
        size, kind = struct.unpack(">I4s", head)
        yield kind, size
        stream.seek(size - 8, io.SEEK_CUR)


@pytest.mark.parametrize("size", [(63, 48), (64, 47), (63, 47)])
def test_odd_sides_are_padded_by_repeating_the_edge(tmp_path: Path, decode: Callable, size: tuple[int, int]) -> None:
    original = frames(3, size)
    write(str(tmp_path / "f.mp4"), original)
    found = decode(tmp_path / "f.mp4").frames
    assert found.shape == (3, 48, 64, 3)
    shown = found[:, : size[1], : size[0]].astype(int)
    assert np.abs(shown - original).mean() < 6
    if size[0] == 63:
        assert np.abs(found[:, 40, 63].astype(int) - BLUE).max() < 12


def test_rates_are_kept_exactly(tmp_path: Path, decode: Callable) -> None:
    write(str(tmp_path / "f.mp4"), frames(3), fps=Fraction(30000, 1001))
    assert decode(tmp_path / "f.mp4").fps == 29.97


@pytest.mark.parametrize("name", ["f.mp4", "f.mov", "f.apng"])
@pytest.mark.parametrize("fps", ["125", "250", "119.88", "999/8"])  # close to common rates
def test_frame_k_of_a_short_video_is_shown_at_k_over_the_rate(tmp_path: Path, name: str, fps: str) -> None:
    write(str(tmp_path / name), frames(5), fps=Fraction(fps))
    arguments = ["-i", str(tmp_path / name), "-vf", "showinfo", "-fps_mode", "passthrough", "-f", "null", "-"]
    log = subprocess.run([imageio_ffmpeg.get_ffmpeg_exe(), *arguments], capture_output=True, text=True).stderr
    times = [float(time) for time in re.findall(r"pts_time:(\S+)", log)]
    assert times == pytest.approx([k / Fraction(fps) for k in range(5)], abs=2e-5)  # APNGs are read in 10 µs


def test_quality_and_effort_reach_the_encoder(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (6, 48, 64, 3), np.uint8)
    sizes = {}
    for crf in (5, 40):
        write(str(tmp_path / "f.mp4"), noise, crf=crf, preset="ultrafast")
        sizes[crf] = (tmp_path / "f.mp4").stat().st_size
    assert sizes[40] < sizes[5] / 2


@pytest.mark.parametrize("promised", [4, 6])
def test_a_video_that_is_not_what_was_promised_is_not_published(tmp_path: Path, promised: int) -> None:
    (tmp_path / "f.mp4").write_text("old")
    with pytest.raises(EncoderError, match=f"the video has 5 frames, expected {promised}"):
        write(str(tmp_path / "f.mp4"), frames(5), promised)
    assert (tmp_path / "f.mp4").read_text() == "old"


def test_a_file_that_lost_frames_is_noticed(tmp_path: Path) -> None:
    with VideoWriter(str(tmp_path / "f.mp4"), encoding("f.mp4"), SIZE, FPS, 5) as video:
        for picture in frames(5)[:4]:
            video.write(picture)
        video.written += 1  # as if the encoder had dropped one
        with pytest.raises(EncoderError, match="the encoder wrote 4 frames, expected 5"):
            video.publish()


def test_a_killed_encoder_is_an_error_and_leaves_the_old_video(tmp_path: Path) -> None:
    (tmp_path / "f.mp4").write_text("old")

    def go_on_writing(video: VideoWriter) -> None:
        video.write(frames(1)[0])
        video._child.kill()
        while True:
            video.write(frames(1)[0])

    with (
        VideoWriter(str(tmp_path / "f.mp4"), encoding("f.mp4"), SIZE, FPS, 100) as video,
        pytest.raises(EncoderError, match="the encoder failed after"),
    ):
        go_on_writing(video)
    assert (tmp_path / "f.mp4").read_text() == "old"


def test_a_folder_that_is_removed_while_it_is_written_is_an_output_that_cannot_be_written(tmp_path: Path) -> None:
    with VideoWriter(str(tmp_path / "frames/"), encoding("frames/"), SIZE, FPS, 2) as video:
        shutil.rmtree(Path(video.destination.path % 0).parent)
        video.write(frames(1)[0])
        video.written += 1
        with pytest.raises(FileError, match="frames: cannot be written: its folder was removed"):
            video.publish()


@pytest.fixture
def hanging_encoder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An ffmpeg that takes nothing, does nothing, and has a child that holds its standard error."""
    program = tmp_path / "ffmpeg"
    program.write_text("#!/bin/sh\necho 'not today' >&2\nsleep 600 &\nsleep 600\n")
    program.chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(program))
    monkeypatch.setattr("mjrun.formats.ffmpeg.IDLE", 0.5)
    monkeypatch.setattr("mjrun.child_process.IDLE_INTERVAL", 0.1)


@pytest.mark.usefixtures("hanging_encoder")
@pytest.mark.parametrize("size", [SIZE, (640, 480)])  # what fits into a pipe, so that the end is waited for, or not
def test_an_encoder_that_hangs_is_an_error(tmp_path: Path, size: tuple[int, int]) -> None:
    with pytest.raises(EncoderError, match=r"the encoder did nothing any more after . of 1 frames\n  not today"):
        write(str(tmp_path / "f.mp4"), frames(1, size))
    assert [path.name for path in tmp_path.iterdir()] == ["ffmpeg"]


def test_an_encoder_that_waits_for_a_paused_player_does_not_hang(monkeypatch: pytest.MonkeyPatch) -> None:
    reader, writer = os.pipe()
    monkeypatch.setattr("mjrun.formats.ffmpeg.IDLE", 0.3)
    monkeypatch.setattr("mjrun.child_process.IDLE_INTERVAL", 0.1)
    sizes = list[int]()

    def play() -> None:
        time.sleep(2)
        while content := os.read(reader, 2**16):
            sizes.append(len(content))

    with os.fdopen(writer, "w") as stdout, monkeypatch.context() as patch:
        patch.setattr("sys.stdout", stdout)
        player = threading.Thread(target=play)
        player.start()
        with VideoWriter(None, encoding(None, "rgb"), (640, 480), FPS, 3) as video:
            for picture in frames(3, (640, 480)):
                video.write(picture)
            video.publish()
    player.join()
    os.close(reader)
    assert sum(sizes) == 3 * 3 * 640 * 480


def test_what_the_encoder_said_last_is_in_the_error(tmp_path: Path) -> None:
    broken = replace(encoding("f.mp4"), preset="nonsense")

    def go_on_writing(video: VideoWriter) -> None:
        for picture in frames(200):
            video.write(picture)
        video.publish()

    with (
        VideoWriter(str(tmp_path / "f.mp4"), broken, SIZE, FPS, 200) as video,
        pytest.raises(EncoderError, match="nonsense"),
    ):
        go_on_writing(video)


def test_too_small_a_video_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MjrunError, match="at least 16x16"):
        VideoWriter(str(tmp_path / "f.mp4"), encoding("f.mp4"), (64, 8), FPS, 1)


def test_a_frame_of_another_size_is_a_programming_error(tmp_path: Path) -> None:
    with (
        VideoWriter(str(tmp_path / "f.mp4"), encoding("f.mp4"), SIZE, FPS, 1) as video,
        pytest.raises(ValueError, match="a frame must be uint8"),
    ):
        video.write(np.zeros((10, 10, 3), np.uint8))


def test_frames_are_encoded_as_they_come(tmp_path: Path) -> None:
    alive: list[weakref.ref] = []

    def noise() -> Iterator[np.ndarray]:
        rng = np.random.default_rng(0)
        for _ in range(20):
            frame = rng.integers(0, 255, (48, 64, 3), np.uint8)
            alive.append(weakref.ref(frame))
            yield frame
            del frame
            assert sum(ref() is not None for ref in alive) <= 2  # the first one, and the one before

    write_video(tmp_path / "f.mp4", noise())
    assert len(alive) == 20


def test_grey_frames_are_their_colours(tmp_path: Path, decode: Callable) -> None:
    grey = frames(3)[..., 0]
    write_video(tmp_path / "f.mkv", grey, codec="ffv1")
    assert np.array_equal(decode(tmp_path / "f.mkv").frames, np.repeat(grey[..., None], 3, axis=3))


def test_sixteen_bits_stay_as_they_are(tmp_path: Path) -> None:
    millimetres = np.random.default_rng(0).integers(0, 2**16, (3, 48, 64)).astype(np.uint16)
    files = write_video(tmp_path / "frames", millimetres)
    assert [file.name for file in files] == ["000000.png", "000001.png", "000002.png"]
    assert np.array_equal(np.stack([np.array(Image.open(file)) for file in files]), millimetres)
    with pytest.raises(UsageError, match="mp4 cannot hold numbers of 16 bits\\nmkv, png can"):
        write_video(tmp_path / "f.mp4", millimetres)


GOOD = np.zeros((48, 64, 3), np.uint8)


@pytest.mark.parametrize(
    ("pictures", "message"),
    [
        ([], "there are no frames"),
        ([GOOD, GOOD, GOOD[:40]], "frame 2 is uint8 (40, 64, 3), but frame 0 is uint8 (48, 64, 3)"),
        ([GOOD, GOOD[..., 0]], "frame 1 is uint8 (48, 64), but frame 0 is uint8 (48, 64, 3)"),
        ([GOOD / 255], "frame 0 is float64 (48, 64, 3), not uint8 (height, width, 3), uint8 (height, width) or"),
        ([np.zeros((48, 64, 4), np.uint8)], "frame 0 is uint8 (48, 64, 4), not uint8 (height, width, 3)"),
        ([GOOD, None], "frame 1 is NoneType, not uint8"),
        ([GOOD.tolist()], "frame 0 is list, not uint8"),
    ],
)
def test_a_frame_that_is_wrong_is_named_and_nothing_is_written(tmp_path: Path, pictures: list, message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        write_video(tmp_path / "f.mp4", pictures)
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_written_is_reported_before_a_second_frame_is_drawn(tmp_path: Path) -> None:
    def endless() -> Iterator[np.ndarray]:
        yield GOOD
        raise AssertionError

    cases: tuple[tuple[Path, dict[str, Any], str], ...] = (
        (Path("/dev/null/f.mp4"), {}, "is not a folder"),
        (tmp_path / "f.mp5", {}, "no video format '.mp5'"),
        (tmp_path / "f.mp4", {"codec": "vp9"}, "no codec 'vp9' in mp4"),
        (tmp_path / "f.mp4", {"crf": 99}, "crf: '99' is not from 0"),
        (tmp_path / "f.mp4", {"fps": 0}, "fps: '0' is not a positive number"),
        (tmp_path / "f.mp4", {"fps": "fast"}, "fps: 'fast' is not a positive number"),
        (tmp_path / "f.gif", {}, "fps: '30' is not possible in a GIF"),
    )
    for path, options, error in cases:
        with pytest.raises(MjrunError, match=re.escape(error)):
            write_video(path, endless(), **options)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("argument", "value", "expected"),
    [
        ("path", None, "the name of a file"),
        ("path", 3, "the name of a file"),
        ("frames", None, "an iterable of arrays"),
        ("fps", None, "a positive number"),
        ("crf", "x", "a whole number"),
        ("codec", 3, "text"),
        ("format", 3, "text"),
    ],
)
def test_an_argument_of_another_type_is_refused_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, argument: str, value: object, expected: str
) -> None:
    monkeypatch.chdir(tmp_path)
    arguments: dict[str, Any] = {"path": "f.mp4", "frames": [GOOD], argument: value}
    with pytest.raises(UsageError, match=f"^{argument}: .* is not {expected}"):
        write_video(**arguments)
    assert list(tmp_path.iterdir()) == []


def test_a_source_of_frames_that_fails_leaves_the_old_video(tmp_path: Path) -> None:
    def failing() -> Iterator[np.ndarray]:
        yield from [GOOD, GOOD]
        raise RuntimeError("no more")

    (tmp_path / "f.mp4").write_text("old")
    with pytest.raises(RuntimeError, match="no more"):
        write_video(tmp_path / "f.mp4", failing())
    assert (tmp_path / "f.mp4").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["f.mp4"]
