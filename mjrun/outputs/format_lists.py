"""The lists of formats in help texts, made from the declarations of the formats."""

from collections.abc import Callable, Iterable

from mjrun.formats import codecs, image_format, tables
from mjrun.options.output import (
    CODECS,
    DEPTH_IMAGES,
    EXPORT_FOLDERS,
    EXPORTS,
    PLOTS,
    RGB_IMAGES,
    SEGMENTATION_IMAGES,
    TABLES,
    VIDEOS,
)
from mjrun.options.policy import POLICIES
from mjrun.outputs.exports import export_formats
from mjrun.policy.loaders import formats as policy_formats


def with_formats(text: str) -> str:
    """Replaces placeholders in `text`, such as `{table formats}`, by the names of formats."""
    for placeholder, names in LISTS.items():
        if placeholder in text:
            text = text.replace(placeholder, ", ".join(names()))
    return text


def _tables() -> Iterable[str]:
    return (_name(known.suffixes) for known in tables.FORMATS.values())


def _videos() -> Iterable[str]:
    """Returns the containers, except separate image files and raw pixels, which help describes separately."""
    return [name for name, known in codecs.CONTAINERS.items() if known.muxer not in ("image2", "rawvideo")]


def _codecs() -> Iterable[str]:
    """Returns the codecs of containers that offer several."""
    held = [codecs.CONTAINERS[name].codecs for name in _videos()]
    return dict.fromkeys(codec for choice in held if len(choice) > 1 for codec in choice)


def _images(view: str) -> Iterable[str]:
    return dict.fromkeys(_name(known.suffixes) for known in image_format.FORMATS[view].values())


def _name(suffixes: Iterable[str]) -> str:
    """Returns the usual suffix of a format, which is its first."""
    return next(iter(suffixes)).removeprefix(".")


LISTS: dict[str, Callable[[], Iterable[str]]] = {
    TABLES: _tables,
    VIDEOS: _videos,
    CODECS: _codecs,
    RGB_IMAGES: lambda: _images("rgb"),
    DEPTH_IMAGES: lambda: _images("depth"),
    SEGMENTATION_IMAGES: lambda: _images("seg"),
    EXPORTS: lambda: [
        f"{known.suffixes[0]} ({known.description})" for known in export_formats().values() if known.suffixes
    ],
    EXPORT_FOLDERS: lambda: [
        f"{name} ({known.description})" for name, known in export_formats().items() if not known.suffixes
    ],
    POLICIES: policy_formats,
    PLOTS: lambda: [*_images("rgb"), *image_format.DRAWINGS],
}
