"""The bundled ffmpeg: its command line and version, the codecs that work, and the encoders.

Frames become one verified and published video, or a stream of H.264.
"""

import math
import os
import re
import signal
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Self, cast

import imageio_ffmpeg
import numpy as np

from mjrun.child_process import IDLE, ChildProcess, ExitStatus
from mjrun.confinement.confinement import confinement
from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, ClosedPipeError, EncoderError, FileError, UsageError, clean, option
from mjrun.formats.codecs import CODECS, CONTAINERS, GRAY16, RGB24, VideoEncoding, container_name, encoding, is_folder
from mjrun.formats.output_writer import (
    Destination,
    OutputWriter,
    StagedFile,
    StagedFrameFolder,
    StagedFramePattern,
    StandardOutput,
    no_space,
)
from mjrun.options.kinds import PathKind
from mjrun.options.option import converted, options_of
from mjrun.options.video import FPS, VideoOptions
from mjrun.timeline import rational

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
    # -framerate would be replaced by a common rate near it: 125 by 120 in a short video.
    return ["-f", "rawvideo", "-pix_fmt", pixel_format, "-s", f"{width}x{height}", "-r", str(fps)]


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


LONGEST_ARGUMENT = 100_000  # bytes; Linux allows 128 KiB


def write_video(
    path: str | Path,
    frames: Iterable[np.ndarray],
    fps: float | str | Fraction = FPS,
    *,
    codec: str | None = None,
    crf: int | None = None,
    preset: str | None = None,
    format: str | None = None,  # noqa: A002  (the option's name)
) -> list[Path]:
    """Encodes frames into a video, which appears whole and verified, or not.

    Frames are encoded as the iterable yields them, so memory does not grow with the video. Codecs that subsample colour
    pad odd sides by one pixel.

    Args:
      path: a .mp4, .mov, .mkv, .webm, .gif, .apng or .webp file; a folder or a pattern such as `frame_%04d.png` for
        PNGs.
      frames: arrays of one shape: colours `(height, width, 3)` uint8, grey `(height, width)` uint8, or numbers such
        as millimetres `(height, width)` uint16, which .mkv and PNG hold without loss.
      fps: frames per second; `"30000/1001"` is exact.
      codec, crf, preset: as in `mjrun video`; the defaults depend on the format.
      format: container, if the suffix of `path` does not specify it.

    Returns:
      The files of the video.

    Raises:
      ValueError: there are no frames, or one differs from the first; the message names it.
      UsageError: an argument has the wrong type, the format cannot hold these frames, or the options do not fit
        together.
      FileError: the video cannot be written.
      EncoderError: the encoder failed.
    """
    output = converted("path", PathKind(written=True, stored=True, streamed=True), path)
    kinds, rate = {each.name: each.kind for each in options_of(VideoOptions)}, _rate(fps)
    given = {"format": format, "codec": codec, "crf": crf, "preset": preset}
    values = [value if value is None else converted(name, kinds[name], value) for name, value in given.items()]
    format, codec, crf, preset = values  # noqa: A001
    if not isinstance(cast("object", frames), Iterable):
        raise BadValueError("frames", type(frames).__name__, "an iterable of arrays")
    container_name(output, format)  # fails before the first frame is drawn
    checked = _checked(frames)
    first = next(checked, None)
    if first is None:
        raise ValueError("there are no frames")

    content = "exact" if first.dtype == np.uint16 else "video"
    how = encoding(output, format, codec, crf, preset, content)
    with VideoWriter(output, how, (first.shape[1], first.shape[0]), rate) as writer:
        writer.write(first)
        for frame in checked:
            writer.write(frame)
        writer.count = writer.written
        return writer.publish()


class VideoWriter(OutputWriter):
    """A writer that streams frames to the encoder; nothing is published until all of them are written.

    Opening it checks that the output can be written.

    Args:
      output: a file, a folder of frames, a pattern such as `frame_%04d.png`, or None for stdout.
      size: width and height of the frames [pixels].
      count: expected number of frames; if it is not known yet, set it before `finish`.
      tags: title and comment, embedded where the format can hold them.

    Raises:
      FileError: the output cannot be written.
      UsageError: the format cannot hold this.
    """

    def __init__(
        self,
        output: str | None,
        encoding: VideoEncoding,
        size: tuple[int, int],
        fps: Fraction,
        count: int | None = None,
        tags: Mapping[str, str] | None = None,
    ) -> None:
        encoding.check_size(*size)
        encoding.check_fps(fps)
        self.size = size
        self.fps = fps
        self.count = count
        self.written = 0
        self._encoding = encoding
        super().__init__(_destination(output, encoding))
        with self.opening():
            self._child = self.resources.enter_context(self._start(tags or {}))

    def write(self, frame: np.ndarray) -> None:
        """Adds one frame: uint8 `(height, width, 3)`, or uint16 `(height, width)` where numbers are encoded.

        Raises:
          EncoderError: the encoder died or hangs; the message ends with the last lines of its log.
          FileError: the disk is full.
          ClosedPipeError: the reader of standard output closed the pipe.
        """
        width, height = self.size
        numbers = self._encoding.pixel_format == GRAY16
        shape, kind = ((height, width), np.uint16) if numbers else ((height, width, 3), np.uint8)
        if frame.shape != shape or frame.dtype != kind:
            raise ValueError(f"a frame must be {np.dtype(kind)} {shape}, not {frame.dtype} {frame.shape}")
        try:
            self._child.feed(np.ascontiguousarray(frame).data, IDLE)
        except OSError:
            raise self._failure() from None
        self.written += 1

    def end(self) -> None:
        """Waits until the encoder has written the last frame.

        Raises:
          EncoderError: it failed or hangs.
        """
        self._child.end_feeding()
        if self._child.wait(idle=IDLE).code != 0:
            raise self._failure()

    def finish(self) -> None:
        self.end()
        self._check()
        super().finish()

    def _start(self, tags: Mapping[str, str]) -> ChildProcess:
        frames = [*raw_frames(self._encoding.pixel_format, self.size, self.fps), "-i", "pipe:0"]
        # The system limits command lines: longer tags go through an unnamed file beside the output.
        length = max((len(os.fsencode(text)) for text in tags.values()), default=0)
        metadata = [part for name, text in tags.items() for part in ("-metadata", f"{name}={text}")]
        if length <= LONGEST_ARGUMENT:
            return self._spawn(frames, metadata)
        folder = None if self.destination.stdout is not None else Path(self.destination.path).parent
        with tempfile.TemporaryFile(dir=folder) as file:
            # https://ffmpeg.org/ffmpeg-formats.html#Metadata-2
            lines = [name + "=" + re.sub(r"([=;#\\\n])", r"\\\1", text) for name, text in tags.items()]
            file.write(os.fsencode("\n".join([";FFMETADATA1", *lines, ""])))
            file.seek(0)
            tagged = ["-f", "ffmetadata", "-i", f"pipe:{file.fileno()}"]
            return self._spawn([*frames, *tagged], ["-map", "0:v", "-map_metadata", "1"], file.fileno())

    def _spawn(self, inputs: Sequence[str], metadata: Sequence[str], *inherited: int) -> ChildProcess:
        stdout = self.destination.stdout
        encoding = self._encoding.arguments(*self.size, to_pipe=stdout is not None)
        return ChildProcess(
            command("-y", *inputs, *encoding, *metadata, self.destination.path),
            inherited=inherited,
            fed=True,
            stdout="discard" if stdout is None else stdout,
            stderr="capture",
        )

    def _failure(self) -> BaseException:
        """Returns the error of an encoder that has stopped reading."""
        status = self._child.wait(LAST_WORDS)
        if isinstance(self.destination, StandardOutput) and self.destination.reader_is_gone():
            return ClosedPipeError()
        self._require_folder()
        log = self._child.stderr.decode(errors="replace")
        if no_space(log):
            return FileError(self.destination.shown, "cannot be written: the disk is full")
        if status.signal == "SIGXFSZ":
            if confinement():  # the limit is that of the command, which ends as if it had written the file itself
                signal.raise_signal(signal.Signals[status.signal])
            return FileError(self.destination.shown, "cannot be written: it exceeds the limit for files (ulimit -f)")
        is_known = status.cause == "idle" or (status.cause is None and status.signal)
        how = str(status) if is_known else "failed"
        return self._error(f"the encoder {how} after {self.written} of {self.count} frames", log)

    def _require_folder(self) -> None:
        """Raises FileError if the folder of the output has been removed."""
        path = self.destination.path % 0 if self._encoding.format == "png" else self.destination.path
        if self.destination.stdout is None and not Path(path).parent.is_dir():
            raise FileError(self.destination.shown, "cannot be written: its folder was removed while it was written")

    def _check(self) -> None:
        self._require_folder()
        if self.written != self.count:
            raise self._error(f"the video has {self.written} frames, expected {self.count}")
        if isinstance(self.destination, StandardOutput):
            return
        if self._encoding.format == "png":
            count = len(list(Path(self.destination.path % 0).parent.iterdir()))
        elif self._encoding.format == "rgb":  # raw pixels, which nothing can demux
            width, height = self.size
            count = Path(self.destination.path).stat().st_size // (3 * width * height)
        else:
            count = self._frames_in_file()
        if count != self.count:
            raise self._error(f"the encoder wrote {count} frames, expected {self.count}")

    def _error(self, what: str, log: str = "") -> EncoderError:
        return EncoderError(f"{clean(str(self.destination.shown))}: {what}", log)

    def _frames_in_file(self) -> int:
        """Returns the number of frames that a demuxer counts; if the format merges equal frames, from the duration."""
        copy = ("-map", "0:v:0", "-c", "copy", "-progress", "pipe:1", "-f", "null", "-")
        options, name = source(self.destination.path, self._encoding.format)
        done = run(*options, "-i", name, *copy)
        report = done.stdout.decode(errors="replace")
        frames = re.findall(r"^frame=(\d+)", report, re.MULTILINE)
        if not done.is_good or not frames:
            raise self._error("the video cannot be read back", done.log)
        count = int(frames[-1])
        if CONTAINERS[self._encoding.format].merges:
            if count == 1:  # nothing moved: a single frame, which has no duration
                return self.written
            lasts = re.findall(r"^out_time_us=(\d+)", report, re.MULTILINE)
            return round(Fraction(int(lasts[-1]), 10**6) * self.fps)
        return count


def _rate(fps: float | str | Fraction) -> Fraction:
    try:
        rate = rational(fps)
    except (TypeError, ValueError):
        rate = Fraction(0)
    if rate <= 0:
        raise BadValueError(option("fps"), fps, "a positive number")
    return rate


def _checked(frames: Iterable[np.ndarray]) -> Iterator[np.ndarray]:
    """Yields the frames, grey ones as colours, and checks that all are like the first."""
    like = ""
    for index, frame in enumerate(frames):
        kind = f"{frame.dtype} {frame.shape}" if isinstance(frame, np.ndarray) else type(frame).__name__
        layout = (frame.dtype, frame.ndim, frame.shape[2:]) if isinstance(frame, np.ndarray) else ()
        if layout not in ((np.uint8, 3, (3,)), (np.uint8, 2, ()), (np.uint16, 2, ())):
            expected = "uint8 (height, width, 3), uint8 (height, width) or uint16 (height, width)"
            raise ValueError(f"frame {index} is {kind}, not {expected}")
        like = like or kind
        if kind != like:
            raise ValueError(f"frame {index} is {kind}, but frame 0 is {like}")
        yield np.repeat(frame[..., None], 3, axis=2) if frame.dtype == np.uint8 and frame.ndim == 2 else frame


def _destination(output: str | None, encoding: VideoEncoding) -> Destination:
    if output is None:
        return StandardOutput()
    if encoding.format != "png":
        return StagedFile(Path(output))
    if is_folder(output):
        return StagedFrameFolder(Path(output))
    if len(re.findall(r"%\d*d", Path(output).name)) != 1:
        hint = "PNG frames need a number in their name, as in frame_%04d.png, or a folder, as in frames/"
        raise UsageError(f"{clean(output)}: {hint}", path=("output",))
    return StagedFramePattern(Path(output))
