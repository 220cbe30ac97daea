"""Options of the command `run`: the output folder, and settings that override the document on this machine."""

from typing import ClassVar

from mjrun.options.kinds import Choice, File, Flag, Optional
from mjrun.options.number_kinds import Processes, Real
from mjrun.options.option import FrontEnd, option, options
from mjrun.options.output import RerunOptions
from mjrun.options.rendering import QUALITIES, BackendOptions
from mjrun.options.simulation import CodeOptions


@options
class RunOptions(BackendOptions, CodeOptions, RerunOptions):
    """Options of a run that only the command line sets."""

    section: ClassVar[str] = "Run"

    output: str = option(
        converter=File("DIR", written=True),
        default=".",
        short="-o",
        places=FrontEnd.COMMAND,
        help="Folder for all outputs; created if missing.",
    )
    update: bool = option(
        converter=Flag(),
        default=False,
        places=FrontEnd.COMMAND,
        help="Create or replace the golden tables of all traces, and report what changed.",
    )
    dry_run: bool = option(
        converter=Flag(), default=False, places=FrontEnd.COMMAND, help="List the outputs that would be made and exit."
    )
    quality: str | None = option(
        converter=Optional(Choice(QUALITIES)),
        default=None,
        usual="from the document",
        places=FrontEnd.COMMAND,
        help="Rendering quality of all videos and images.",
    )
    jobs: int | str | None = option(
        converter=Optional(Processes()),
        default=None,
        usual="from the document",
        places=FrontEnd.COMMAND,
        help="Number of processes that render each video.",
    )
    html: str | None = option(
        converter=Optional(File(written=True)),
        default=None,
        usual="from the document",
        places=FrontEnd.COMMAND,
        help="Self-contained page (.html) about all outputs.",
    )
    embed_up_to: float | None = option(
        converter=Optional(Real(metavar="MB")),
        default=None,
        usual="from the document",
        places=FrontEnd.COMMAND,
        help="Embed images and videos up to this size in the page; larger ones are linked.",
    )
