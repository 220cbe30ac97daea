"""Options of the command `check`."""

from fractions import Fraction
from typing import ClassVar

from mjrun.options.kinds import AUTO, Choice, ExactNumber, Flag, Integer, Processes, Several, Text
from mjrun.options.option import Exclusion, FrontEnd, Options, option, options

SEVERITIES = ("error", "warning", "note")


@options
class CheckOptions(Options):
    """What is looked for in models, and within what limits."""

    section: ClassVar[str] = "Check"

    select: tuple[str, ...] = option(
        converter=Several(Text("CODE"), commas=True, expected="a code, or how several begin"),
        default=(),
        help="Look for these only: MJ301, or MJ3 for all that begin so.",
    )
    ignore: tuple[str, ...] = option(
        converter=Several(Text("CODE"), commas=True, expected="a code, or how several begin"),
        default=(),
        help="Leave these out. What keeps a model from loading stays.",
    )
    fail_on: str = option(
        converter=Choice(SEVERITIES),
        default="error",
        help="Exit with 1 when something of this severity, or worse, is found.",
    )
    steps: int = option(
        converter=Integer(),
        default=200,
        help="Steps that a model must survive, from its own start; 0 for none.",
    )
    timeout: Fraction = option(converter=ExactNumber("SECONDS"), default=60, help="Wall time for one model [s].")
    memory: int = option(converter=Integer(1, metavar="MIB"), default=4096, help="Memory for one model [MiB].")
    jobs: int | str = option(converter=Processes(), default=AUTO, usual="auto, one per core", help="Models at once.")


@options
class CheckReportOptions(Options):
    """What is printed."""

    section: ClassVar[str] = "Check"
    exclusions: ClassVar[tuple[Exclusion, ...]] = (Exclusion(("sarif", "github"), "both want standard output"),)

    list_: bool = option(converter=Flag(), default=False, places=FrontEnd.COMMAND, help="List all codes, and stop.")
    sarif: bool = option(
        converter=Flag(),
        default=False,
        places=FrontEnd.COMMAND,
        help="One SARIF 2.1.0 document on stdout, for code scanning.",
    )
    github: bool = option(
        converter=Flag(), default=False, places=FrontEnd.COMMAND, help="Annotations of a GitHub workflow on stdout."
    )
