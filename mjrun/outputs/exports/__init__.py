"""The formats of exports: a declaration of each, and modules with their writers.

Help lists the formats, so that writers, which import numpy, MuJoCo and the libraries of their format, are imported on
first use.
"""

from collections.abc import Sequence
from pathlib import Path

from mjrun.dataclass import dataclass
from mjrun.errors import UnknownNameError, UsageError, clean, option
from mjrun.options.trace import PROBES
from mjrun.packages import require
from mjrun.suffixes import HTML

EPISODES = "mjrun.study.episode_dataset:EpisodeDataset"


@dataclass(frozen=True)
class ExportFormat:
    """A format of exports.

    Attributes:
      name: value of the option format.
      suffixes: suffixes of its files, the usual one first; empty for folders.
      description: a noun phrase for help and documentation.
      write: `package.module:function` that writes a `SceneToExport` to a file; empty for folders with episodes.
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
    write: str = ""
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


FORMATS = {
    known.name: known
    for known in (
        ExportFormat("glb", (".glb",), "binary glTF with scene and motion", "mjrun.outputs.export:write_glb_file"),
        ExportFormat(
            "html",
            HTML,
            "a page that replays the simulation in 3D, without network",
            "mjrun.outputs.exports.html:write_page",
            cameras=(),
            columns="plot",
            contacts=True,
            layers=("contactpoint", "contactforce", "labels"),
            timeline=True,
            hidden=True,
        ),
        ExportFormat("lerobot", (), "LeRobot dataset v3 of episodes, for imitation learning", product=EPISODES),
        ExportFormat(
            "mcap",
            (".mcap",),
            "log for Foxglove, Rerun and PlotJuggler",
            "mjrun.outputs.exports.mcap:write_mcap",
            cameras=(),
            draws=True,
            columns="probe",
            probes=PROBES,
            libraries=("mcap", "foxglove_schemas_protobuf", "google.protobuf"),
            extra="mcap",
        ),
        ExportFormat("minari", (), "Minari dataset of episodes, for offline reinforcement learning", product=EPISODES),
        ExportFormat(
            "usd",
            (".usdc", ".usda", ".usdz", ".usd"),
            "OpenUSD with scene and motion, as binary, text or package",
            "mjrun.outputs.export:write_usd_file",
            libraries=("pxr",),
            extra="usd",
        ),
    )
}


def format_named(name: str) -> tuple[ExportFormat, str]:
    """Returns the format with this name or suffix, such as `usd` or `usda`, and the suffix of its files.

    Raises:
      UnknownNameError: no format has this name.
    """
    if name in FORMATS:
        return FORMATS[name], next(iter(FORMATS[name].suffixes), "")
    suffixes = {suffix: each for each in FORMATS.values() for suffix in each.suffixes}
    suffix = f".{name}"
    if suffix not in suffixes:
        raise UnknownNameError("format", name, list(FORMATS), where=option("format"))
    return suffixes[suffix], suffix


def export_format(output: str, name: str | None = None) -> ExportFormat:
    """Returns the format of an export, from the option format or from the suffix of its output.

    Raises:
      UnknownNameError: no format has this name.
      UsageError: no format has this suffix, or the name and the suffix disagree.
      MissingExtraError: a library of the format is not installed.
    """
    suffix = Path(output).suffix.lower()
    by_suffix = next((each for each in FORMATS.values() if suffix in each.suffixes), None)
    chosen = format_named(name)[0] if name is not None else by_suffix
    if chosen is None:
        known = ", ".join(suffix for each in FORMATS.values() for suffix in each.suffixes)
        what = f"unknown suffix {clean(suffix)}" if suffix else "the format of an export follows from its suffix"
        raise UsageError(f"{clean(output)}: {what}\nsuffixes: {known}; or set {option('format')}", path=("output",))
    if by_suffix is not None and name not in (None, by_suffix.name, suffix.removeprefix(".")):
        raise UsageError(
            f"{option('format')} {name} contradicts the suffix of {clean(output)}, which is {by_suffix.name}"
        )
    chosen.require_library()
    return chosen
