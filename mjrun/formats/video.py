"""Films: frames in, one checked and published film out, through the bundled ffmpeg."""

import contextlib
import os
import re
import signal
import subprocess
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path
from types import TracebackType

import imageio_ffmpeg
import numpy as np

from mjrun.errors import BadValueError, ClosedPipeError, EncoderError, FileError, UsageError
from mjrun.formats.codecs import CODECS, FORMATS, GRAY16, Encoding, is_folder
from mjrun.formats.publishing import (
    Completable,
    Destination,
    StagedFile,
    StagedFolder,
    StagedFrames,
    StandardOutput,
    no_space,
)

SMALLEST = 16  # pixels a side; below it some encoders fail
LOG_LINES = 200


class FilmWriter(Completable):
    """Streams frames to the encoder as they come; nothing is published until all are there.

    Opening it proves that the output can be written. Leave the context without `publish` and no trace
    of the film is left.

    Args:
      output: a file, a folder of frames, a pattern such as `frame_%04d.png`, or None for stdout.
      size: width and height of the frames [pixels].
      count: frames promised; set before `publish` if it is not known yet.
      tags: title and comment, embedded where the format can hold them.

    Raises:
      FileError: the output cannot be written.
      UsageError: the format cannot hold this.
    """

    def __init__(
        self,
        output: str | None,
        encoding: Encoding,
        size: tuple[int, int],
        fps: Fraction,
        count: int | None = None,
        tags: Mapping[str, str] | None = None,
    ) -> None:
        if min(size) < SMALLEST:
            raise BadValueError("--size", f"{size[0]}x{size[1]}", f"at least {SMALLEST}x{SMALLEST}")
        encoding.check_fps(fps)
        self.size, self.fps, self.count, self.written = size, fps, count, 0
        self._encoding = encoding
        self._target = _target(output, encoding)
        self._log: deque[str] = deque(maxlen=LOG_LINES)
        try:
            self._child = self._start(tags or {})
        except BaseException:
            self._target.discard()
            raise
        self._drain = threading.Thread(target=self._read_log, name="ffmpeg log", daemon=True)
        self._drain.start()

    def write(self, frame: np.ndarray) -> None:
        """Adds one frame: uint8 `(height, width, 3)`, or uint16 `(height, width)` where numbers are encoded.

        Raises:
          EncoderError: the encoder died; the message holds what it said last.
          ClosedPipeError: whoever read standard output is gone.
        """
        width, height = self.size
        numbers = self._encoding.pixels == GRAY16
        shape, kind = ((height, width), np.uint16) if numbers else ((height, width, 3), np.uint8)
        if frame.shape != shape or frame.dtype != kind:
            raise ValueError(f"a frame must be {np.dtype(kind)} {shape}, not {frame.dtype} {frame.shape}")
        assert self._child.stdin
        try:
            self._child.stdin.write(np.ascontiguousarray(frame).data)
        except OSError:
            raise self._failure() from None
        self.written += 1

    def end(self) -> None:
        """Waits until the encoder has written the last frame.

        Raises:
          EncoderError: it failed.
        """
        assert self._child.stdin
        try:
            self._child.stdin.close()
        except OSError:
            raise self._failure() from None
        if self._child.wait() != 0:
            raise self._failure()
        self._drain.join()

    def complete(self) -> None:
        self.end()
        self._check()

    def publish(self) -> list[Path]:
        """Ends the film, checks that it has every frame, puts it in its place, and says which files that is.

        Raises:
          EncoderError: the encoder failed, or frames are missing.
          FileError: the film cannot be put in its place.
        """
        self.finish()
        return self._target.publish()

    @property
    def others(self) -> Sequence[str]:
        """Frames of an older film that a pattern would take for this one's, once it is published."""
        return self._target.others if isinstance(self._target, StagedFrames) else ()

    def close(self) -> None:
        """Ends the encoder, and removes what is not published."""
        if self._child.poll() is None:
            self._child.kill()
        self._child.wait()
        self._drain.join()
        for pipe in (self._child.stdin, self._child.stderr):
            if pipe:
                with contextlib.suppress(OSError):  # frames still buffered for an encoder that is gone
                    pipe.close()
        self._target.discard()

    def __enter__(self) -> "FilmWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _start(self, tags: Mapping[str, str]) -> subprocess.Popen[bytes]:
        width, height = self.size
        source = [
            "-f",
            "rawvideo",
            "-pix_fmt",
            self._encoding.pixels,
            "-s",
            f"{width}x{height}",
            "-framerate",
            str(self.fps),
        ]
        metadata = [part for name, text in tags.items() for part in ("-metadata", f"{name}={text}")]
        return subprocess.Popen(
            [
                *_ffmpeg("-y", *source, "-i", "pipe:0"),
                *self._encoding.arguments(width, height, to_pipe=self._target.stdout is not None),
                *metadata,
                self._target.path,
            ],
            stdin=subprocess.PIPE,
            stdout=self._target.stdout if self._target.stdout is not None else subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            process_group=0,  # Ctrl-C is ours: the encoder would end the film as if it were whole
        )

    def _read_log(self) -> None:
        assert self._child.stderr
        for line in self._child.stderr:
            self._log.append(line.decode(errors="replace").rstrip())

    def _failure(self) -> BaseException:
        """What went wrong, once the encoder has stopped reading."""
        self._child.kill()
        code = self._child.wait()
        self._drain.join()
        if isinstance(self._target, StandardOutput) and self._target.reader_is_gone():
            return ClosedPipeError()
        log = "\n".join(self._log)
        if no_space(log):
            return FileError(self._target.shown, "cannot be written: the disk is full")
        how = f"was killed by {signal.Signals(-code).name}" if code < 0 and code != -signal.SIGKILL else "failed"
        return EncoderError(f"the encoder {how} after {self.written} of {self.count} frames", log)

    def _check(self) -> None:
        if self.written != self.count:
            raise EncoderError(f"the film has {self.written} frames, {self.count} were promised")
        if isinstance(self._target, StandardOutput):
            return
        if self._encoding.format == "png":
            found = len(list(Path(self._target.path).parent.iterdir()))
        elif self._encoding.format == "rgb":  # bare pixels, which nothing can demux
            width, height = self.size
            found = Path(self._target.path).stat().st_size // (3 * width * height)
        else:
            found = self._frames_in_file()
        if found != self.count:
            raise EncoderError(f"the encoder wrote {found} frames, {self.count} were promised")

    def _frames_in_file(self) -> int:
        """The frames in the film as a demuxer finds them; in a format that merges, from its duration."""
        command = _ffmpeg("-i", self._target.path, "-map", "0:v:0", "-c", "copy", "-progress", "pipe:1")
        done = subprocess.run([*command, "-f", "null", "-"], capture_output=True, stdin=subprocess.DEVNULL)
        report = done.stdout.decode(errors="replace")
        frames = re.findall(r"^frame=(\d+)", report, re.MULTILINE)
        if done.returncode or not frames:
            raise EncoderError("the film cannot be read back", done.stderr.decode(errors="replace"))
        count = int(frames[-1])
        if FORMATS[self._encoding.format].merges:
            if count == 1:  # nothing moved: a still, which has no duration
                return self.written
            lasts = re.findall(r"^out_time_us=(\d+)", report, re.MULTILINE)
            return round(Fraction(int(lasts[-1]), 10**6) * self.fps)
        return count


def encoder_version() -> str:
    """The version of the bundled ffmpeg.

    Raises:
      EncoderError: it cannot be run.
    """
    done = subprocess.run(_ffmpeg("-version"), capture_output=True, text=True, stdin=subprocess.DEVNULL)
    return done.stdout.removeprefix("ffmpeg version ").split(" ")[0]


def working_codecs() -> dict[str, bool]:
    """Every codec that mjrun knows, and whether one frame could be encoded with it."""
    frame = ("-f", "lavfi", "-i", "color=size=64x64:rate=30", "-frames:v", "1")

    def works(codec: str) -> bool:
        command = _ffmpeg(*frame, *CODECS[codec].arguments, "-f", "null", "-")
        return subprocess.run(command, capture_output=True, stdin=subprocess.DEVNULL).returncode == 0

    with ThreadPoolExecutor() as pool:
        return dict(zip(CODECS, pool.map(works, CODECS), strict=True))


def _ffmpeg(*arguments: str) -> list[str]:
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


def _target(output: str | None, encoding: Encoding) -> Destination:
    if output is None:
        return StandardOutput()
    if encoding.format != "png":
        return StagedFile(Path(output))
    if is_folder(output):
        return StagedFolder(Path(output))
    if len(re.findall(r"%\d*d", Path(output).name)) != 1:
        raise UsageError(
            f"{output}: a film of PNGs needs a number in its name, as in frame_%04d.png, or a folder, as in frames/"
        )
    return StagedFrames(Path(output))
