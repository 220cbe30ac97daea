"""Video containers and codecs: one table of each, and the encoder arguments that follow from them."""

import os
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean, concerning, option
from mjrun.options.video import FPS, GIF_FPS

# Untagged colour shifts hue: players guess. This is the transform for BT.709 and the tags that say so.
BT709 = (
    "scale=out_color_matrix=bt709:out_range=tv,format={pixels},"
    "setparams=colorspace=bt709:color_primaries=bt709:color_trc=bt709:range=tv"
)
# A palette per frame: one for the whole video would need all of it in memory.
PALETTE = "split[a][b];[a]palettegen=stats_mode=single[p];[b][p]paletteuse=new=1:dither=bayer:bayer_scale=4"
RGB24, GRAY16 = "rgb24", "gray16le"  # pixel formats of the frames that the encoder reads
X264_PRESETS = (
    "ultrafast superfast veryfast faster fast medium slow slower veryslow placebo".split()  # noqa: SIM905
)


@dataclass(frozen=True)
class Codec:
    """A codec, and the arguments of ffmpeg that select it.

    Attributes:
      arguments: arguments of the encoder, except its quality.
      filters: filter graph.
      even: whether width and height must be even.
      crf: lowest, highest and default constant rate factor, lower is better; None if the codec does not support it.
      presets, preset: names or numbers from fast to thorough, and the default.
      preset_flag: argument that sets the preset.
      pixel_format: pixel format of its frames, `RGB24` or `GRAY16`.
    """

    arguments: Sequence[str]
    filters: str = ""
    even: bool = False
    crf: tuple[int, int, int] | None = None
    presets: Sequence[str] = ()
    preset: str = ""
    preset_flag: str = "-preset"
    pixel_format: str = RGB24


CODECS = {
    "h264": Codec(("-c:v", "libx264"), BT709.format(pixels="yuv420p"), True, (0, 51, 18), X264_PRESETS, "veryfast"),
    "h265": Codec(
        ("-c:v", "libx265", "-x265-params", "log-level=error"),
        BT709.format(pixels="yuv420p"),
        True,
        (0, 51, 20),
        X264_PRESETS,
        "veryfast",
    ),
    "av1": Codec(("-c:v", "libsvtav1"), BT709.format(pixels="yuv420p"), True, (0, 63, 26), [*map(str, range(14))], "8"),
    "vp9": Codec(
        ("-c:v", "libvpx-vp9", "-b:v", "0", "-row-mt", "1", "-cpu-used", "4"),
        BT709.format(pixels="yuv420p"),
        True,
        (0, 63, 26),
        ("realtime", "good", "best"),
        "good",
        "-deadline",
    ),
    "prores": Codec(
        ("-c:v", "prores_ks"),
        BT709.format(pixels="yuv422p10le"),
        True,
        None,
        ("proxy", "lt", "standard", "hq"),
        "hq",
        "-profile:v",
    ),
    "h264rgb": Codec(("-c:v", "libx264rgb", "-crf", "0"), presets=X264_PRESETS, preset="veryfast"),
    "ffv1": Codec(("-c:v", "ffv1", "-pix_fmt", "bgr0")),
    "ffv1-gray16": Codec(("-c:v", "ffv1", "-pix_fmt", "gray16le"), pixel_format=GRAY16),
    "gif": Codec(("-c:v", "gif"), PALETTE),
    "apng": Codec(("-c:v", "apng", "-pix_fmt", "rgb24")),
    "webp": Codec(("-c:v", "libwebp_anim", "-quality", "90")),
    "png": Codec(("-c:v", "png", "-pix_fmt", "rgb24")),
    "png-gray16": Codec(("-c:v", "png", "-pix_fmt", "gray16be"), pixel_format=GRAY16),
    "raw": Codec(("-c:v", "rawvideo", "-pix_fmt", "rgb24")),
}


@dataclass(frozen=True)
class Container:
    """A video container; its suffix is its name.

    Attributes:
      muxer: name in ffmpeg.
      demuxers: names in ffmpeg of what reads a file of it; empty if it is not one file, or has no header.
      codecs: codecs that it can hold, the default first.
      file, pipe: further arguments for writing to a file, or to a pipe; None if it cannot be piped.
      merges: whether it merges equal frames, so that only its duration can be checked.
    """

    muxer: str
    demuxers: str
    codecs: Sequence[str]
    file: Sequence[str] = ()
    pipe: Sequence[str] | None = ()
    merges: bool = False


FAST_START = ("-movflags", "+faststart")
REPEATABLE = ("-fflags", "+bitexact")  # Matroska has random ids otherwise
# A fragment per second, for players. The header follows the first, as the video would start late by its B-frames.
FRAGMENTED = ("-movflags", "frag_keyframe+empty_moov+delay_moov+default_base_moof", "-frag_duration", "1000000")
# Delimiters show where each access unit begins.
ANNEX_B = ("-aud", "1", "-x264-params", "repeat-headers=1", "-fps_mode", "passthrough", "-f", "h264")

CONTAINERS = {
    "mp4": Container("mp4", "mov", ("h264", "h265", "av1", "h264rgb"), FAST_START, FRAGMENTED),
    "mov": Container("mov", "mov", ("h264", "h265", "prores", "h264rgb"), FAST_START, FRAGMENTED),
    "mkv": Container(
        "matroska",
        "matroska",
        ("h264", "h265", "av1", "vp9", "h264rgb", "ffv1", "ffv1-gray16"),
        REPEATABLE,
        REPEATABLE,
    ),
    "webm": Container("webm", "matroska", ("vp9", "av1"), REPEATABLE, REPEATABLE),
    "gif": Container("gif", "gif", ("gif",), ("-loop", "0"), ("-loop", "0")),
    "apng": Container("apng", "apng", ("apng",), ("-plays", "0"), ("-plays", "0")),
    # An animation without movement is an image.
    "webp": Container("webp", "webp_anim,webp_pipe", ("webp",), ("-loop", "0"), ("-loop", "0"), merges=True),
    "png": Container("image2", "", ("png", "png-gray16"), ("-start_number", "0"), None),
    "rgb": Container("rawvideo", "", ("raw",)),
}
VIDEO_SUFFIXES = tuple(f".{name}" for name, known in CONTAINERS.items() if known.demuxers)  # of one file each
# Lossless codecs, which keep the colours of a segmentation; and codecs for numbers of 16 bits.
LOSSLESS = ("h264rgb", "ffv1", "apng", "png", "raw")
EXACT = ("ffv1-gray16", "png-gray16")
CONTENT_NAMES = {"ids": "the colours of a segmentation without loss", "exact": "numbers of 16 bits"}
CONTENTS = {"video": tuple(codec for codec in CODECS if codec not in EXACT), "ids": LOSSLESS, "exact": EXACT}
# The most frames per second of formats and codecs, and the words before it.
MOST_FPS = {
    "webp": (90, "in a WebP, whose frames last 11 ms or more: at most"),  # readers take 10 ms or less for 100 ms
    "av1": (240, "with AV1, whose encoder takes at most"),
    "mkv": (1000, "in mkv, whose times are milliseconds: at most"),
    "webm": (1000, "in webm, whose times are milliseconds: at most"),
    "apng": (65535, "in an APNG: at most"),  # a delay is a quotient of 16-bit numbers
}
GIF_DELAY = Fraction(65535, 100)  # [s]; a delay is 16 bits of hundredths
SMALLEST = 16  # smallest width and height [pixels]; below it some encoders fail
SLOWEST, FASTEST = Fraction(1, 1000), 1_000_000  # frames per second that ffmpeg and every container support


@dataclass(frozen=True)
class VideoEncoding:
    """A valid combination of a container, a codec and its quality.

    Attributes:
      keyframe_every: frames from one keyframe to the next, of a video whose frames are read in any order: it has no
        B-frames, so that frames are stored in their order of display. None leaves both to the codec.
      alone: whether one thread encodes, so that many videos are encoded side by side, and their bytes do not depend on
        the number of cores.
    """

    format: str
    codec: str
    crf: int | None
    preset: str | None
    keyframe_every: int | None = None
    alone: bool = False

    @property
    def pixel_format(self) -> str:
        """The pixel format of frames: `RGB24`, uint8 `(h, w, 3)`, or `GRAY16`, uint16 `(h, w)`."""
        return CODECS[self.codec].pixel_format

    @property
    def fps(self) -> Fraction:
        """The default frames per second."""
        return GIF_FPS if self.format == "gif" else FPS

    def check_fps(self, fps: Fraction) -> None:
        """Raises BadValueError if the format does not support this rate."""
        if not SLOWEST <= fps <= FASTEST:
            raise BadValueError(option("fps"), f"{float(fps):g}", f"between {float(SLOWEST):g} and {FASTEST:,}")
        for name in (self.codec, self.format):
            most, words = MOST_FPS.get(name, (FASTEST, ""))
            if fps > most:
                raise BadValueError(option("fps"), fps, f"possible {words} {most:,}")
        if self.format == "gif" and 1 / fps > GIF_DELAY:
            delay = f"{float(GIF_DELAY):g} s"
            raise BadValueError(option("fps"), fps, f"possible in a GIF, whose frames last {delay} or less")
        if self.format == "gif" and ((100 / fps).denominator != 1 or fps > 50):
            raise BadValueError(
                option("fps"), fps, "possible in a GIF, whose delays are hundredths: 50, 100/3, 25, 20, 10"
            )

    def check_size(self, width: int, height: int) -> None:
        """Raises BadValueError if the encoder does not support frames of this size."""
        if min(width, height) < SMALLEST:
            raise BadValueError(option("size"), f"{width}x{height}", f"at least {SMALLEST}x{SMALLEST}")

    def padding(self, width: int, height: int) -> tuple[int, int]:
        """Returns the number of columns and rows that the codec needs in addition to the frame."""
        return (width % 2, height % 2) if CODECS[self.codec].even else (0, 0)

    def arguments(self, width: int, height: int, to_pipe: bool) -> list[str]:
        """Returns the arguments of ffmpeg between its input and its output."""
        kind = CONTAINERS[self.format]
        extra = (kind.pipe if to_pipe else kind.file) or ()
        # Apple's players recognize HEVC by this tag only.
        tag = ["-tag:v", "hvc1"] if self.codec == "h265" and self.format in ("mp4", "mov") else []
        return [*self._of_codec(width, height), *tag, *extra, "-f", kind.muxer]

    def annex_b_arguments(self, width: int, height: int) -> list[str]:
        """Returns the arguments for a stream of H.264 in Annex B instead of a container.

        An access unit begins with a delimiter, and that of a keyframe contains its parameter sets.
        """
        return [*self._of_codec(width, height), *ANNEX_B]

    def _of_codec(self, width: int, height: int) -> list[str]:
        codec = CODECS[self.codec]
        filters = [_pad(width, height, *self.padding(width, height)), codec.filters]
        graph = ",".join(filter(None, filters))
        quality = ["-crf", str(self.crf)] if self.crf is not None else []
        effort = [codec.preset_flag, self.preset] if self.preset is not None else []
        return [*(["-vf", graph] if graph else []), *codec.arguments, *quality, *effort, *self._order, *self._threads]

    @property
    def _threads(self) -> list[str]:
        """The arguments that determine the number of threads, on which the bytes of AV1 do not depend."""
        return ["-threads", "1"] if self.alone and self.codec != "av1" else []

    @property
    def _order(self) -> list[str]:
        """The arguments that determine keyframes and the order of frames."""
        if self.keyframe_every is None:
            return []
        every = ["-g", str(self.keyframe_every), "-write_btrt", "0"]  # a bit rate would distinguish equal codecs
        match self.codec:
            case "h264" | "h264rgb":
                return [*every, "-bf", "0"]
            case "h265":
                threads = ":pools=1:frame-threads=1" if self.alone else ""
                return [*every, "-x265-params", f"log-level=error:bframes=0{threads}"]
            case _:
                return every


def encoding(
    output: str | None,
    format: str | None = None,  # noqa: A002  (the word users know)
    codec: str | None = None,
    crf: int | None = None,
    preset: str | None = None,
    content: str = "video",
) -> VideoEncoding:
    """Returns the encoding that the suffix of an output and the options mean; `output` None is a pipe.

    Args:
      content: `video`, for viewing; `ids`, colours that must be lossless unless a codec is specified; `exact`, numbers
        of 16 bits.

    Raises:
      UsageError: they do not fit together; the message lists the valid values.
    """
    name = container_name(output, format)
    if output is None and CONTAINERS[name].pipe is None:
        raise UsageError(f"{option('format')} {name} cannot be written to a pipe")
    accepts_loss = content == "ids" and codec is not None  # the user accepts changes of the colours
    holds = [held for held in CONTAINERS[name].codecs if held in CONTENTS["video" if accepts_loss else content]]
    if not holds:
        able = [other for other, known in CONTAINERS.items() if set(known.codecs) & set(CONTENTS[content])]
        lossy = f"or set {option('codec')}, and accept the loss"
        instead = lossy if content == "ids" else f"or set {option('style')} to color"
        raise UsageError(f"{name} cannot hold {CONTENT_NAMES[content]}\n{', '.join(able)} can; {instead}")
    if codec is not None and codec not in holds:
        with concerning("codec"):
            raise UnknownNameError("codec", codec, holds, where=name)
    chosen = codec or holds[0]
    known = CODECS[chosen]
    if crf is not None and known.crf is None:
        raise UsageError(f"{option('crf')}: {chosen} does not support a constant rate factor")
    if crf is not None and known.crf and not known.crf[0] <= crf <= known.crf[1]:
        raise BadValueError(option("crf"), crf, f"from {known.crf[0]} (best) to {known.crf[1]}, as {chosen} takes")
    if preset is not None and preset not in known.presets:
        with concerning("preset"):
            raise UnknownNameError("preset", preset, known.presets, where=f"codec {chosen}")
    default_crf = known.crf[2] if known.crf else None
    return VideoEncoding(name, chosen, default_crf if crf is None else crf, preset or known.preset or None)


def is_folder(output: str) -> bool:
    """Returns whether `output` means a folder of frames: it ends in `/`, is a folder, or has no suffix."""
    return output.endswith("/") or os.path.isdir(output) or not Path(output).suffix  # noqa: PTH112 also of names that are too long


def suffixes() -> list[str]:
    """Returns the suffixes of videos; `.png` is the suffix of frames in separate files."""
    return [f".{name}" for name in CONTAINERS]


def container_name(output: str | None, format: str | None) -> str:  # noqa: A002  (the option's name)
    """Returns the container that the suffix of an output or the option format means; `output` None is a pipe.

    Raises:
      UsageError: the container is unknown, or the two disagree.
    """
    if format is not None and format not in CONTAINERS:
        with concerning("format"):
            raise UnknownNameError("format", format, list(CONTAINERS))
    if output is None:
        return format or "mp4"
    suffix = "png" if is_folder(output) else Path(output).suffix.lower().removeprefix(".")
    if suffix not in CONTAINERS:
        if format:
            return format
        with concerning("output"):
            raise UnknownNameError("video format", f".{suffix}", suffixes(), where=output)
    if format not in (None, suffix):
        raise UsageError(f"{option('format')} {format} and the suffix of {clean(output)} disagree")
    return suffix


def _pad(width: int, height: int, columns: int, rows: int) -> str:
    if not (columns or rows):
        return ""
    # The last column and row are repeated: a black edge would be visible.
    return f"pad={width + columns}:{height + rows},fillborders=right={columns}:bottom={rows}:mode=smear"
