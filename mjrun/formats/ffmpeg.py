"""The bundled ffmpeg: its command line, its version, and the codecs that work."""

import os
import subprocess
from concurrent.futures import ThreadPoolExecutor

import imageio_ffmpeg

from mjrun.errors import EncoderError
from mjrun.formats.codecs import CODECS


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


def encoder_version() -> str:
    """The version of the bundled ffmpeg.

    Raises:
      EncoderError: it cannot be run.
    """
    done = subprocess.run(command("-version"), capture_output=True, text=True, stdin=subprocess.DEVNULL)
    return done.stdout.removeprefix("ffmpeg version ").split(" ")[0]


def working_codecs() -> dict[str, bool]:
    """Every codec that mjrun knows, and whether one frame could be encoded with it."""
    frame = ("-f", "lavfi", "-i", "color=size=64x64:rate=30", "-frames:v", "1")

    def works(codec: str) -> bool:
        line = command(*frame, *CODECS[codec].arguments, "-f", "null", "-")
        return subprocess.run(line, capture_output=True, stdin=subprocess.DEVNULL).returncode == 0

    with ThreadPoolExecutor() as pool:
        return dict(zip(CODECS, pool.map(works, CODECS), strict=True))
