"""Videos and images, beside their decoded frames."""

from pathlib import Path

import numpy as np
import pytest
import skimage
from PIL import Image

from mjrun.diff.images_and_videos import compare_images, compare_videos
from mjrun.diff.tolerances import Tolerance
from mjrun.errors import FileError
from mjrun.formats.ffmpeg import write_video
from mjrun.formats.image_and_video_reader import read_video

RNG = np.random.default_rng(5)
FRAMES = np.repeat(np.repeat(RNG.integers(0, 256, (6, 6, 8, 3), np.uint8), 8, 1), 8, 2)  # 6 of 64 x 48
EXACT = Tolerance()


def video(folder: Path, name: str, frames: np.ndarray, fps: int = 10) -> str:
    write_video(str(folder / name), frames, fps)
    return str(folder / name)


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> str:
    return video(tmp_path_factory.mktemp("videos"), "a.mp4", FRAMES)


def test_the_measures_of_a_video_are_those_of_its_decoded_frames(tmp_path: Path, original: str) -> None:
    changed = FRAMES.copy()
    changed[4:, 10:20, 10:20] ^= 255
    changed[2, 0, 0] ^= 64
    a, b = original, video(tmp_path, "b.mkv", changed)
    found, worst = compare_videos(a, b, Tolerance(40))
    decoded = [np.stack(list(read_video(path))).astype(int) for path in (a, b)]
    size = np.abs(decoded[0] - decoded[1])
    beyond = (size > 40).any(axis=3).mean(axis=(1, 2))
    square = (size**2).mean(axis=(1, 2, 3))
    assert (found.pixels, found.frames, found.frames_a, found.frames_b) == ("colours", 6, 6, 6)
    assert (found.fps_a, found.size_a) == (10, (64, 48))
    assert found.differing == (beyond > 0).sum()
    assert found.changed == pytest.approx(beyond.mean())
    assert found.psnr == pytest.approx(10 * np.log10(255**2 / square.mean()))
    assert found.first
    assert found.worst
    assert found.most_changed
    assert found.least_similar
    assert found.first.frame == np.flatnonzero(beyond)[0]
    assert (found.worst.frame, found.worst.time) == (square.argmax(), square.argmax() / 10)
    assert found.worst.psnr == pytest.approx(
        skimage.metrics.peak_signal_noise_ratio(*(each[square.argmax()].astype(np.uint8) for each in decoded))
    )
    assert found.most_changed.frame == beyond.argmax()
    assert worst
    assert np.array_equal(worst.a, decoded[0][square.argmax()])
    assert np.array_equal(worst.b, decoded[1][square.argmax()])


def test_sizes_rates_and_counts_are_reported(tmp_path: Path, original: str) -> None:
    shorter, _ = compare_videos(original, video(tmp_path, "b.mp4", FRAMES[:4], 20), EXACT)
    assert (shorter.frames, shorter.frames_a, shorter.frames_b) == (4, 6, 4)
    assert (shorter.fps_a, shorter.fps_b) == (10, 20)
    smaller, worst = compare_videos(original, video(tmp_path, "c.mp4", FRAMES[:, :32, :48]), EXACT)
    assert (smaller.frames, smaller.frames_b, smaller.size_b) == (0, 6, (48, 32))
    assert worst is None


def test_a_folder_of_images_is_a_video(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        for index, frame in enumerate(FRAMES[:3]):
            Image.fromarray(frame).save(tmp_path / name / f"{index:06}.png")
    folders = str(tmp_path / "a"), str(tmp_path / "b")
    found, _ = compare_videos(*folders, EXACT)
    assert (found.frames, found.differing, found.worst, found.fps_a) == (3, 0, None, None)
    Image.fromarray(FRAMES[2, :9]).save(tmp_path / "b" / "000002.png")
    with pytest.raises(FileError, match=r"000002.png: differs in size or kind"):
        compare_videos(*folders, EXACT)
    (tmp_path / "c").mkdir()
    with pytest.raises(FileError, match=r"c: contains no .png images"):
        compare_videos(folders[0], str(tmp_path / "c"), EXACT)


def test_depth_and_segments_are_numbers(tmp_path: Path) -> None:
    depth = np.array([[100, 200], [0, 65535]], np.uint16)
    Image.fromarray(depth).save(tmp_path / "a.png")
    Image.fromarray(depth + np.array([[1, 0], [0, 0]], np.uint16)).save(tmp_path / "b.png")
    found, _ = compare_images(str(tmp_path / "a.png"), str(tmp_path / "b.png"), EXACT)
    assert (found.pixels, found.psnr, found.ssim) == ("numbers", None, None)
    assert found.worst
    assert (found.worst.changed, found.worst.maximum, found.worst.psnr) == (0.25, 1, None)
    assert compare_images(str(tmp_path / "a.png"), str(tmp_path / "b.png"), Tolerance(1))[0].first is None


def test_images_of_one_palette_are_compared_by_its_indices(tmp_path: Path) -> None:
    for name, ids, colours in (("a", [0, 1, 1], [9, 9]), ("b", [0, 1, 2], [9, 9]), ("c", [0, 2, 1], [8, 9])):
        image = Image.fromarray(np.array([ids], np.uint8))
        image.putpalette(bytes([0, 0, 0, *(byte for colour in colours for byte in (colour, 0, 0))]))
        image.save(tmp_path / f"{name}.png")
    a, b, c = (str(tmp_path / f"{name}.png") for name in "abc")
    assert compare_images(a, b, EXACT)[0].changed == pytest.approx(1 / 3)  # though they look alike
    assert compare_images(b, c, EXACT)[0].pixels == "colours"


def test_colours_are_not_compared_with_numbers(tmp_path: Path) -> None:
    Image.fromarray(FRAMES[0]).save(tmp_path / "a.png")
    np.save(tmp_path / "b.npy", np.zeros((48, 64), np.float32))
    found, worst = compare_images(str(tmp_path / "a.png"), str(tmp_path / "b.npy"), EXACT)
    assert (found.pixels, found.frames, worst) == ("colours and numbers", 0, None)
