"""The lists of formats in help texts, made from the declarations of the formats."""

from collections.abc import Callable, Iterable

from mjrun.options import output
from mjrun.options.policy import POLICIES


def with_formats(text: str) -> str:
    """Replaces placeholders in `text`, such as `{table formats}`, by the names of formats."""
    for placeholder, names in LISTS.items():
        if placeholder in text:
            text = text.replace(placeholder, ", ".join(names()))
    return text


# Each list imports its formats: a command lists a few.


def _tables() -> Iterable[str]:
    from mjrun.formats import tables

    return (_name(known.suffixes) for known in tables.FORMATS.values())


def _videos() -> Iterable[str]:
    """Returns the containers of videos in one file; help describes the others separately."""
    from mjrun.formats import codecs

    return [name for name, known in codecs.CONTAINERS.items() if known.demuxers]


def _codecs() -> Iterable[str]:
    """Returns the codecs of containers that offer several."""
    from mjrun.formats import codecs

    held = [codecs.CONTAINERS[name].codecs for name in _videos()]
    return dict.fromkeys(codec for choice in held if len(choice) > 1 for codec in choice)


def _images(view: str) -> Iterable[str]:
    from mjrun.formats import image_format

    return dict.fromkeys(_name(known.suffixes) for known in image_format.FORMATS[view].values())


def _plots() -> Iterable[str]:
    from mjrun.formats.image_format import DRAWINGS

    return [*_images("rgb"), *DRAWINGS]


def _exports(*, folders: bool) -> Iterable[str]:
    """Returns the names of formats that write files, or folders, with their descriptions."""
    from mjrun.outputs.exports import FORMATS

    for name, known in FORMATS.items():
        if bool(known.suffixes) != folders:
            yield f"{known.suffixes[0] if known.suffixes else name} ({known.description})"


def _policies() -> Iterable[str]:
    from mjrun.policy.loaders import formats

    return formats()


def _name(suffixes: Iterable[str]) -> str:
    """Returns the usual suffix of a format, which is its first."""
    return next(iter(suffixes)).removeprefix(".")


LISTS: dict[str, Callable[[], Iterable[str]]] = {
    output.TABLES: _tables,
    output.VIDEOS: _videos,
    output.CODECS: _codecs,
    output.RGB_IMAGES: lambda: _images("rgb"),
    output.DEPTH_IMAGES: lambda: _images("depth"),
    output.SEGMENTATION_IMAGES: lambda: _images("seg"),
    output.EXPORTS: lambda: _exports(folders=False),
    output.EXPORT_FOLDERS: lambda: _exports(folders=True),
    POLICIES: _policies,
    output.PLOTS: _plots,
}
