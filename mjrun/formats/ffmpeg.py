"""The bundled ffmpeg: its command line, its version, the codecs that work, and an encoder of streams of H.264."""

import math
import os
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Self

import imageio_ffmpeg
import numpy as np

from mjrun.child_process import IDLE, ChildProcess, ExitStatus
from mjrun.dataclass import dataclass
from mjrun.errors import EncoderError
from mjrun.formats.codecs import CODECS, CONTAINERS, RGB24, encoding

DELIMITER = b"\0\0\0\1\x09"  # a NAL unit of type 9 begins each access unit of H.264; ITU-T H.264, 7.4.1.2.3
LAST_WORDS = 1.0  # time for an encoder that stopped reading to end by itself [s]
# Demuxers by suffix: ffmpeg would otherwise choose one by the content, and a playlist refers to other files.
DEMUXERS = {name: known.demuxers for name, known in CONTAINERS.items() if known.demuxers} | {"exr": "exr_pipe"}


@dataclass(frozen=True)
class FfmpegResult:
    """The result of a run of ffmpeg: its exit status, its standard output and its log."""

    status: ExitStatus
    stdout: bytes
    log: str

    @property
    def is_good(self) -> bool:
        return self.status.code == 0


def command(*arguments: str) -> list[str]:
    """Returns a command line of the bundled ffmpeg.

    Raises:
      EncoderError: ffmpeg is missing, or cannot be executed.
    """
    try:
        program = imageio_ffmpeg.get_ffmpeg_exe()
        if not os.access(program, os.X_OK):
            raise RuntimeError(f"{program} cannot be executed")
    except RuntimeError as error:
        raise EncoderError("ffmpeg cannot be run; reinstall imageio-ffmpeg", str(error)) from None
    return [program, "-hide_banner", "-nostdin", "-loglevel", "warning", *arguments]


def source(path: str | Path, suffix: str) -> tuple[list[str], str]:
    """Returns the options before `-i` and the name after it with which ffmpeg reads one file and nothing else.

    Args:
      suffix: suffix of the format, without a dot, one of `DEMUXERS`; the name of the file may differ.
    """
    demuxers = DEMUXERS[suffix]
    forced = [] if "," in demuxers else ["-f", demuxers]
    return ["-protocol_whitelist", "file", "-format_whitelist", demuxers, *forced], f"file:{path}"


def raw_frames(pixel_format: str, size: tuple[int, int], fps: Fraction) -> list[str]:
    """Returns the arguments before `-i` that describe frames without a header, in a pixel format of `codecs`."""
    width, height = size
    return ["-f", "rawvideo", "-pix_fmt", pixel_format, "-s", f"{width}x{height}", "-framerate", str(fps)]


def run(*arguments: str) -> FfmpegResult:
    """Runs the bundled ffmpeg without feeding it.

    Raises:
      EncoderError: ffmpeg is missing, or cannot be executed.
    """
    with ChildProcess(command(*arguments), stdout="capture", stderr="capture", stdout_limit=math.inf) as child:
        status = child.wait(idle=IDLE)
        return FfmpegResult(status, child.stdout, child.stderr.decode(errors="replace"))


def encoder_version() -> str:
    """Returns the version of the bundled ffmpeg.

    Raises:
      EncoderError: it cannot be executed.
    """
    return run("-version").stdout.decode(errors="replace").removeprefix("ffmpeg version ").split(" ")[0]


def working_codecs() -> dict[str, bool]:
    """Returns for every codec of mjrun whether it encodes a frame."""
    from concurrent.futures import ThreadPoolExecutor

    frame = ("-f", "lavfi", "-i", "color=size=64x64:rate=30", "-frames:v", "1")

    def works(codec: str) -> bool:
        return run(*frame, *CODECS[codec].arguments, "-f", "null", "-").is_good

    with ThreadPoolExecutor() as pool:
        return dict(zip(CODECS, pool.map(works, CODECS), strict=True))


class H264Encoder:
    """A running encoder of H.264, which returns the access unit of each frame some frames later.

    An access unit is in the format of Annex B. A keyframe, at least one per second of video, contains the parameter
    sets; there are no B-frames. Odd sides are padded by one pixel. To be closed.

    Args:
      size: width and height of the frames [pixels].
      fps: frames per second of the video.

    Raises:
      EncoderError: ffmpeg is missing.
      OSError: the system refuses to start it.
    """

    def __init__(self, size: tuple[int, int], fps: Fraction) -> None:
        self.size = size
        self._written = self._returned = 0
        self._rest = b""  # the beginning of the next access unit
        width, height = size
        chosen = encoding(None, "mp4", "h264")
        self._encoding = replace(chosen, keyframe_every=max(1, math.floor(fps)))
        arguments = self._encoding.annex_b_arguments(width, height)
        encoder = command(*raw_frames(RGB24, size, fps), "-i", "pipe:0", *arguments, "-flush_packets", "1", "pipe:1")
        self._child = ChildProcess(encoder, fed=True, stdout="capture", stderr="capture", stdout_limit=math.inf)

    def write(self, frame: np.ndarray) -> list[bytes]:
        """Adds a frame, `(height, width, 3)` uint8, and returns the access units that are complete, in order.

        Raises:
          EncoderError: the encoder died or hangs.
        """
        width, height = self.size
        if frame.shape != (height, width, 3) or frame.dtype != np.uint8:
            raise ValueError(f"a frame must be uint8 {(height, width, 3)}, not {frame.dtype} {frame.shape}")
        try:
            self._child.feed(np.ascontiguousarray(frame).data, IDLE)
        except OSError:
            self._child.wait(LAST_WORDS)
            raise self._failure(f"stopped after {self._written} frames") from None
        self._written += 1
        return self._complete(self._child.take_stdout(), at_end=False)

    def end(self) -> list[bytes]:
        """Returns the remaining access units after the last frame.

        Raises:
          EncoderError: the encoder failed, or did not return an access unit for each frame.
        """
        self._child.end_feeding()
        status = self._child.wait(idle=IDLE)
        if status.code != 0:
            raise self._failure(f"{status} after {self._written} frames")
        units = self._complete(self._child.take_stdout(), at_end=True)
        if self._returned != self._written:
            raise self._failure(f"returned {self._returned} of {self._written} frames")
        return units

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the encoder."""
        self._child.end()

    def _complete(self, content: bytes, at_end: bool) -> list[bytes]:
        """Splits what the encoder returned; an access unit is complete when the next one begins, or at the end."""
        start, *rest = (self._rest + content).split(DELIMITER)
        units = [DELIMITER + unit for unit in rest]
        self._rest = b"" if at_end else units.pop() if units else start
        self._returned += len(units)
        return units

    def _failure(self, what: str) -> EncoderError:
        return EncoderError(f"the H.264 encoder {what}", self._child.stderr.decode(errors="replace"))
