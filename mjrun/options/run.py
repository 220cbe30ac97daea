"""Options of the command `run`: the output folder, and settings that override the document on this machine."""

from typing import ClassVar

from mjrun.options.kinds import ChoiceKind, FlagKind, PathKind, optional
from mjrun.options.number_kinds import ProcessCountKind, RealKind
from mjrun.options.option import FrontEnd, option, options
from mjrun.options.output import RerunOptions
from mjrun.options.rendering import QUALITIES, BackendOptions
from mjrun.options.simulation import CodeOptions


@options
class RunCommandOptions(BackendOptions, CodeOptions, RerunOptions):
    """Options of a run that only the command line sets."""

    section: ClassVar[str] = "Run"
    places: ClassVar[FrontEnd] = FrontEnd.COMMAND

    output: str = option(
        converter=PathKind("DIR", written=True),
        default=".",
        short="-o",
        help="Folder for all outputs; created if missing.",
    )
    update: bool = option(
        converter=FlagKind(),
        default=False,
        help="Create or replace the golden tables of all traces, and report what changed.",
    )
    dry_run: bool = option(converter=FlagKind(), default=False, help="List the outputs that would be made and exit.")
    quality: str | None = option(
        converter=optional(ChoiceKind(QUALITIES)),
        default=None,
        usual="from the document",
        help="Rendering quality of all videos and images.",
    )
    jobs: int | str | None = option(
        converter=optional(ProcessCountKind()),
        default=None,
        usual="from the document",
        help="Number of processes that render each video.",
    )
    html: str | None = option(
        converter=optional(PathKind(written=True)),
        default=None,
        usual="from the document",
        help="Self-contained page (.html) about all outputs.",
    )
    embed_up_to: float | None = option(
        converter=optional(RealKind(metavar="MB")),
        default=None,
        usual="from the document",
        help="Embed images and videos up to this size in the page; larger ones are linked.",
    )
