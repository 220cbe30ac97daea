"""Numbers, names and columns as `mjrun info` writes them."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mjrun.errors import clean

UNITS = ("B", "KiB", "MiB", "GiB")


@dataclass(frozen=True)
class Column:
    """One column of a table; it is not shown where all its cells are blank.

    Attributes:
      heading: what it holds.
      cells: of every row; cleaned.
      unit: under the heading, a line for each that occurs.
      right: the cells are numbers, which end at one place.
      extra: it is the first to be left out where there is no room; the first of these are kept first. After them go
        the others, the last first.
      below: what stands under each cell where its row takes several lines.
    """

    heading: str
    cells: Sequence[str]
    unit: str = ""
    right: bool = False
    extra: bool = False
    below: Sequence[str] = ()


def number(value: float | None) -> str:
    """A number for the eye; nothing for None."""
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


def size(count: int | None) -> str:
    """Bytes for the eye; `?` where they are not known."""
    if count is None:
        return "?"
    power = min(max(count.bit_length() - 1, 0) // 10, len(UNITS) - 1)
    return f"{count / 1024**power:.1f} {UNITS[power]}" if power else f"{count} B"


def reference(kind: str | None, name: str | None) -> str:
    """An object as the options of mjrun call it: `geom/floor`; nothing without one."""
    return f"{kind}/{clean(name)}" if name else ""


def common(texts: Iterable[str]) -> str:
    """What differs among `texts`, each once."""
    return ", ".join(dict.fromkeys(texts))


def texts(heading: str, rows: Sequence[Any], field: str, *, extra: bool = False) -> Column:
    """A column of names or words."""
    values = [getattr(row, field) for row in rows]
    return Column(heading, ["" if value is None else clean(str(value)) for value in values], extra=extra)


def names(rows: Sequence[Any]) -> Column:
    """The names of objects."""
    return texts("name", rows, "name")


def numbers(
    heading: str, rows: Sequence[Any], field: str, unit: str = "", *, extra: bool = False, usual: float = 0
) -> Column:
    """A column of numbers; blank where every row has the usual one."""
    values = [getattr(row, field) for row in rows]
    plain = all(value is None or value == usual for value in values)
    return Column(heading, ["" if plain else number(value) for value in values], unit, right=True, extra=extra)


def vectors(heading: str, rows: Sequence[Any], field: str, unit: str = "", *, extra: bool = False) -> Column:
    """A column of vectors."""
    return Column(heading, [vector(getattr(row, field)) for row in rows], unit, extra=extra)


def ranges(heading: str, rows: Sequence[Any], field: str, unit: str | None = "unit", *, extra: bool = False) -> Column:
    """A column of ranges, each in the unit that the field `unit` of its row tells."""
    spans = [span(getattr(row, field)) for row in rows]
    occurring = [getattr(row, unit) for row, text in zip(rows, spans, strict=True) if text] if unit else []
    return Column(heading, spans, _stacked(occurring), right=True, extra=extra)


def resisting(field: str, rows: Sequence[Any], units: Mapping[str, str], *, extra: bool = False) -> Column:
    """A column of numbers whose unit follows from that of each joint or tendon."""
    occurring = [units.get(row.unit, "") for row in rows if getattr(row, field)]
    return numbers(field, rows, field, _stacked(occurring), extra=extra)


def _stacked(units: Iterable[str]) -> str:
    return "\n".join(filter(None, dict.fromkeys(units)))
