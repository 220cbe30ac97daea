"""The formats of still pictures: a plain table, and what an output's name means in it.

| view  | format  | suffix         | holds                                                                    |
|-------|---------|----------------|--------------------------------------------------------------------------|
| rgb   | png     | `.png`         | the pixels                                                               |
|       | jpeg    | `.jpg .jpeg`   | nearly the pixels: quality 95, colour at full size                       |
|       | webp    | `.webp`        | the pixels                                                               |
|       | tiff    | `.tif .tiff`   | the pixels                                                               |
| depth | png     | `.png`         | millimetres to the nearest, uint16, 1 to 65535; 0 where nothing is seen  |
|       | npy     | `.npy`         | metres, float32; infinite where nothing is seen                          |
|       | exr     | `.exr`         | the same, channel `Y`                                                    |
|       | tiff    | `.tif .tiff`   | the same                                                                 |
| seg   | png     | `.png`         | index in the legend + 1, uint16; 0 where nothing is seen; labels         |
|       | palette | `.png`         | the same in 8 bits with a colour for each, at most 255 things; labels    |
|       | npy     | `.npy`         | index in the legend, int32; −1 where nothing is seen; labels             |
|       | coco    | `.json`        | masks of one or more images, see `coco`                                  |

Labels are a second file, `NAME.labels.json`, published with the picture; on standard output there are none.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mjrun.errors import UnknownNameError, UsageError, clean
from mjrun.model.uint16_pixels import UINT16_MAX, clipped_share

WORDS = {"rgb": "colours", "depth": "exact depth", "seg": "exact segmentation"}


@dataclass(frozen=True)
class Format:
    """A format of pictures.

    Attributes:
      suffixes: those that mean it, the usual one first.
      largest: pixels a side, if it has a limit.
      things: how many it tells apart.
      nothing: its value where nothing is seen, if labels go with it.
      clipped: the share of what is seen in the pixels that it cannot say.
      several: whether it is a document of any number of images.
    """

    suffixes: Sequence[str]
    largest: int | None = None
    things: int | None = None
    nothing: int | None = None
    clipped: Callable[[np.ndarray], float] = lambda pixels: 0.0
    several: bool = False


FORMATS = {
    "rgb": {
        "png": Format((".png",)),
        "jpeg": Format((".jpg", ".jpeg"), largest=65500),
        "webp": Format((".webp",), largest=16383),
        "tiff": Format((".tif", ".tiff")),
    },
    "depth": {
        "png": Format((".png",), clipped=clipped_share),
        "npy": Format((".npy",)),
        "exr": Format((".exr",)),
        "tiff": Format((".tif", ".tiff")),
    },
    "seg": {
        "png": Format((".png",), things=UINT16_MAX, nothing=0),
        "palette": Format((".png",), things=255, nothing=0),
        "npy": Format((".npy",), nothing=-1),
        "coco": Format((".json",), several=True),
    },
}


def image_format(output: str | None, view: str, format: str | None = None, hint: str = "") -> str:  # noqa: A002
    """The name in `FORMATS[view]` meant by an output's suffix, or by `format`; `output` None is standard output, png.

    A suffix of several formats means the first; `format` may be a suffix without its point.

    Args:
      hint: what else the user can do when the view cannot be held.

    Raises:
      UnknownNameError: there is no such view, format or suffix; the message lists those there are.
      UsageError: the format cannot hold the view, or the suffix is another's.
    """
    if view not in FORMATS:
        raise UnknownNameError("view", view, list(FORMATS))
    known = FORMATS[view]
    asked = None if format is None else _named(format, view, hint)
    if output is None:
        return asked or "png"
    suffix = Path(output).suffix.lower()
    meant = [name for name, kind in known.items() if suffix in kind.suffixes]
    if asked and (asked in meant or not _views(suffix)):
        return asked
    if asked:
        raise UsageError(f"--format {asked} and the suffix of {clean(output)} disagree")
    if not meant and _views(suffix):
        raise _cannot_hold(f"{clean(output)}: a {suffix}", view, _suffixes(view), hint)
    if not meant:
        raise UnknownNameError("image format", suffix, _suffixes(view), where=output)
    return meant[0]


def _named(asked: str, view: str, hint: str) -> str:
    for name, kind in FORMATS[view].items():
        if asked == name or f".{asked}" in kind.suffixes:
            return name
    if any(asked in known for known in FORMATS.values()) or _views(f".{asked}"):
        raise _cannot_hold(f"--format {asked}", view, list(FORMATS[view]), hint)
    raise UnknownNameError("format", asked, list(FORMATS[view]))


def _views(suffix: str) -> list[str]:
    """Those that files of this suffix can hold."""
    return [view for view in FORMATS if suffix in _suffixes(view)]


def _suffixes(view: str) -> list[str]:
    return list(dict.fromkeys(suffix for kind in FORMATS[view].values() for suffix in kind.suffixes))


def _cannot_hold(what: str, view: str, valid: Sequence[str], hint: str) -> UsageError:
    return UsageError(f"{what} cannot hold {WORDS[view]}\n{', '.join(valid)} can" + (f"\n{hint}" if hint else ""))
