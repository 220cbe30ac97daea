"""Options that every command accepts: messages, opening of the files that were made, and confinement."""

from collections.abc import Mapping
from typing import ClassVar

from mjrun.options.kinds import FlagKind, PathKind, optional
from mjrun.options.option import FrontEnd, OptionRequirement, Options, option, options, options_of
from mjrun.options.setting_kinds import NamedNumbersKind

TIME, MEMORY, FILE = "time", "memory", "file"
DEFAULT_LIMITS = {TIME: 3600.0, MEMORY: 8192.0, FILE: 16384.0}  # of untrusted runs [s, MiB, MiB]


@options
class OpenWhenDoneOptions(Options):
    """Use of the files that a command has made."""

    section: ClassVar[str] = "Output"
    places: ClassVar[FrontEnd] = FrontEnd.COMMAND

    open: bool = option(
        converter=FlagKind(),
        default=False,
        help="Open the page, video or image that was made.",
    )


def opened_file(*alternatives: str) -> OptionRequirement:
    """Returns what `open` requires of a command that makes a page, or files of other options, only on request."""
    return OptionRequirement("open", "html", "which it opens", alternatives=alternatives)


@options
class JsonReportOptions(Options):
    """Forms of the one document that replaces prose; each is written by its entry in `mjrun.cli.console`."""

    section: ClassVar[str] = "Messages"
    places: ClassVar[FrontEnd] = FrontEnd.COMMAND

    json: bool = option(
        converter=FlagKind(),
        default=False,
        help="Print one JSON document to stdout instead of prose.",
    )


DOCUMENT_FORMS = tuple(each.name for each in options_of(JsonReportOptions))


@options
class ConsoleOptions(JsonReportOptions):
    """Form and amount of what a command prints."""

    section: ClassVar[str] = "Messages"
    places: ClassVar[FrontEnd] = FrontEnd.COMMAND

    quiet: bool = option(converter=FlagKind(), default=False, short="-q", help="Print only results and errors.")
    verbose: bool = option(
        converter=FlagKind(),
        default=False,
        short="-v",
        help="Print more details, such as timings.",
    )
    debug: bool = option(converter=FlagKind(), default=False, help="Print a traceback with every error.")


@options
class ConfinementOptions(Options):
    """Confinement of untrusted models, documents and tables; only the command line sets it."""

    section: ClassVar[str] = "Trust"
    places: ClassVar[FrontEnd] = FrontEnd.COMMAND

    untrusted: bool = option(
        converter=FlagKind(),
        default=False,
        help="Treat all files as untrusted: read only files beside the model and files that you name, write only to "
        "the folders of the outputs, use no network, run no code, load no .mjb, and limit time, memory and "
        "file size.",
    )
    root: str | None = option(
        converter=optional(PathKind("DIR")),
        default=None,
        usual="the model's folder",
        help="Folder from which files may be read; requires --untrusted.",
    )
    limit: Mapping[str, tuple[float, ...]] = option(
        converter=NamedNumbersKind("NAME=N"),
        default=dict[str, tuple[float, ...]](),
        usual=", ".join(f"{name}={limit:g}" for name, limit in DEFAULT_LIMITS.items()),
        help="Limit of an untrusted run: time, the wall time [s]; memory, that of each process [MiB]; or file, the "
        "size of each written file [MiB]. Requires --untrusted.",
    )
