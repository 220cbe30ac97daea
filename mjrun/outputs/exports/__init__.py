"""The formats of exports, one module each.

A module is found by its place in this package, and defines `FORMAT`, an `ExportFormat`. Help lists the formats, so that
their modules import numpy, MuJoCo and the libraries of the format inside functions.
"""

import functools
import importlib
import pkgutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from mjrun.dataclass import dataclass
from mjrun.errors import UnknownNameError, UsageError, clean, option
from mjrun.packages import require

if TYPE_CHECKING:
    from mjrun.outputs.export import SceneToExport


@dataclass(frozen=True)
class ExportFormat:
    """A format of exports.

    Attributes:
      name: value of the option format.
      suffixes: suffixes of its files, the usual one first; empty for folders.
      description: a noun phrase for help and documentation.
      write: writes the file; None for a format of folders with episodes.
      cameras: the cameras that are added to those of the model by default.
      draws: whether it holds images from the cameras that are requested.
      columns: the option whose columns it holds: `plot`, `probe` or neither.
      probes: the columns by default.
      contacts: whether it holds the contacts of each frame.
      layers: `contactpoint`, `contactforce` and `labels`, as far as its viewers show and hide them.
      timeline: whether it shows a time line with marks.
      hidden: whether it also holds objects that are hidden at first, for viewers that can show them.
      product: `package.module:Class` of the output that makes a folder with episodes.
      libraries, extra: libraries that it needs, and the extra of mjrun that installs them.
    """

    name: str
    suffixes: Sequence[str]
    description: str
    write: "Callable[[SceneToExport, BinaryIO], object] | None" = None
    cameras: Sequence[str] = ("free",)
    draws: bool = False
    columns: str = ""
    probes: Sequence[str] = ()
    contacts: bool = False
    layers: Sequence[str] = ()
    timeline: bool = False
    hidden: bool = False
    product: str = ""
    libraries: Sequence[str] = ()
    extra: str = ""

    @property
    def options(self) -> set[str]:
        """The options that it supports of those that only some formats support."""
        measured = {self.columns, "rate"} if self.columns else set[str]()
        others = {"images": self.draws, "mark_event": self.timeline}
        return measured | {name for name, is_supported in others.items() if is_supported}

    def require_library(self) -> None:
        """Raises MissingExtraError or WrongVersionError if a library is unusable."""
        if self.libraries:
            require(f"writing {self.suffixes[0] if self.suffixes else self.name}", self.extra, *self.libraries)


@functools.cache
def export_formats() -> dict[str, ExportFormat]:
    """Returns all formats by name."""
    modules = [importlib.import_module(f"{__name__}.{module.name}") for module in pkgutil.iter_modules(__path__)]
    return {module.FORMAT.name: module.FORMAT for module in modules}


def format_named(name: str) -> tuple[ExportFormat, str]:
    """Returns the format with this name or suffix, such as `usd` or `usda`, and the suffix of its files.

    Raises:
      UnknownNameError: no format has this name.
    """
    formats = export_formats()
    if name in formats:
        return formats[name], next(iter(formats[name].suffixes), "")
    suffixes = {suffix: each for each in formats.values() for suffix in each.suffixes}
    suffix = f".{name}"
    if suffix not in suffixes:
        raise UnknownNameError("format", name, list(formats), where=option("format"))
    return suffixes[suffix], suffix


def export_format(output: str, name: str | None = None) -> ExportFormat:
    """Returns the format of an export, from the option format or from the suffix of its output.

    Raises:
      UnknownNameError: no format has this name.
      UsageError: no format has this suffix, or the name and the suffix disagree.
      MissingExtraError: a library of the format is not installed.
    """
    formats = export_formats()
    suffix = Path(output).suffix.lower()
    by_suffix = next((each for each in formats.values() if suffix in each.suffixes), None)
    chosen = format_named(name)[0] if name is not None else by_suffix
    if chosen is None:
        known = ", ".join(suffix for each in formats.values() for suffix in each.suffixes)
        what = f"unknown suffix {clean(suffix)}" if suffix else "the format of an export follows from its suffix"
        raise UsageError(f"{clean(output)}: {what}\nsuffixes: {known}; or set {option('format')}", path=("output",))
    if by_suffix is not None and name not in (None, by_suffix.name, suffix.removeprefix(".")):
        raise UsageError(
            f"{option('format')} {name} contradicts the suffix of {clean(output)}, which is {by_suffix.name}"
        )
    chosen.require_library()
    return chosen
