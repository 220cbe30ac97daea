"""Columns of the tables of reports: texts, numbers, vectors and ranges with their units."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from mjrun.errors import clean

UNITS = ("B", "KiB", "MiB", "GiB")


@dataclass(frozen=True)
class Column:
    """One column of a table; it is not shown where all its cells are blank.

    Attributes:
      heading: what it holds.
      cells: of every row; cleaned.
      unit: under the heading, a line for each that occurs.
      right: whether cells are aligned to the right, as numbers are.
      extra: whether it is left out where there is no room. The last extra columns are left out first, and after them
        the other columns, from the last.
      below: what continues each cell where its row takes several lines.
      whole: whether its cells are never folded, as paths are not.
    """

    heading: str
    cells: Sequence[str]
    unit: str = ""
    right: bool = False
    extra: bool = False
    below: Sequence[str] = ()
    whole: bool = False


def number(value: float | None) -> str:
    """A number with five significant digits; nothing for None."""
    return "" if value is None else f"{value + 0:.5g}"


def vector(values: Iterable[float] | None) -> str:
    """Numbers side by side, as MJCF writes them."""
    return "" if values is None else " ".join(map(number, values))


def span(limits: Sequence[float] | None) -> str:
    """A range, `-1.5..0.2`; nothing without limits."""
    return "" if limits is None else "..".join(map(number, limits))


def slots(start: int | None, count: int) -> str:
    """Where numbers are in a vector, as Python would slice it: `3`, `0:7`; nothing where there are none."""
    return "" if start is None or not count else str(start) if count == 1 else f"{start}:{start + count}"


def byte_size(count: int | None) -> str:
    """A number of bytes, `1.5 KiB`; `?` where it is not known."""
    if count is None:
        return "?"
    power = min(max(count.bit_length() - 1, 0) // 10, len(UNITS) - 1)
    return f"{count / 1024**power:.1f} {UNITS[power]}" if power else f"{count} B"


def reference(kind: str | None, name: str | None) -> str:
    """An object as the options of mjrun call it: `geom/floor`; nothing without one."""
    return f"{kind}/{clean(name)}" if name else ""


def common(texts: Iterable[str]) -> str:
    """The different texts, separated by commas."""
    return ", ".join(dict.fromkeys(texts))


def texts(heading: str, values: Sequence[str | None], *, extra: bool = False) -> Column:
    """A column of names or words."""
    return Column(heading, ["" if value is None else clean(value) for value in values], extra=extra)


def numbers(
    heading: str, values: Sequence[float | None], unit: str = "", *, extra: bool = False, usual: float = 0
) -> Column:
    """A column of numbers; blank where every row has the usual one."""
    is_usual = all(value is None or value == usual for value in values)
    return Column(heading, ["" if is_usual else number(value) for value in values], unit, right=True, extra=extra)


def vectors(heading: str, values: Sequence[Iterable[float] | None], unit: str = "", *, extra: bool = False) -> Column:
    """A column of vectors."""
    return Column(heading, [vector(value) for value in values], unit, extra=extra)


def ranges(
    heading: str, limits: Sequence[Sequence[float] | None], units: Sequence[str | None] = (), *, extra: bool = False
) -> Column:
    """A column of ranges, each in the unit of its row, if it has one."""
    spans = [span(each) for each in limits]
    occurring = [unit for unit, text in zip(units, spans, strict=False) if text]
    return Column(heading, spans, stacked(occurring), right=True, extra=extra)


def stacked(units: Iterable[str | None]) -> str:
    """The different units, a line each, as a column shows them."""
    return "\n".join(filter(None, dict.fromkeys(units)))
