"""Options for formats of reports, each of which is a module of `mjrun.cli.report_formats`."""

from typing import ClassVar

from mjrun.options.kinds import Flag
from mjrun.options.option import FrontEnd, Options, option, options, options_of


@options
class ReportFormatOptions(Options):
    """Formats of the report for CI systems; only one can print to standard output."""

    section: ClassVar[str] = "Report"

    github: bool = option(
        converter=Flag(),
        default=False,
        places=FrontEnd.COMMAND,
        help="Print GitHub Actions annotations to stdout.",
    )
    junit: bool = option(
        converter=Flag(),
        default=False,
        places=FrontEnd.COMMAND,
        help="Print JUnit XML to stdout, in which errors and warnings are failures.",
    )
    markdown: bool = option(
        converter=Flag(),
        default=False,
        places=FrontEnd.COMMAND,
        help="Print a Markdown table of what failed to stdout, for the summary of a pull request.",
    )


REPORT_FORMATS = tuple(each.name for each in options_of(ReportFormatOptions))
