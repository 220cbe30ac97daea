"""The bundled ffmpeg: its command line, what it answers, its version, and the codecs that work."""

import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import imageio_ffmpeg

from mjrun.child_process import ChildProcess, ExitStatus
from mjrun.errors import EncoderError
from mjrun.formats.codecs import CODECS

# [s] for which ffmpeg may take nothing and compute nothing, before it counts as hanging: a slow disk or a busy machine
# makes it slow, but not still.
IDLE = 60.0
# What reads a file, by its suffix: ffmpeg goes by the content otherwise, and that of a playlist names other files.
DEMUXERS = {
    "mp4": "mov",
    "mov": "mov",
    "mkv": "matroska",
    "webm": "matroska",
    "gif": "gif",
    "apng": "apng",
    "webp": "webp_anim,webp_pipe",  # without movement it becomes an image
    "exr": "exr_pipe",
}


@dataclass(frozen=True)
class Answer:
    """What a run of ffmpeg came to, its standard output and what it has said."""

    status: ExitStatus
    stdout: bytes
    log: str

    @property
    def is_good(self) -> bool:
        return self.status.code == 0


def command(*arguments: str) -> list[str]:
    """A command line of the bundled ffmpeg.

    Raises:
      EncoderError: there is none, or it cannot be run.
    """
    try:
        program = imageio_ffmpeg.get_ffmpeg_exe()
        if not os.access(program, os.X_OK):
            raise RuntimeError(f"{program} cannot be executed")
    except RuntimeError as error:
        raise EncoderError("ffmpeg cannot be run; reinstall imageio-ffmpeg", str(error)) from None
    return [program, "-hide_banner", "-nostdin", "-loglevel", "warning", *arguments]


def source(path: str | Path, suffix: str) -> tuple[list[str], str]:
    """Returns how ffmpeg reads one file and nothing else: the options before `-i`, and the name after it.

    Args:
      suffix: of the format, without a dot, whatever the file is called: one of `DEMUXERS`.
    """
    demuxers = DEMUXERS[suffix]
    forced = [] if "," in demuxers else ["-f", demuxers]
    return ["-protocol_whitelist", "file", "-format_whitelist", demuxers, *forced], f"file:{path}"


def run(*arguments: str) -> Answer:
    """Runs the bundled ffmpeg without an input of its own.

    Raises:
      EncoderError: there is none, or it cannot be run.
    """
    with ChildProcess(command(*arguments), stdout="capture", stderr="capture", stdout_limit=math.inf) as child:
        status = child.wait(idle=IDLE)
        return Answer(status, child.stdout, child.stderr.decode(errors="replace"))


def encoder_version() -> str:
    """The version of the bundled ffmpeg.

    Raises:
      EncoderError: it cannot be run.
    """
    return run("-version").stdout.decode(errors="replace").removeprefix("ffmpeg version ").split(" ")[0]


def working_codecs() -> dict[str, bool]:
    """Every codec that mjrun knows, and whether one frame could be encoded with it."""
    frame = ("-f", "lavfi", "-i", "color=size=64x64:rate=30", "-frames:v", "1")

    def works(codec: str) -> bool:
        return run(*frame, *CODECS[codec].arguments, "-f", "null", "-").is_good

    with ThreadPoolExecutor() as pool:
        return dict(zip(CODECS, pool.map(works, CODECS), strict=True))
