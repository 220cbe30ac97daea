"""Options of what a command prints on the console."""

from typing import ClassVar

from mjrun.options.kinds import Flag
from mjrun.options.option import FrontEnd, Options, option, options


@options
class ConsoleOptions(Options):
    """What is printed, and how much of it."""

    section: ClassVar[str] = "Messages"

    json: bool = option(
        converter=Flag(), default=False, places=FrontEnd.COMMAND, help="One JSON document on stdout instead of prose."
    )
    quiet: bool = option(
        converter=Flag(), default=False, short="-q", places=FrontEnd.COMMAND, help="Print errors only."
    )
    verbose: bool = option(
        converter=Flag(),
        default=False,
        short="-v",
        places=FrontEnd.COMMAND,
        help="Print more, such as where the time went.",
    )
    debug: bool = option(converter=Flag(), default=False, places=FrontEnd.COMMAND, help="Show tracebacks.")
