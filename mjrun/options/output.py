"""Options that all outputs of a simulation have."""

from dataclasses import field
from typing import ClassVar

from mjrun.options.kinds import File, Flag, Optional, Text
from mjrun.options.option import FrontEnd, Options, option, options

# In help texts, these stand for the formats that there are; `mjrun.formats.format_lists` puts them in.
TABLES = "{table formats}"
VIDEOS = "{video formats}"
CODECS = "{codecs}"
RGB_IMAGES = "{rgb image formats}"
DEPTH_IMAGES = "{depth image formats}"
SEGMENTATION_IMAGES = "{segmentation image formats}"
PLOTS = "{plot formats}"


@options
class OutputOptions(Options):
    """An output of a simulation.

    Args:
      simulation: what it is an output of.
      output: where it is written.
      command: the command line, for the manifest.
    """

    section: ClassVar[str] = "Output"

    simulation: object = field(kw_only=False)
    output: str = field(kw_only=False)
    manifest: str | None = option(
        converter=Optional(File(written=True)),
        default=None,
        help="A JSON file that says what made the output: versions, command, model, options, wall times, hashes.",
    )
    command: str = ""


@options
class CommandOptions(Options):
    """What commands that simulate can do besides."""

    section: ClassVar[str] = "Output"

    recording: str | None = option(
        converter=Optional(File(written=True)),
        default=None,
        places=FrontEnd.COMMAND,
        help="Also keep the state of every step (.npz), to replay.",
    )
    save_key: str | None = option(
        converter=Optional(Text("FILE.xml[:NAME]")),
        default=None,
        places=FrontEnd.COMMAND,
        help="Also write the model's XML with the last instant, or that of the image, as a keyframe. FILE may be the "
        "model's; NAME is end if it is left out.",
    )
    print_document: bool = option(
        converter=Flag(),
        default=False,
        places=FrontEnd.COMMAND,
        help="Print this command as a document for mjrun run, and stop.",
    )
