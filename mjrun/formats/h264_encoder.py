"""Encodes frames into a stream of H.264, whose access units, one per frame, are stored separately."""

import math
from dataclasses import replace
from fractions import Fraction
from typing import Self

import numpy as np

from mjrun.child_process import ChildProcess
from mjrun.errors import EncoderError
from mjrun.formats import ffmpeg
from mjrun.formats.codecs import RGB24, encoding

DELIMITER = b"\0\0\0\1\x09"  # a NAL unit of type 9 begins each access unit; ITU-T H.264, 7.4.1.2.3


class H264Encoder:
    """A running encoder, which returns the access unit of each frame some frames later.

    An access unit is in the format of Annex B. A keyframe, at least one per second of video, contains the parameter
    sets; there are no B-frames. Odd sides are padded by one pixel. To be closed.

    Args:
      size: width and height of the frames [pixels].
      fps: frames per second of the video.
      crf: constant rate factor; by default, that of videos.

    Raises:
      EncoderError: ffmpeg is missing.
      OSError: the system refuses to start it.
    """

    def __init__(self, size: tuple[int, int], fps: Fraction, crf: int | None = None) -> None:
        self.size = size
        self._written = self._returned = 0
        self._rest = b""  # the beginning of the next access unit
        width, height = size
        source = ["-f", "rawvideo", "-pix_fmt", RGB24, "-s", f"{width}x{height}", "-framerate", str(fps)]
        chosen = encoding(None, "mp4", "h264", crf)
        self._encoding = replace(chosen, keyframe_every=max(1, math.floor(fps)))
        arguments = self._encoding.annex_b_arguments(width, height)
        command = ffmpeg.command(*source, "-i", "pipe:0", *arguments, "-flush_packets", "1", "pipe:1")
        self._child = ChildProcess(command, fed=True, stdout="capture", stderr="capture", stdout_limit=math.inf)

    @property
    def encoded_size(self) -> tuple[int, int]:
        """Width and height of the encoded frames, padding included [pixels]."""
        width, height = self.size
        right, bottom = self._encoding.padding(width, height)
        return width + right, height + bottom

    def write(self, frame: np.ndarray) -> list[bytes]:
        """Adds a frame, `(height, width, 3)` uint8, and returns the access units that are complete, in order.

        Raises:
          EncoderError: the encoder died or hangs.
        """
        width, height = self.size
        if frame.shape != (height, width, 3) or frame.dtype != np.uint8:
            raise ValueError(f"a frame must be uint8 {(height, width, 3)}, not {frame.dtype} {frame.shape}")
        try:
            self._child.feed(np.ascontiguousarray(frame).data, ffmpeg.IDLE)
        except OSError:
            self._child.wait(ffmpeg.LAST_WORDS)
            raise self._failure(f"stopped after {self._written} frames") from None
        self._written += 1
        return self._complete(self._child.take_stdout(), at_end=False)

    def end(self) -> list[bytes]:
        """Returns the remaining access units after the last frame.

        Raises:
          EncoderError: the encoder failed, or did not return an access unit for each frame.
        """
        self._child.end_feeding()
        status = self._child.wait(idle=ffmpeg.IDLE)
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
