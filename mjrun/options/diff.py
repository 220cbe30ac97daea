"""Options of the command `diff`."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

from mjrun.options.kinds import FlagKind, OneOrMoreKind, PathKind, TextKind, optional
from mjrun.options.number_kinds import Numbers, PercentKind, RealKind
from mjrun.options.option import Options, option, options
from mjrun.options.report import PageOptions
from mjrun.options.schema_validation import InvalidValueError, Schema
from mjrun.options.setting_kinds import NamedNumbersKind

ALIGNMENTS = ("time", "row")
NO_TOLERANCES: dict[str, Numbers] = {}
TOLERANCE: Schema = {"type": "number", "minimum": 0}


class ColumnTolerancesKind(NamedNumbersKind):
    """Tolerances by column name with wildcards, absolute as in `qvel/*=1e-6`, or also relative as in
    `qvel/*=1e-6,1e-3`.
    """

    metavar = "COLUMNS=ATOL[,RTOL]"

    @property
    def form(self) -> Schema:
        both: Schema = {"type": "array", "items": TOLERANCE, "minItems": 1, "maxItems": 2}
        each: Schema = {"anyOf": [TOLERANCE, both], "forms": "a number or a list of numbers"}
        return {"type": "object", "additionalProperties": each}

    def __call__(self, value: Mapping[str, float | Sequence[float]]) -> Mapping[str, Numbers]:
        tolerances = super().__call__(value)
        for pattern, numbers in tolerances.items():
            _require_tolerance(numbers, f"{pattern}={','.join(map(str, numbers))}")
        return tolerances

    def parse(self, text: str) -> tuple[str, Numbers]:
        try:
            pattern, numbers = super().parse(text)
        except InvalidValueError:
            raise InvalidValueError("COLUMNS=ATOL or COLUMNS=ATOL,RTOL, as in 'qvel/*=1e-6' or '*=1e-6'") from None
        _require_tolerance(numbers)
        return pattern, numbers


def _require_tolerance(numbers: Numbers, text: str | None = None) -> None:
    if len(numbers) not in (1, 2) or not all(number >= 0 for number in numbers):
        raise InvalidValueError("an absolute tolerance, or an absolute and a relative one, of at least 0", text)


@options
class ToleranceOptions(Options):
    """Tolerances within which numbers count as equal."""

    section: ClassVar[str] = "Tolerances"

    atol: float = option(
        converter=RealKind(metavar="ATOL"),
        default=0.0,
        help="Absolute tolerance: numbers and pixels count as equal if |a - b| <= ATOL + RTOL·|b|. If both "
        "tolerances are 0, they must be identical bit for bit; NaN equals NaN.",
    )
    rtol: float = option(converter=RealKind(metavar="RTOL"), default=0.0, help="Relative tolerance.")
    tol: Mapping[str, Numbers] = option(
        converter=ColumnTolerancesKind(),
        default=NO_TOLERANCES,
        help="Tolerances for single columns, by name or wildcard: 'qvel/*=1e-6', 'energy/*=0,1e-9'. If several "
        "match, the last one applies. The tolerance of the column time determines which times count as equal.",
    )


@options
class TableDiffOptions(ToleranceOptions):
    """Comparison of tables and recordings."""

    section: ClassVar[str] = "Tables and recordings"

    columns: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("COLUMNS")),
        default=(),
        usual="all",
        help="Compare only these columns, by name or wildcard, such as 'qpos/*'.",
    )
    align: str | None = option(
        converter=optional(TextKind("time|row|COLUMN[,COLUMN]...")),
        default=None,
        usual="time, if both have it",
        help="How rows are paired: time pairs rows with equal times, row pairs rows with equal numbers, and column"
        " names pair rows with equal values in those columns, in any order. Points of studies are paired by "
        "their parameters, and episodes by their seeds.",
    )
    common: bool = option(
        converter=FlagKind(),
        default=False,
        help="Compare only rows and columns that exist on both sides; the others are counted, but not treated as "
        "differences.",
    )
    model: str | None = option(
        converter=optional(PathKind("MODEL")),
        default=None,
        help="Model of the two recordings, so that the report can name joints.",
    )


@options
class PictureDiffOptions(Options):
    """Thresholds at which videos and images count as equal."""

    section: ClassVar[str] = "Videos and images"

    min_psnr: float | None = option(
        converter=optional(RealKind(metavar="DB")),
        default=None,
        usual="exact",
        help="Lowest peak signal-to-noise ratio at which frames count as equal [dB]; 40 is visually identical.",
    )
    min_ssim: float | None = option(
        converter=optional(RealKind(least=-1.0, most=1, metavar="SSIM")),
        default=None,
        usual="exact",
        help="Lowest structural similarity (SSIM) at which frames count as equal; 0.98 is visually identical. "
        "Requires the extra diff.",
    )
    max_changed: float | None = option(
        converter=optional(PercentKind(most=1)),
        default=None,
        usual="exact",
        help="Largest share of changed pixels at which frames count as equal, such as 0.1%.",
    )
    output: str | None = option(
        converter=optional(PathKind(written=True)),
        default=None,
        short="-o",
        help="Image (.png) of the most different frame: A, B and their difference side by side.",
    )


@options
class DiffOptions(TableDiffOptions, PictureDiffOptions, PageOptions):
    """All options of a comparison."""

    section: ClassVar[str] = "Comparison"
