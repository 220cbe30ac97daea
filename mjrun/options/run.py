"""Options of the command `run`: where the outputs go, and what this machine does otherwise than the document says."""

from typing import ClassVar

from mjrun.options.kinds import Choice, File, Flag, Optional, Processes, Real
from mjrun.options.option import FrontEnd, option, options
from mjrun.options.simulation import CodeOptions
from mjrun.options.view import QUALITIES, BackendOptions


@options
class RunOptions(BackendOptions, CodeOptions):
    """What only the command line says of a run."""

    section: ClassVar[str] = "Run"

    output: str = option(
        converter=File("DIR", written=True),
        default=".",
        short="-o",
        places=FrontEnd.COMMAND,
        help="The folder of all outputs; made if need be.",
    )
    update: bool = option(
        converter=Flag(),
        default=False,
        places=FrontEnd.COMMAND,
        help="Make the golden tables of all traces, or replace them and tell what changed.",
    )
    dry_run: bool = option(
        converter=Flag(), default=False, places=FrontEnd.COMMAND, help="Show what would be made, and stop."
    )
    quality: str | None = option(
        converter=Optional(Choice(QUALITIES)),
        default=None,
        usual="as the document says",
        places=FrontEnd.COMMAND,
        help="Quality of all videos and images.",
    )
    jobs: int | str | None = option(
        converter=Optional(Processes()),
        default=None,
        usual="as the document says",
        places=FrontEnd.COMMAND,
        help="Processes that draw each video.",
    )
    html: str | None = option(
        converter=Optional(File(written=True)),
        default=None,
        usual="as the document says",
        places=FrontEnd.COMMAND,
        help="One page about everything that was made (.html), which opens in any browser.",
    )
    embed_up_to: float | None = option(
        converter=Optional(Real(metavar="MB")),
        default=None,
        usual="as the document says",
        places=FrontEnd.COMMAND,
        help="Images and videos up to this size are in the page itself.",
    )
