"""The formats of figures: images of pixels, as `mjrun.formats.image_format` has them, and drawings: svg and pdf."""

from pathlib import Path

from mjrun.errors import UnknownNameError, UsageError, clean, option
from mjrun.formats import image_format

DRAWINGS = ("svg", "pdf")  # each with the suffix of its name


def suffixes() -> list[str]:
    """The suffixes of figures."""
    return [*image_format.suffixes("rgb"), *(f".{name}" for name in DRAWINGS)]


def figure_format(output: str | None, format: str | None = None) -> str:  # noqa: A002
    """The name of the format meant by the suffix of `output` or by the option `format`.

    Args:
      output: a file, or None for standard output, which is png by default.

    Raises:
      UnknownNameError: there is no such format or suffix; the message lists those there are.
      UsageError: the format cannot hold a figure, or the suffix is that of another format.
    """
    suffix = "" if output is None else Path(output).suffix.lower()
    by_suffix = suffix[1:] if suffix[1:] in DRAWINGS else None
    named = format.lower().removeprefix(".") if format is not None else None
    if named in DRAWINGS or (by_suffix and named is None):
        drawing = named or by_suffix
        if suffix in suffixes() and drawing != by_suffix:
            raise UsageError(f"{option('format')} {drawing} and the suffix of {clean(str(output))} disagree")
        assert drawing
        return drawing
    if by_suffix:
        raise UsageError(f"{option('format')} {clean(str(format))} and the suffix of {clean(str(output))} disagree")
    try:
        return image_format.image_format(output, "rgb", format)
    except UnknownNameError as error:
        where = f"{option('format')} {error.name}" if error.name == format else clean(str(output))
        raise UnknownNameError("figure format", error.name, suffixes(), where=where) from None
