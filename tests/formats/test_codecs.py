"""Which formats, codecs and qualities go together."""

import os
import subprocess
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import BadValueError, MjrunError
from mjrun.formats.codecs import CODECS, CONTAINERS, VideoEncoding, encoding, is_folder, suffixes
from mjrun.formats.ffmpeg import command
from tests.cases import cases


@cases("output, format_name, codec")
def test_the_output_s_name_chooses_the_format(output: str | None, format_name: str, codec: str) -> None:
    chosen = encoding(output)
    assert (chosen.format, chosen.codec) == (format_name, codec)


def test_every_format_holds_codecs_that_exist_and_every_codec_has_a_format() -> None:
    assert {codec for kind in CONTAINERS.values() for codec in kind.codecs} == set(CODECS)
    assert all(codec.preset in codec.presets or not codec.presets for codec in CODECS.values())
    assert all(codec.crf is None or codec.crf[0] <= codec.crf[2] <= codec.crf[1] for codec in CODECS.values())


@cases("wanted, message")
def test_what_does_not_fit_is_refused_with_what_does(wanted: dict, message: str) -> None:
    with pytest.raises(MjrunError) as caught:
        encoding(**wanted)
    assert caught.value.exit_code == 2
    assert message in str(caught.value)


def test_an_unknown_suffix_may_be_given_a_format() -> None:
    assert encoding("film.bin", "mkv") == VideoEncoding("mkv", "h264", 18, "veryfast")


@pytest.mark.parametrize("fps", [Fraction(50), Fraction(100, 3), Fraction(25), Fraction(20), Fraction(10), Fraction(1)])
def test_a_gif_keeps_rates_whose_delay_is_whole_hundredths(fps: Fraction) -> None:
    encoding("film.gif").check_fps(fps)


@pytest.mark.parametrize("fps", [Fraction(100), Fraction(60), Fraction(30), Fraction("33.3"), Fraction(15)])
def test_a_gif_refuses_rates_that_it_would_play_wrongly(fps: Fraction) -> None:
    with pytest.raises(MjrunError, match="50, 100/3, 25, 20, 10"):
        encoding("film.gif").check_fps(fps)
    encoding("film.mp4").check_fps(fps)


@pytest.mark.parametrize("fps", ["1e-300", "1/1001", "1000001", "1e300"])
@pytest.mark.parametrize("output", ["film.mp4", "frames", "film.webp"])
def test_a_rate_that_no_file_can_hold_is_refused_in_our_words(output: str, fps: str) -> None:
    with pytest.raises(BadValueError, match=r"is not between 0\.001 and 1,000,000"):
        encoding(output).check_fps(Fraction(fps))


def test_a_webp_refuses_delays_that_readers_take_for_none() -> None:
    encoding("film.webp").check_fps(Fraction(90))
    with pytest.raises(BadValueError, match="11 ms or more: at most 90"):
        encoding("film.webp").check_fps(Fraction(100))


@pytest.mark.parametrize(
    ("output", "codec", "kept", "refused", "message"),
    [
        ("film.gif", None, "1/655", "1/656", "whose frames last 655.35 s or less"),
        ("film.apng", None, "65535", "65536", "in an APNG: at most 65,535"),
        ("film.mkv", "ffv1", "1000", "1001", "in mkv, whose times are milliseconds: at most 1,000"),
        ("film.webm", "vp9", "1000", "2000", "in webm, whose times are milliseconds: at most 1,000"),
        ("film.webm", "av1", "240", "241", "with AV1, whose encoder takes at most 240"),
        ("film.mp4", "av1", "240", "250", "with AV1, whose encoder takes at most 240"),
    ],
)
def test_a_rate_beyond_the_limit_of_a_format_is_refused(
    output: str, codec: str | None, kept: str, refused: str, message: str
) -> None:
    chosen = encoding(output, codec=codec)
    chosen.check_fps(Fraction(kept))
    with pytest.raises(BadValueError, match=message):
        chosen.check_fps(Fraction(refused))


def test_the_default_rate_is_one_that_the_format_keeps() -> None:
    for name in CONTAINERS:
        chosen = encoding(None if name == "rgb" else f"film_%d.{name}", "rgb" if name == "rgb" else None)
        chosen.check_fps(chosen.fps)


def test_only_chroma_subsampled_codecs_need_even_sides() -> None:
    assert encoding("film.mp4").padding(161, 120) == (1, 0)
    assert encoding("film.webm").padding(160, 121) == (0, 1)
    assert encoding("film.gif").padding(161, 121) == (0, 0)


def test_an_existing_folder_is_a_folder_whatever_its_name(tmp_path: Path) -> None:
    (tmp_path / "take.2").mkdir()
    assert is_folder(str(tmp_path / "take.2"))
    assert not is_folder(str(tmp_path / "take.3"))


def test_a_name_that_is_too_long_is_no_folder() -> None:
    assert encoding("x" * 5000 + ".mp4").format == "mp4"


def test_suffixes_are_those_of_the_table() -> None:
    assert suffixes()[:2] == [".mp4", ".mov"]
    assert all(encoding(f"f_%d{suffix}").format == suffix[1:] for suffix in suffixes())


@pytest.mark.parametrize("codec", ["h264", pytest.param("h265", marks=pytest.mark.slow), "av1"])
def test_a_video_of_one_thread_has_the_same_bytes_on_any_number_of_cores(codec: str, tmp_path: Path) -> None:
    frames = np.random.default_rng(0).integers(0, 256, (12, 64, 96, 3), np.uint8)
    how = replace(encoding("a.mp4", codec=codec), keyframe_every=2, alone=True)
    arguments = how.arguments(96, 64, to_pipe=False)
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", "96x64", "-i", "-"]
    contents = set[bytes]()
    for cores in ({min(os.sched_getaffinity(0))}, os.sched_getaffinity(0)):
        path = tmp_path / f"{len(cores)}.mp4"
        subprocess.run(
            command("-y", *source, *arguments, str(path)),
            input=frames.tobytes(),
            check=True,
            preexec_fn=lambda cores=cores: os.sched_setaffinity(0, cores),
        )
        contents.add(path.read_bytes())
    assert len(contents) == 1
