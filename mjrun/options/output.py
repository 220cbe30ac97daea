"""Options that all outputs of a simulation share, and those of saved keyframes."""

from dataclasses import field
from fractions import Fraction
from typing import ClassVar

from mjrun.options.kinds import FlagKind, PathKind, TextKind, optional
from mjrun.options.number_kinds import ExactNumberKind, IntegerKind
from mjrun.options.option import FrontEnd, OptionExclusion, Options, option, options, required
from mjrun.suffixes import SOURCES

# Placeholders in help texts, which `mjrun.outputs.format_lists` replaces by the available formats.
TABLES = "{table formats}"
VIDEOS = "{video formats}"
CODECS = "{codecs}"
RGB_IMAGES = "{rgb image formats}"
DEPTH_IMAGES = "{depth image formats}"
SEGMENTATION_IMAGES = "{segmentation image formats}"
PLOTS = "{plot formats}"
EXPORTS = "{export formats}"
EXPORT_FOLDERS = "{export folders}"


@options
class OutputOptions(Options):
    """An output of a simulation.

    Args:
      simulation: the simulation that the output shows.
      output: the file that is written.
      command: the command line, for the manifest.
    """

    section: ClassVar[str] = "Output"

    simulation: object = field(kw_only=False)
    output: str = field(kw_only=False)
    manifest: str | None = option(
        converter=optional(PathKind(written=True, unlike=SOURCES)),
        default=None,
        help="JSON file that records how the output was made: versions, command, model, options, wall times and "
        "hashes.",
    )
    command: str = ""


@options
class RerunOptions(Options):
    """Options for a second run of the same command, and for build systems."""

    section: ClassVar[str] = "Output"
    places: ClassVar[FrontEnd] = FrontEnd.COMMAND

    if_changed: bool = option(
        converter=FlagKind(),
        default=False,
        help="Do nothing if the outputs are up to date: the contents of all files that are read and written, the "
        "options, the code and the versions are those of the last run that made them.",
    )
    depfile: str | None = option(
        converter=optional(PathKind(written=True, unlike=SOURCES)),
        default=None,
        help="Also write a rule for make or ninja that lists all files that the outputs depend on: the model with its "
        "includes, meshes and textures, documents, tables, policies and code.",
    )


@options
class SimulationCommandOptions(RerunOptions):
    """Options of all commands that simulate: additional outputs, and reruns."""

    section: ClassVar[str] = "Output"
    places: ClassVar[FrontEnd] = FrontEnd.COMMAND

    recording: str | None = option(
        converter=optional(PathKind(written=True)),
        default=None,
        help="Also write the state of every step (.npz), for replay.",
    )
    save_key: str | None = option(
        converter=optional(PathKind("FILE.xml[:NAME]", written=True)),
        default=None,
        help="Also write the model's XML with the final state, or the state in the image, as a keyframe. FILE may "
        "be the model itself; the default NAME is end.",
    )
    print_document: bool = option(
        converter=FlagKind(),
        default=False,
        help="Print a run document equivalent to this command and exit.",
    )


LAST_INSTANT = "end"  # the default name of the key


@options
class KeyframeOptions(OutputOptions):
    """The model's XML with one instant of the simulation, including controls, as a keyframe."""

    section: ClassVar[str] = "Keyframe"
    exclusions: ClassVar[tuple[OptionExclusion, ...]] = (OptionExclusion(("time", "step"), "both set the instant"),)

    output: str = required(
        converter=PathKind(written=True),
        kw_only=False,
        help="An .xml file, which may be the model itself. Apart from the keyframe, every byte of the XML is "
        "unchanged.",
    )
    name: str = option(
        converter=TextKind(metavar="NAME"),
        default=LAST_INSTANT,
        help="Name of the keyframe; an existing keyframe with this name is replaced.",
    )
    time: Fraction | None = option(
        converter=optional(ExactNumberKind("SECONDS", zero=True)),
        default=None,
        usual="the last instant",
        help="Time to save [s].",
    )
    step: int | None = option(converter=optional(IntegerKind()), default=None, help="Time to save, as a step number.")
