"""The bundled ffmpeg: its command line, its output, its version, and the codecs that work."""

import math
import os
from pathlib import Path

import imageio_ffmpeg

from mjrun.child_process import ChildProcess, ExitStatus
from mjrun.dataclass import dataclass
from mjrun.errors import EncoderError
from mjrun.formats.codecs import CODECS

IDLE = 60.0  # [s] without reading or computing after which ffmpeg counts as hanging; a busy machine only slows it down
LAST_WORDS = 1.0  # time for an encoder that stopped reading to end by itself [s]
# Demuxers by suffix: ffmpeg would otherwise choose one by the content, and a playlist refers to other files.
DEMUXERS = {
    "mp4": "mov",
    "mov": "mov",
    "mkv": "matroska",
    "webm": "matroska",
    "gif": "gif",
    "apng": "apng",
    "webp": "webp_anim,webp_pipe",  # an animation without movement is an image
    "exr": "exr_pipe",
}


@dataclass(frozen=True)
class FfmpegRun:
    """The outcome of a run of ffmpeg: its exit status, its standard output and its log."""

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


def run(*arguments: str) -> FfmpegRun:
    """Runs the bundled ffmpeg without feeding it.

    Raises:
      EncoderError: ffmpeg is missing, or cannot be executed.
    """
    with ChildProcess(command(*arguments), stdout="capture", stderr="capture", stdout_limit=math.inf) as child:
        status = child.wait(idle=IDLE)
        return FfmpegRun(status, child.stdout, child.stderr.decode(errors="replace"))


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
