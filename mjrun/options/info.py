"""Options of the command `info`."""

from typing import ClassVar

from mjrun.options.kinds import Flag
from mjrun.options.option import FrontEnd, Options, option, options


@options
class InfoOptions(Options):
    """What is shown."""

    section: ClassVar[str] = "Info"

    columns: bool = option(
        converter=Flag(),
        default=False,
        places=FrontEnd.COMMAND,
        help="List every column that a trace of the model can have, and stop.",
    )
