"""Videos, read back: what was written is the oracle, or else ffmpeg itself."""

import os
import tracemalloc
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import mjrun
from mjrun.errors import FileError, UsageError
from mjrun.formats.ffmpeg import write_video
from mjrun.formats.image_and_video_reader import read_video
from tests.cases import cases


def frames(count: int = 8) -> np.ndarray:
    """A white square that moves over grey and red."""
    video = np.full((count, 48, 64, 3), 128, np.uint8)
    video[:, :, 32:] = (200, 30, 30)
    for k in range(count):
        video[k, 8:24, 3 * k : 3 * k + 16] = 255
    return video


@cases("name, codec, error")
def test_a_video_reads_back_within_its_error(tmp_path: Path, name: str, codec: str | None, error: float) -> None:
    original = frames()
    write_video(tmp_path / name, original, 25, codec=codec)
    video = read_video(tmp_path / name)
    assert (video.fps, video.size) == (25, (64, 48))
    found = video.frames
    assert (found.shape, found.dtype) == (original.shape, np.uint8)
    assert np.sqrt(((found.astype(int) - original) ** 2).mean(axis=(1, 2, 3))).max() <= error


def test_frames_are_those_of_ffmpeg(tmp_path: Path, decode: Callable) -> None:
    write_video(str(tmp_path / "f.mp4"), frames(), "30000/1001")
    video = mjrun.read_video(str(tmp_path / "f.mp4"))
    assert np.array_equal(video.frames, decode(tmp_path / "f.mp4").frames)
    assert video.fps == decode(tmp_path / "f.mp4").fps == 29.97


def test_a_video_can_be_read_again_from_its_start_and_left_early(tmp_path: Path) -> None:
    write_video(tmp_path / "f.mp4", frames())
    video = read_video(tmp_path / "f.mp4")
    first = next(iter(video))
    for _ in range(2):
        assert np.array_equal(next(iter(video)), first)
    assert len(list(video)) == 8


def test_numbers_of_sixteen_bits_read_back_exactly(tmp_path: Path) -> None:
    numbers = np.random.default_rng(0).integers(0, 2**16, (3, 48, 64)).astype(np.uint16)
    write_video(tmp_path / "f.mkv", numbers)
    found = read_video(tmp_path / "f.mkv").frames
    assert found.dtype == np.uint16
    assert np.array_equal(found, numbers)


def test_a_frame_that_an_animation_holds_longer_is_repeated(tmp_path: Path) -> None:
    original = frames(12)
    original[3:9] = original[3]
    write_video(tmp_path / "f.webp", original, 25)
    video = read_video(tmp_path / "f.webp")
    assert (len(video.frames), video.fps) == (12, 25)


def test_an_animation_of_uneven_delays_has_their_mean_rate(tmp_path: Path) -> None:
    images = [Image.fromarray(frame) for frame in frames(3)]
    images[0].save(tmp_path / "f.webp", save_all=True, append_images=images[1:], duration=[33, 34, 33], lossless=True)
    video = read_video(tmp_path / "f.webp")
    assert video.fps == pytest.approx(30)
    assert np.array_equal(video.frames, frames(3))


def test_iterating_holds_one_frame_at_a_time(tmp_path: Path) -> None:
    write_video(tmp_path / "f.mp4", np.zeros((60, 240, 320, 3), np.uint8))
    video = read_video(tmp_path / "f.mp4")
    tracemalloc.start()
    try:
        assert sum(1 for _ in video) == 60
        assert tracemalloc.get_traced_memory()[1] < 10 * 240 * 320 * 3  # bytes
    finally:
        tracemalloc.stop()


def test_a_file_that_is_no_video_is_refused(tmp_path: Path) -> None:
    (tmp_path / "f.mp4").write_text("nothing of the kind")
    (tmp_path / "f.gif").write_text("nothing of the kind")
    Image.fromarray(frames(1)[0]).save(tmp_path / "still.webp")
    (tmp_path / "f.rgb").write_bytes(bytes(300))
    for name, reason in (
        ("f.mp4", "cannot be read as .mp4"),
        ("f.gif", "cannot be read as .gif"),
        ("still.webp", "cannot be read as .webp: a frame has no duration"),
        ("still.web", r"no such file \(did you mean 'still.webp'\?\)"),
    ):
        with pytest.raises(FileError, match=f"^{tmp_path}/{name}: {reason}"):
            read_video(tmp_path / name)
    with pytest.raises(FileError, match="is a folder, not a video"):
        read_video(tmp_path)
    with pytest.raises(UsageError, match="cannot read them: they do not contain their size"):
        read_video(tmp_path / "f.rgb")


def test_a_video_that_is_cut_off_is_refused_or_ends_early(tmp_path: Path) -> None:
    write_video(tmp_path / "f.mkv", frames())
    os.truncate(tmp_path / "f.mkv", (tmp_path / "f.mkv").stat().st_size // 2)
    try:
        assert len(read_video(tmp_path / "f.mkv").frames) < 8
    except FileError as error:
        assert "cannot be read as .mkv" in str(error)  # noqa: PT017


@pytest.mark.parametrize("rest", [1, 10, 100, 300])
@pytest.mark.parametrize("fps", ["12", "24", "30", "30000/1001", "60", "90"])
def test_a_webp_has_as_many_frames_as_were_written_however_long_it_rests(tmp_path: Path, fps: str, rest: int) -> None:
    greys = [*range(0, 120, 20), *[120] * rest, *range(140, 220, 20)]
    write_video(tmp_path / "f.webp", (np.full((16, 16, 3), grey, np.uint8) for grey in greys), fps)
    video = read_video(tmp_path / "f.webp")
    found = [frame.mean() for frame in video]
    assert len(found) == len(greys)
    assert np.abs(np.array(found) - greys).max() < 5
    assert video.fps == pytest.approx(float(Fraction(fps)), rel=0.01)
