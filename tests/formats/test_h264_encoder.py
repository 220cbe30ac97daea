"""Streams of H.264, split into access units by us and decoded by ffmpeg."""

import re
import subprocess
from fractions import Fraction
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest

from mjrun.errors import EncoderError
from mjrun.formats.h264_encoder import H264Encoder

IDR, SEQUENCE_PARAMETERS, PICTURE_PARAMETERS = 5, 7, 8


def frames(count: int, width: int = 64, height: int = 48) -> np.ndarray:
    """Noise on grey, and a white bar that moves: its place tells the frame."""
    background = np.random.default_rng(0).integers(90, 110, (height, width, 3)).astype(np.uint8)
    video = np.repeat(background[None], count, axis=0)
    for k in range(count):
        video[k, :, 2 * k % (width - 2) : 2 * k % (width - 2) + 2] = 255
    return video


def encoded(video: np.ndarray, fps: Fraction = Fraction(10)) -> list[bytes]:
    with H264Encoder((video.shape[2], video.shape[1]), fps) as stream:
        units = [unit for frame in video for unit in stream.write(frame)]
        return [*units, *stream.end()]


def kinds(unit: bytes) -> list[int]:
    """Returns the types of the NAL units in an access unit."""
    return [unit[start.end()] & 31 for start in re.finditer(b"\0\0\1", unit)]


def decoded(stream: bytes, width: int, height: int) -> np.ndarray:
    """Returns the frames that ffmpeg decodes from a raw stream."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-f", "h264", "-i", "-", "-fps_mode", "passthrough"]
    command += ["-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    pixels = subprocess.run(command, input=stream, stdout=subprocess.PIPE, check=True).stdout
    return np.frombuffer(pixels, np.uint8).reshape(-1, height, width, 3)


def test_each_frame_is_an_access_unit_and_decodes_in_its_order() -> None:
    video = frames(33)
    units = encoded(video)
    assert len(units) == len(video)
    read = decoded(b"".join(units), 64, 48)
    assert read.shape == video.shape
    assert [int(frame.mean(axis=(0, 2)).argmax()) // 2 * 2 for frame in read] == [2 * k % 62 for k in range(33)]


def test_a_keyframe_each_second_contains_its_parameter_sets_and_begins_a_decodable_stream() -> None:
    video = frames(25)
    units = encoded(video, Fraction(10))
    keys = [index for index, unit in enumerate(units) if IDR in kinds(unit)]
    assert np.diff([*keys, len(units)]).max() <= 10  # or sooner, where the image changes as a whole
    assert all({SEQUENCE_PARAMETERS, PICTURE_PARAMETERS} <= {*kinds(units[index])} for index in keys)
    assert len(decoded(b"".join(units[keys[1] :]), 64, 48)) == len(units) - keys[1]


def test_each_delta_frame_decodes_at_once_as_none_waits_for_a_later_one() -> None:
    units = encoded(frames(12))
    for count in range(1, 12, 3):
        assert len(decoded(b"".join(units[:count]), 64, 48)) == count


def test_odd_sides_are_padded() -> None:
    video = frames(3, 33, 17)
    with H264Encoder((33, 17), Fraction(30)) as stream:
        assert stream.encoded_size == (34, 18)
    assert decoded(b"".join(encoded(video)), 34, 18).shape == (3, 18, 34, 3)


def test_a_stream_without_frames_and_one_of_a_single_frame_end() -> None:
    with H264Encoder((64, 48), Fraction(1, 7)) as stream:
        assert stream.end() == []
    assert len(encoded(frames(1), Fraction(1, 7))) == 1


def test_an_encoder_that_dies_is_reported() -> None:
    with H264Encoder((64, 48), Fraction(30)) as stream:
        stream._child.kill()
        with pytest.raises(EncoderError, match=r"the H.264 encoder stopped after \d+ frames"):
            [stream.write(frame) for frame in frames(300)]


def test_a_frame_of_another_size_is_refused(tmp_path: Path) -> None:
    with H264Encoder((64, 48), Fraction(30)) as stream, pytest.raises(ValueError, match=r"\(48, 64, 3\)"):
        stream.write(np.zeros((48, 63, 3), np.uint8))
