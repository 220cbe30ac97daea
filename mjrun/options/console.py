"""Options for messages, which every command accepts."""

from typing import ClassVar

from mjrun.options.kinds import Flag
from mjrun.options.option import FrontEnd, Options, option, options, options_of


@options
class OpenOptions(Options):
    """Use of the files that a command has made."""

    section: ClassVar[str] = "Output"
    places: ClassVar[FrontEnd] = FrontEnd.COMMAND

    open: bool = option(
        converter=Flag(),
        default=False,
        help="Open the page, video or image that was made.",
    )


@options
class DocumentFormOptions(Options):
    """Forms of the one document that replaces prose; each is written by its entry in `mjrun.cli.console`."""

    section: ClassVar[str] = "Messages"
    places: ClassVar[FrontEnd] = FrontEnd.COMMAND

    json: bool = option(
        converter=Flag(),
        default=False,
        help="Print one JSON document to stdout instead of prose.",
    )


DOCUMENT_FORMS = tuple(each.name for each in options_of(DocumentFormOptions))


@options
class ConsoleOptions(DocumentFormOptions):
    """Form and amount of what a command prints."""

    section: ClassVar[str] = "Messages"
    places: ClassVar[FrontEnd] = FrontEnd.COMMAND

    quiet: bool = option(converter=Flag(), default=False, short="-q", help="Print only results and errors.")
    verbose: bool = option(
        converter=Flag(),
        default=False,
        short="-v",
        help="Print more details, such as timings.",
    )
    debug: bool = option(converter=Flag(), default=False, help="Print a traceback with every error.")
