"""Columns of report tables: texts, numbers, vectors and ranges with their units; and lines of verdicts."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from mjrun.dataclass import dataclass
from mjrun.errors import clean

if TYPE_CHECKING:
    from mjrun.experiment.statistics import Interval
    from mjrun.probe.verdict import Verdict

UNITS = ("B", "KiB", "MiB", "GiB")


@dataclass(frozen=True)
class ReportColumn:
    """One column of a table, which is hidden if all its cells are blank.

    Attributes:
      heading: the title of the column.
      cells: one cleaned text per row.
      unit: the line below the heading, or several lines if the unit varies.
      right: align cells to the right, as for numbers.
      extra: omit the column if the table is too wide. The last extra columns are omitted first, then the other columns
        from the last.
      below: the continuation of each cell if its row has several lines.
      whole: never fold cells, as for paths.
      paired: omit the column before it, too, if there is no room for this one, as for two values to compare.
    """

    heading: str
    cells: Sequence[str]
    unit: str = ""
    right: bool = False
    extra: bool = False
    below: Sequence[str] = ()
    whole: bool = False
    paired: bool = False


def number(value: float | None) -> str:
    """Formats a number with five significant digits; empty for None."""
    return "" if value is None else f"{value + 0:.5g}"


def interval_text(interval: "Interval") -> str:
    """Formats a confidence interval; empty if it is undefined."""
    return "" if interval.low is None else f"{number(interval.low)}..{number(interval.high)}"


def vector(values: Iterable[float] | None) -> str:
    """Formats numbers as in MJCF."""
    return "" if values is None else " ".join(map(number, values))


def span(limits: Sequence[float] | None) -> str:
    """Formats a range, `-1.5..0.2`; empty without limits."""
    return "" if limits is None else "..".join(map(number, limits))


def slots(start: int | None, count: int) -> str:
    """Formats indices as a Python slice, `3`, `0:7`; empty without indices."""
    return "" if start is None or not count else str(start) if count == 1 else f"{start}:{start + count}"


def byte_size(count: int | None) -> str:
    """Formats a number of bytes, `1.5 KiB`; `?` if unknown."""
    if count is None:
        return "?"
    power = min(max(count.bit_length() - 1, 0) // 10, len(UNITS) - 1)
    return f"{count / 1024**power:.1f} {UNITS[power]}" if power else f"{count} B"


def reference(kind: str | None, name: str | None) -> str:
    """Formats an object as options name it, `geom/floor`; empty without one."""
    return f"{kind}/{clean(name)}" if name else ""


def common(texts: Iterable[str]) -> str:
    """Lists the distinct texts, separated by commas."""
    return ", ".join(dict.fromkeys(texts))


def short_value(text: str) -> str:
    """Returns a value with a few digits; whole numbers, such as seeds, and texts are unchanged."""
    if text.removeprefix("-").isdecimal() or "_" in text:  # which Python reads as part of a number
        return text
    try:
        return number(float(text))
    except ValueError:
        return text


def verdict_lines(verdicts: Iterable["Verdict"]) -> list[tuple[str, str]]:
    """Returns whether each requirement holds, and its message."""
    return [("holds" if verdict.passed else "FAILS", clean(verdict.message)) for verdict in verdicts]


def texts(heading: str, values: Sequence[str | None], *, extra: bool = False) -> ReportColumn:
    """Returns a column of names or words."""
    return ReportColumn(heading, ["" if value is None else clean(value) for value in values], extra=extra)


def numbers(
    heading: str, values: Sequence[float | None], unit: str = "", *, extra: bool = False, usual: float = 0
) -> ReportColumn:
    """Returns a column of numbers; blank if every row has the usual value."""
    is_usual = all(value is None or value == usual for value in values)
    return ReportColumn(heading, ["" if is_usual else number(value) for value in values], unit, right=True, extra=extra)


def vectors(
    heading: str, values: Sequence[Iterable[float] | None], unit: str = "", *, extra: bool = False
) -> ReportColumn:
    """Returns a column of vectors."""
    return ReportColumn(heading, [vector(value) for value in values], unit, extra=extra)


def ranges(
    heading: str, limits: Sequence[Sequence[float] | None], units: Sequence[str | None] = (), *, extra: bool = False
) -> ReportColumn:
    """Returns a column of ranges, each with the unit of its row, if any."""
    spans = [span(each) for each in limits]
    occurring = [unit for unit, text in zip(units, spans, strict=False) if text]
    return ReportColumn(heading, spans, stacked(occurring), right=True, extra=extra)


def stacked(units: Iterable[str | None]) -> str:
    """Formats the distinct units, one per line, for the heading of a column."""
    return "\n".join(filter(None, dict.fromkeys(units)))
