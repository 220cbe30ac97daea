"""Options of the command `diff`."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

from mjrun.options.kinds import (
    ExpectedError,
    File,
    Flag,
    Numbers,
    Optional,
    Percent,
    Real,
    Several,
    Text,
    Values,
)
from mjrun.options.option import FrontEnd, Options, option, options

ALIGNMENTS = ("time", "row")
NO_TOLERANCES: dict[str, Numbers] = {}


class ColumnTolerances(Values):
    """Tolerances by the columns that a wildcard matches: `qvel/*=1e-6`, or with a relative one, `qvel/*=1e-6,1e-3`."""

    metavar = "COLUMNS=ATOL[,RTOL]"

    def __call__(self, value: Mapping[str, float | Sequence[float]]) -> Mapping[str, Numbers]:
        tolerances = super().__call__(value)
        for numbers in tolerances.values():
            _require_tolerance(numbers)
        return tolerances

    def parse(self, text: str) -> tuple[str, Numbers]:
        try:
            pattern, numbers = super().parse(text)
        except ExpectedError:
            raise ExpectedError("COLUMNS=ATOL or COLUMNS=ATOL,RTOL, as in 'qvel/*=1e-6'") from None
        _require_tolerance(numbers)
        return pattern, numbers


def _require_tolerance(numbers: Numbers) -> None:
    if len(numbers) not in (1, 2) or not all(number >= 0 for number in numbers):
        raise ExpectedError("an absolute tolerance, or an absolute and a relative one, from 0 on")


@options
class ToleranceOptions(Options):
    """When numbers agree."""

    section: ClassVar[str] = "Tolerances"

    atol: float = option(
        converter=Real(metavar="ATOL"),
        default=0.0,
        help="Numbers, and pixels, agree where |a - b| <= ATOL + RTOL·|b|. With 0 and 0 they must be the same, bit for "
        "bit; NaN agrees with NaN.",
    )
    rtol: float = option(converter=Real(metavar="RTOL"), default=0.0, help="The relative tolerance.")
    tol: Mapping[str, Numbers] = option(
        converter=ColumnTolerances(),
        default=NO_TOLERANCES,
        help="Tolerances for the columns that a name with wildcards matches: 'qvel/*=1e-6', 'energy/*=0,1e-9'; the "
        "last that matches counts. That of time says which times are the same.",
    )


@options
class TableDiffOptions(ToleranceOptions):
    """How tables and recordings are compared."""

    section: ClassVar[str] = "Tables and recordings"

    columns: tuple[str, ...] = option(
        converter=Several(Text("COLUMNS")),
        default=(),
        usual="all",
        help="Compare only columns that a name with wildcards matches, such as 'qpos/*'.",
    )
    align: str | None = option(
        converter=Optional(Text("time|row|COLUMN[,COLUMN]...")),
        default=None,
        usual="time, where both have it",
        help="Which rows belong together: those of the same time, of the same number (row), or with the same cells in "
        "named columns, in any order. Points of studies belong together by their parameters, episodes by their seeds.",
    )
    common: bool = option(
        converter=Flag(),
        default=False,
        help="Compare only the rows and columns that both have; others are counted, and make no difference.",
    )
    model: str | None = option(
        converter=Optional(File("MODEL")), default=None, help="The model of two recordings, which names their joints."
    )


@options
class PictureDiffOptions(Options):
    """When videos and images agree."""

    section: ClassVar[str] = "Videos and images"

    min_psnr: float | None = option(
        converter=Optional(Real(metavar="DB")),
        default=None,
        usual="exact",
        help="Frames agree down to this peak signal-to-noise ratio [dB]; 40 looks the same.",
    )
    min_ssim: float | None = option(
        converter=Optional(Real(least=-1.0, most=1, metavar="SSIM")),
        default=None,
        usual="exact",
        help="Frames agree down to this structural similarity; 0.98 looks the same. Needs the extra diff.",
    )
    max_changed: float | None = option(
        converter=Optional(Percent(most=1)),
        default=None,
        usual="exact",
        help="Frames agree up to this share of pixels that changed: 0.1%.",
    )
    output: str | None = option(
        converter=Optional(File(written=True)),
        default=None,
        short="-o",
        help="Draw the worst frame: A, B and their difference side by side (.png).",
    )


@options
class DiffOptions(TableDiffOptions, PictureDiffOptions):
    """What is compared, and when it agrees."""

    section: ClassVar[str] = "Comparison"


@options
class DiffReportOptions(Options):
    """What is printed."""

    section: ClassVar[str] = "Report"

    github: bool = option(
        converter=Flag(), default=False, places=FrontEnd.COMMAND, help="Annotations of a GitHub workflow on stdout."
    )
