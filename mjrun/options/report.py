"""Options of reports: pages, and formats for CI systems, each of which is a function of `mjrun.cli.report_formats`."""

from typing import ClassVar

from mjrun.options.kinds import FlagKind, PathKind, optional
from mjrun.options.number_kinds import RealKind
from mjrun.options.option import FrontEnd, OptionRequirement, Options, option, options, options_of


@options
class ReportFormatOptions(Options):
    """Formats of the report for CI systems; only one can print to standard output."""

    section: ClassVar[str] = "Report"
    places: ClassVar[FrontEnd] = FrontEnd.COMMAND

    github: bool = option(
        converter=FlagKind(),
        default=False,
        help="Print GitHub Actions annotations to stdout.",
    )
    junit: bool = option(
        converter=FlagKind(),
        default=False,
        help="Print JUnit XML to stdout, in which errors and warnings are failures.",
    )
    markdown: bool = option(
        converter=FlagKind(),
        default=False,
        help="Print a Markdown table of what failed to stdout, for the summary of a pull request.",
    )


REPORT_FORMATS = tuple(each.name for each in options_of(ReportFormatOptions))


@options
class ExperimentTrackerOptions(Options):
    """Results as runs of an experiment tracker."""

    section: ClassVar[str] = "Output"
    places: ClassVar[FrontEnd] = FrontEnd.COMMAND | FrontEnd.PYTHON

    export_to: str | None = option(
        converter=optional(PathKind("DIR", written=True)),
        default=None,
        help="Also write the results as runs of MLflow, one for each point with its parameters and metrics, to this "
        "folder (mlruns), which is replaced as a whole.",
    )


@options
class PageOptions(Options):
    """A self-contained page about a result, which any browser opens without network or scripts."""

    section: ClassVar[str] = "Page"
    requirements: ClassVar[tuple[OptionRequirement, ...]] = (
        OptionRequirement("embed_up_to", "html", "the page that embeds the files"),
    )

    html: str | None = option(
        converter=optional(PathKind(written=True)),
        default=None,
        help="Page about the result (.html): plots, images, videos, descriptions of columns, assertions and manifests.",
    )
    embed_up_to: float = option(
        converter=RealKind(metavar="MB"),
        default=10.0,
        help="Embed images and videos up to this size in the page; larger ones are linked.",
    )
