"""The image formats: a declaration of each, by view, and the format that the name of an output means.

| view  | format  | suffix         | holds                                                                       |
|-------|---------|----------------|-----------------------------------------------------------------------------|
| rgb   | png     | `.png`         | the pixels                                                                  |
|       | jpeg    | `.jpg .jpeg`   | nearly the pixels: quality 95, colour at full resolution                    |
|       | webp    | `.webp`        | the pixels                                                                  |
|       | tiff    | `.tiff .tif`   | the pixels                                                                  |
| depth | png     | `.png`         | millimetres to the nearest, uint16, 1 to 65535; 0 for the background        |
|       | npy     | `.npy`         | metres, float32; infinite for the background                                |
|       | exr     | `.exr`         | the same, channel `Y`                                                       |
|       | tiff    | `.tiff .tif`   | the same                                                                    |
| seg   | png     | `.png`         | index in the legend + 1, uint16; 0 for the background; labels               |
|       | palette | `.png`         | the same in 8 bits with a colour for each, at most 255 segments; labels     |
|       | npy     | `.npy`         | index in the legend, int32; −1 for the background; labels                   |
|       | coco    | `.json`        | masks of one or more images, see `coco`                                     |

Labels are a second file, `NAME.labels.json`, published with the image; standard output gets none.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mjrun.dataclass import dataclass
from mjrun.errors import UnknownNameError, UsageError, clean, concerning, option

if TYPE_CHECKING:
    from mjrun.formats.image_encoding import ImageData

CONTENTS = {"rgb": "colours", "depth": "exact depth", "seg": "exact segmentation"}
DRAWINGS = ("svg", "pdf")  # each with the suffix of its name


@dataclass(frozen=True)
class ImageFormat:
    """An image format of one view.

    Attributes:
      suffixes: suffixes of its files, the usual one first.
      encoder: name of the function in `image_encoding`; empty for a document of any number of images. The module is
        imported on first use: help lists the suffixes, and does not load numpy.
      largest: limit of width and height [pixels], if any.
      segments: limit of the number of segments, if any.
      nothing: value of the background, if labels accompany the image.
      is_clipped: whether depth beyond its range is clipped.
    """

    suffixes: Sequence[str]
    encoder: str = ""
    largest: int | None = None
    segments: int | None = None
    nothing: int | None = None
    is_clipped: bool = False

    def encode(self, image: "ImageData") -> bytes:
        """Returns the content of the file."""
        from mjrun.formats import image_encoding

        return getattr(image_encoding, self.encoder)(image)


FORMATS = {
    "rgb": {
        "png": ImageFormat((".png",), "png"),
        "jpeg": ImageFormat((".jpg", ".jpeg"), "jpeg", largest=65500),
        "webp": ImageFormat((".webp",), "webp", largest=16383),
        "tiff": ImageFormat((".tiff", ".tif"), "tiff"),
    },
    "depth": {
        "png": ImageFormat((".png",), "png", is_clipped=True),
        "npy": ImageFormat((".npy",), "npy"),
        "exr": ImageFormat((".exr",), "exr"),
        "tiff": ImageFormat((".tiff", ".tif"), "tiff"),
    },
    "seg": {
        "png": ImageFormat((".png",), "png", segments=2**16 - 1, nothing=0),
        "palette": ImageFormat((".png",), "palette_png", segments=255, nothing=0),
        "npy": ImageFormat((".npy",), "npy", nothing=-1),
        "coco": ImageFormat((".json",)),
    },
}
FIGURES = {**FORMATS["rgb"], **{name: ImageFormat((f".{name}",)) for name in DRAWINGS}}


def suffixes(view: str) -> list[str]:
    """Returns the suffixes of images that can hold `view`."""
    return _suffixes(FORMATS[view])


def image_format(output: str | None, view: str, format: str | None = None, hint: str = "") -> str:  # noqa: A002
    """Returns the name in `FORMATS[view]` of the format that the suffix of `output` or the option format means.

    A suffix of several formats means the first; `format` may be a suffix without its dot.

    Args:
      output: a file, or None for standard output, which is PNG by default.
      hint: advice for a view that the format cannot hold.

    Raises:
      UnknownNameError: the view, format or suffix is unknown; the message lists the valid ones.
      UsageError: the format cannot hold the view, or the suffix is that of another format.
    """
    if view not in FORMATS:
        raise UnknownNameError("view", view, list(FORMATS))
    return _format(output, format, FORMATS[view], "image format", CONTENTS[view], hint)


def figure_format(output: str | None, format: str | None = None) -> str:  # noqa: A002
    """Returns the name of the format of a figure; see `image_format`.

    Raises:
      UnknownNameError: the format or suffix is unknown; the message lists the valid ones.
      UsageError: the format cannot hold a figure, or the suffix is that of another format.
    """
    name = format.lower().removeprefix(".") if format is not None else None
    return _format(output, name, FIGURES, "figure format", CONTENTS["rgb"])


def _format(
    output: str | None, name: str | None, choices: Mapping[str, ImageFormat], kind: str, contents: str, hint: str = ""
) -> str:
    """Returns the name of the format among `choices`, which can hold `contents`."""
    others = [known for each in FORMATS.values() for known in each.items()]
    valid = _suffixes(choices)
    suffix = "" if output is None else Path(output).suffix.lower()
    is_known = suffix in valid or any(suffix in known.suffixes for _, known in others)

    chosen = None
    if name is not None:
        chosen = next((known for known, form in choices.items() if name == known or f".{name}" in form.suffixes), None)
        if chosen is None and any(name == known or f".{name}" in form.suffixes for known, form in others):
            raise _cannot_hold(f"{option('format')} {name}", contents, list(choices), hint)
        if chosen is None:
            with concerning("format"):
                raise UnknownNameError("format", name, list(choices))
    if output is None:
        return chosen or "png"

    by_suffix = [known for known, form in choices.items() if suffix in form.suffixes]
    if chosen is not None:
        if is_known and chosen not in by_suffix:
            raise UsageError(f"{option('format')} {chosen} and the suffix of {clean(output)} disagree")
        return chosen
    if by_suffix:
        return by_suffix[0]
    if is_known:
        raise _cannot_hold(f"{clean(output)}: a {suffix}", contents, valid, hint)
    with concerning("output"):
        raise UnknownNameError(kind, suffix, valid, where=output)


def _suffixes(formats: Mapping[str, ImageFormat]) -> list[str]:
    return list(dict.fromkeys(suffix for known in formats.values() for suffix in known.suffixes))


def _cannot_hold(what: str, contents: str, valid: Sequence[str], hint: str) -> UsageError:
    return UsageError(f"{what} cannot hold {contents}\n{', '.join(valid)} can" + (f"\n{hint}" if hint else ""))
