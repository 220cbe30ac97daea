"""The bundled ffmpeg."""

import re
import subprocess
from fractions import Fraction
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest

import mjrun
from mjrun.errors import EncoderError, FileError
from mjrun.formats.codecs import CODECS
from mjrun.formats.ffmpeg import DEMUXERS, H264Encoder, command, encoder_version, run, working_codecs, write_video
from mjrun.formats.image_and_video_reader import ANIMATIONS, read_image, read_video
from mjrun.formats.image_encoding import encode_exr

PLAYLISTS = {
    "ffconcat": "ffconcat version 1.0\nfile other.mkv\n",
    "m3u8": "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nother.mkv\n#EXT-X-ENDLIST\n",
    "dash": '<MPD type="static" mediaPresentationDuration="PT1S"><Period><AdaptationSet><Representation>'
    "<BaseURL>other.mkv</BaseURL></Representation></AdaptationSet></Period></MPD>",
}
VIDEOS = [suffix for suffix in DEMUXERS if f".{suffix}" not in (*ANIMATIONS, ".exr")]


def test_every_codec_works_here() -> None:
    assert encoder_version()
    assert working_codecs() == dict.fromkeys(CODECS, True)


def test_a_missing_encoder_is_reported_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", "/nowhere/ffmpeg")
    with pytest.raises(EncoderError, match="ffmpeg cannot be run"):
        encoder_version()
    with pytest.raises(EncoderError, match="reinstall imageio-ffmpeg"):
        command("-version")


def test_a_program_that_hangs_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = tmp_path / "ffmpeg"
    program.write_text("#!/bin/sh\necho waiting >&2\nexec sleep 600\n")
    program.chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(program))
    monkeypatch.setattr("mjrun.formats.ffmpeg.IDLE", 0.3)
    monkeypatch.setattr("mjrun.child_process.IDLE_INTERVAL", 0.1)
    answer = run("-version")
    assert not answer.is_good
    assert (answer.status.cause, answer.log) == ("idle", "waiting\n")


@pytest.fixture(scope="module")
def contents(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, bytes]:
    """Two videos: three small black frames, and five grey ones."""
    folder = tmp_path_factory.mktemp("videos")
    for name, frames in (
        ("black", np.zeros((3, 48, 64, 3), np.uint8)),
        ("grey", np.full((5, 32, 48, 3), 200, np.uint8)),
    ):
        write_video(folder / f"{name}.mkv", frames, codec="ffv1")
    return (folder / "black.mkv").read_bytes(), (folder / "grey.mkv").read_bytes()


@pytest.mark.parametrize("suffix", VIDEOS)
@pytest.mark.parametrize("playlist", PLAYLISTS)
def test_a_playlist_under_the_name_of_a_video_is_not_followed(
    tmp_path: Path, contents: tuple[bytes, bytes], playlist: str, suffix: str
) -> None:
    (tmp_path / "other.mkv").write_bytes(contents[0])
    (tmp_path / f"a.{suffix}").write_text(PLAYLISTS[playlist])
    with pytest.raises(FileError, match=rf"a\.{suffix}: cannot be read as"):
        list(read_video(tmp_path / f"a.{suffix}"))


@pytest.mark.parametrize("name", ["a%d", "a*", "concat:a", "subfile,,start,1,end,9,,:a", "http://a", "-i", "|a"])
def test_no_part_of_a_name_is_taken_for_more_than_a_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, contents: tuple[bytes, bytes], name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    for other in ("a", "a0", "a1"):
        Path(f"{other}.mkv").write_bytes(contents[0])
        Path(f"{other}.exr").write_bytes(encode_exr(np.zeros((8, 8), np.float32)))
    Path(f"{name}.mkv").parent.mkdir(parents=True, exist_ok=True)
    Path(f"{name}.mkv").write_bytes(contents[1])
    Path(f"{name}.exr").write_bytes(encode_exr(np.ones((4, 6), np.float32)))
    assert np.array_equal(read_video(f"{name}.mkv").frames, np.full((5, 32, 48, 3), 200))
    assert np.array_equal(read_image(f"{name}.exr"), np.ones((4, 6)))


def test_every_file_that_ffmpeg_reads_is_named_by_one_function() -> None:
    """Other inputs are pipes, which mjrun fills, and patterns that ffmpeg makes itself."""
    inputs = [
        match[1]
        for path in Path(mjrun.__file__).parent.rglob("*.py")
        for match in re.finditer(r'"-i",\s*([^,)]+)', path.read_text())
    ]
    assert {each for each in inputs if "pipe:" not in each} == {"name", '"color=size=64x64:rate=30"'}


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
