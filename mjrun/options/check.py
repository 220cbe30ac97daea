"""Options of the command `check`."""

from fractions import Fraction
from typing import ClassVar

from mjrun.options.kinds import ChoiceKind, FlagKind, OneOrMoreKind, PathKind, TextKind, optional
from mjrun.options.number_kinds import AUTO, ExactNumberKind, IntegerKind, ProcessCountKind
from mjrun.options.option import FrontEnd, Options, option, options
from mjrun.options.setting_kinds import SettingsKind

# The extra, with the libraries that it installs and the feature that needs them.
EXTRAS = {"coacd": (("coacd",), "a convex decomposition")}
SEVERITIES = ("error", "warning", "note")


@options
class CheckOptions(Options):
    """Rules to apply to models, and their limits."""

    section: ClassVar[str] = "Check"

    select: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("CODE"), commas=True, expected="a code, or how several begin"),
        default=(),
        help="Report only findings with these codes: MJ301, or MJ3 for all codes that begin with it.",
    )
    ignore: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("CODE"), commas=True, expected="a code, or how several begin"),
        default=(),
        help="Do not report findings with these codes. Errors that prevent a model from loading are always reported.",
    )
    ignore_in: tuple[tuple[str, str], ...] = option(
        converter=SettingsKind("PATTERN=CODES", "tests/*=MJ2,MJ301"),
        default=(),
        help="Do not report findings with these codes in files whose path matches a pattern; * also matches slashes.",
    )
    severity: tuple[tuple[str, str], ...] = option(
        converter=SettingsKind("CODE=SEVERITY", "MJ301=warning"),
        default=(),
        help="Severity of findings with this code, or codes that begin with it: error, warning or note.",
    )
    threshold: tuple[tuple[str, str], ...] = option(
        converter=SettingsKind("NAME=VALUE", "penetration=0.005"),
        default=(),
        help="Value beyond which a rule reports something: penetration=0.005. The explanation of a rule lists them.",
    )
    fail_on: str = option(
        converter=ChoiceKind(SEVERITIES),
        default="error",
        help="Exit with code 1 if a finding has at least this severity.",
    )
    baseline: str | None = option(
        converter=optional(PathKind()),
        default=None,
        usual="none",
        help="Report only findings that are not in this file of known findings; their lines and numbers may change.",
    )
    update_baseline: bool = option(
        converter=FlagKind(),
        default=False,
        help="Create or replace the baseline with the present findings.",
    )
    changed_since: str | None = option(
        converter=optional(TextKind("REF")),
        default=None,
        usual="all models",
        help="Check only models of which a file, an include or an asset is changed or new in git since the branch "
        "began at REF.",
    )
    fix: bool = option(
        converter=FlagKind(),
        default=False,
        help="Fix what is certain, in the text of the models, and report what is left. A model must load after that, "
        "and change only where it was at fault.",
    )
    unsafe_fixes: bool = option(
        converter=FlagKind(),
        default=False,
        help="Include fixes that need a look, because they change how a model moves; with --fix.",
    )
    dry_run: bool = option(
        converter=FlagKind(),
        default=False,
        help="Only count what --fix would change, and exit with code 1 if anything.",
    )
    skip_other: bool = option(
        converter=FlagKind(),
        default=False,
        help="Skip XML files that are neither MJCF nor URDF, which folders may contain, instead of reporting them.",
    )
    steps: int = option(
        converter=IntegerKind(),
        default=200,
        help="Number of steps to simulate from the initial state, to find out whether the model becomes unstable; "
        "0 skips this check.",
    )
    timeout: Fraction = option(
        converter=ExactNumberKind("SECONDS"), default=60, help="Maximum wall time per model [s]."
    )
    memory: int = option(converter=IntegerKind(1, metavar="MIB"), default=4096, help="Maximum memory per model [MiB].")
    jobs: int | str = option(
        converter=ProcessCountKind(),
        default=AUTO,
        usual="auto, one per core",
        help="Number of models to check at once.",
    )
    cache: bool = option(
        converter=FlagKind(negatable=True),
        default=True,
        help="Reuse earlier results of models whose files, and the settings that affect them, have not changed.",
    )


@options
class CheckReportOptions(Options):
    """Formats of the report, and the source of defaults."""

    section: ClassVar[str] = "Check"
    places: ClassVar[FrontEnd] = FrontEnd.COMMAND

    config: str | None = option(
        converter=optional(PathKind()),
        default=None,
        usual="the nearest mjrun.toml or pyproject.toml with such a section",
        help="TOML file with defaults of these options, in its section [check] or [tool.mjrun.check].",
    )
    list_: bool = option(converter=FlagKind(), default=False, help="List all rules by topic and exit.")
    explain: str = option(
        converter=TextKind("CODE"),
        default="",
        help="Explain a rule and exit: what it finds, why it matters, what to do, and an example.",
    )
    diff: bool = option(
        converter=FlagKind(),
        default=False,
        help="Print what --fix would change as a unified diff, and exit with code 1 if anything.",
    )
    scan: bool = option(
        converter=FlagKind(),
        default=False,
        help="Print a line per model instead of the findings, worst first, and skip other XML files: for folders of "
        "thousands of models. A scan that was interrupted continues.",
    )
    table: str | None = option(
        converter=optional(PathKind(written=True)),
        default=None,
        help="Table with a row per finding, worst models first: .csv, .parquet or another format.",
    )
    html: str | None = option(
        converter=optional(PathKind(written=True)),
        default=None,
        help="Self-contained page (.html) with all findings, fixes, and pictures of the bodies and contacts at fault.",
    )
    json_lines: bool = option(
        converter=FlagKind(),
        default=False,
        help="Print a JSON object per model to stdout when its check ends.",
    )
    statistics: bool = option(
        converter=FlagKind(),
        default=False,
        help="Print the number of findings of each rule instead of the findings.",
    )
    sarif: bool = option(
        converter=FlagKind(),
        default=False,
        help="Print one SARIF 2.1.0 document to stdout, for code scanning.",
    )
