"""The differences between two videos or images as sentences, and the limits that allow them."""

from collections.abc import Iterator

from mjrun.diff.frames import EXTRA, LIBRARY, WINDOW
from mjrun.diff.result import FrameDifference, PictureDifference
from mjrun.errors import UsageError, option
from mjrun.options.diff import PictureDiffOptions
from mjrun.packages import require


def require_library(options: PictureDiffOptions) -> None:
    """Raises MissingExtraError or WrongVersionError if a requested similarity cannot be computed."""
    if options.min_ssim is not None:
        require(option("min_ssim"), EXTRA, LIBRARY)


def picture_sentences(picture: PictureDifference, a: str, b: str, options: PictureDiffOptions) -> list[str]:
    """Returns the differences beyond the limits of `options`; without limits, every pixel beyond the tolerance counts.

    Raises:
      UsageError: a limit does not apply to these pictures.
    """
    _require_fitting(picture, options)
    differences = [*_structure(picture, a, b)]
    if not picture.frames:
        return differences
    limits = (options.min_psnr, options.min_ssim, options.max_changed)
    beyond = _changed(picture) if limits == (None, None, None) else _beyond_limits(picture, options)
    return [*differences, *beyond]


def frame_facts(frame: FrameDifference) -> str:
    """Returns the measures of a frame: `PSNR 31.2 dB, SSIM 0.912, 3.1 % of the pixels changed, by 0.25 at most`."""
    facts = [
        "" if frame.psnr is None else f"PSNR {frame.psnr:.2f} dB",
        "" if frame.ssim is None else f"SSIM {frame.ssim:.4f}",
        f"{percent(frame.changed)} of the pixels changed",
        f"by {'a non-finite value' if frame.maximum is None else f'{frame.maximum:.6g} at most'}",
    ]
    return ", ".join(filter(None, facts))


def percent(share: float) -> str:
    """Formats a share as a percentage, which is never rounded to zero."""
    return f"{100 * share:.3g} %"


def frame_place(frame: FrameDifference, picture: PictureDifference) -> str:
    """Returns the place of a frame, `frame 17, time 0.283 s: `; empty for images."""
    if picture.frames_a == picture.frames_b == 1 and frame.time is None:
        return ""
    return f"frame {frame.frame}" + ("" if frame.time is None else f", time {frame.time:.6g} s") + ": "


def _require_fitting(picture: PictureDifference, options: PictureDiffOptions) -> None:
    limits = {"min_psnr": options.min_psnr, "min_ssim": options.min_ssim}
    for name, limit in limits.items():
        if limit is not None and picture.pixels == "numbers":
            raise UsageError(
                f"{option(name)} applies to colours; numbers are compared within {option('atol')} and {option('rtol')}"
            )
    if options.min_ssim is not None and min(picture.size_a) < WINDOW:
        raise UsageError(f"{option('min_ssim')} requires images of at least {WINDOW}x{WINDOW} pixels")


def _structure(picture: PictureDifference, a: str, b: str) -> Iterator[str]:
    """Yields the differences other than those of pixels."""
    if picture.size_a != picture.size_b:
        one, other = (f"{width}x{height}" for width, height in (picture.size_a, picture.size_b))
        yield f"the size is {one} in {a}, {other} in {b}"
    elif not picture.frames:
        yield f"one of {a} and {b} has colours, the other one numbers"
    if picture.fps_a and picture.fps_b and picture.fps_a != picture.fps_b:
        yield f"the rate is {picture.fps_a:.9g} frames per second in {a}, {picture.fps_b:.9g} in {b}"
    if picture.frames_a != picture.frames_b:
        yield f"the number of frames is {picture.frames_a} in {a}, {picture.frames_b} in {b}"


def _changed(picture: PictureDifference) -> Iterator[str]:
    if picture.first is None or picture.worst is None:
        return
    if picture.frames_a == picture.frames_b == 1:
        yield f"{frame_place(picture.worst, picture)}{frame_facts(picture.worst)}"
        return
    yield f"{picture.differing} of {picture.frames} frames differ"
    yield f"first {frame_place(picture.first, picture)}{frame_facts(picture.first)}"
    if picture.worst != picture.first:
        yield f"worst {frame_place(picture.worst, picture)}{frame_facts(picture.worst)}"


def _beyond_limits(picture: PictureDifference, options: PictureDiffOptions) -> Iterator[str]:
    """Yields the worst frame by each limit that is exceeded."""
    worst, similar, changed = picture.worst, picture.least_similar, picture.most_changed
    if options.min_psnr is not None and worst and worst.psnr is not None and worst.psnr < options.min_psnr:
        yield f"{frame_place(worst, picture)}PSNR {worst.psnr:.6g} dB is less than {options.min_psnr:g} dB"
    if options.min_ssim is not None and similar and similar.ssim is not None and similar.ssim < options.min_ssim:
        yield f"{frame_place(similar, picture)}SSIM {similar.ssim:.6g} is less than {options.min_ssim:g}"
    if options.max_changed is not None and changed and changed.changed > options.max_changed:
        share = f"{percent(changed.changed)} of the pixels changed"
        yield f"{frame_place(changed, picture)}{share}, more than {percent(options.max_changed)}"
