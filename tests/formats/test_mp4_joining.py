"""Joined videos, compared with what an independent demuxer and decoder read from the parts."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import FileError
from mjrun.formats.codecs import encoding
from mjrun.formats.ffmpeg import VideoWriter
from mjrun.formats.mp4_joining import join, read_samples

SIZE = (64, 48)
FPS = Fraction(30000, 1001)


def made(path: Path, count: int, codec: str = "h264", keyframe_every: int | None = 2) -> Path:
    """Writes a video in which a bright bar moves."""
    how = replace(encoding(str(path), codec=codec), keyframe_every=keyframe_every)
    with VideoWriter(str(path), how, SIZE, FPS, count) as writer:
        for index in range(count):
            frame = np.full((SIZE[1], SIZE[0], 3), 40, np.uint8)
            frame[:, 3 * index % 60 : 3 * index % 60 + 4] = 220
            writer.write(frame)
        writer.publish()
    return path


def decoded(path: Path) -> tuple[list[Fraction], list[bytes]]:
    """Returns the time [s] and the pixels of each frame."""
    import av

    with av.open(str(path)) as container:
        frames = list(container.decode(video=0))
        times = [(frame.pts or 0) * (frame.time_base or Fraction(0)) for frame in frames]
        return times, [frame.to_ndarray(format="yuv420p").tobytes() for frame in frames]


@pytest.mark.parametrize("codec", ["h264", pytest.param("h265", marks=pytest.mark.slow), "av1"])
def test_a_joined_video_has_the_frames_of_its_parts_at_exact_times(tmp_path: Path, codec: str) -> None:
    parts = [made(tmp_path / f"{count}.mp4", count, codec) for count in (7, 1, 12)]
    joined = tmp_path / "joined.mp4"
    with joined.open("wb") as file:
        join(file, [read_samples(part) for part in parts], FPS)
    times, pixels = decoded(joined)
    assert times == [k / FPS for k in range(20)]
    assert pixels == [frame for part in parts for frame in decoded(part)[1]]


def test_parts_of_a_joined_video_are_joined_again_to_the_same_bytes(tmp_path: Path) -> None:
    parts = [read_samples(made(tmp_path / f"{count}.mp4", count)) for count in (3, 4, 5)]
    all_at_once, first, second = (tmp_path / name for name in ("all.mp4", "first.mp4", "second.mp4"))
    with all_at_once.open("wb") as file:
        join(file, parts, FPS)
    with first.open("wb") as file:
        join(file, parts[:2], FPS)
    with second.open("wb") as file:
        join(file, [read_samples(first).part(0, 7), parts[2]], FPS)
    assert second.read_bytes() == all_at_once.read_bytes()


def test_keyframes_are_as_far_apart_as_requested_and_frames_are_stored_in_their_order(tmp_path: Path) -> None:
    import av

    keyframes = read_samples(made(tmp_path / "a.mp4", 9, "av1", 4)).keyframes
    assert np.flatnonzero(keyframes).tolist() == [0, 4, 8]
    with av.open(str(made(tmp_path / "b.mp4", 30))) as container:
        packets = [packet for packet in container.demux(video=0) if packet.pts is not None]
        assert [packet.dts for packet in packets] == [packet.pts for packet in packets]


def test_videos_with_frames_in_another_order_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="B-frames"):
        read_samples(made(tmp_path / "a.mp4", 30, keyframe_every=None))


@pytest.mark.parametrize("content", [b"", b"no video", b"\0\0\0\x08ftyp", b"\0\0\0\x04moov", b"\xff" * 64])
def test_other_files_are_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.mp4"
    path.write_bytes(content)
    with pytest.raises(FileError):
        read_samples(path)


def test_damaged_tables_are_refused(tmp_path: Path) -> None:
    whole = made(tmp_path / "a.mp4", 5).read_bytes()
    for kind in (b"stsz", b"stsc", b"stco", b"stsd", b"stss"):
        place = whole.find(kind)
        for change in (b"\xff" * 12, b"\0" * 12):
            if place < 0:
                continue
            path = tmp_path / "b.mp4"
            path.write_bytes(whole[: place + 8] + change + whole[place + 20 :])
            try:
                samples = read_samples(path)
            except FileError:
                continue
            assert len(samples) <= len(whole)


def test_videos_of_different_codecs_are_not_joined(tmp_path: Path) -> None:
    parts = [read_samples(made(tmp_path / f"{codec}.mp4", 2, codec)) for codec in ("h264", "av1")]
    with (tmp_path / "joined.mp4").open("wb") as file, pytest.raises(ValueError, match="different codecs"):
        join(file, parts, FPS)
