"""Parsers of the options that describe a figure: panels and their curves, marks, and logarithmic axes.

qpos/*                              a panel of all columns that match the wildcard
qpos/knee, qpos/hip                 a panel of two curves
depth [mm]=penetration/deepest*1000 a curve with its own name and unit
forces [N]: contact_force/*         a panel with its own title and unit
"""

import math
import re
from collections.abc import Callable, Iterator, Sequence
from fnmatch import fnmatchcase
from typing import TypeVar

from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, UnknownNameError, UsageError, concerning, option, quoted
from mjrun.model.table_column import split_unit
from mjrun.options.number_kinds import RangeKind
from mjrun.options.schema_validation import InvalidValueError
from mjrun.probe.expression import ColumnReference
from mjrun.probe.row_expression import RowExpression, parse_row_expression
from mjrun.probe.scanner import QUOTES, spelled
from mjrun.probe.vocabularies import TableVocabulary

T = TypeVar("T")

_TITLE = re.compile(r"""\s*((?:[^:='`"]|:(?!\s))+?)\s*:\s+(.*)""", re.DOTALL)
_LABEL = re.compile(r"""\s*([^='`"]*[^='`"\s])\s*(?<![<>!])=(?!=)(.*)""", re.DOTALL)
# Neither a product of two values nor a column in quotes.
_WILDCARD = re.compile(r"""[^\s()'`"]*(?:/\*|\*/|\?)[^\s()'`"]*|\*[^\s()'`"]*|[^\s()'`"]*\*""")
_OPENING, _CLOSING = "([", ")]"
_PANEL = re.compile(r"\s*([1-9][0-9]{0,3}):(.*)", re.DOTALL)


@dataclass(frozen=True)
class CurveSpec:
    """The specification of a curve over the columns of a table.

    Attributes:
      name: name in the legend.
      unit: unit of its values; None for the column's.
      expression: expression for its values.
      column: name of the column if the curve is an unchanged column.
    """

    name: str
    unit: str | None
    expression: RowExpression
    column: str | None


@dataclass(frozen=True)
class PanelSpec:
    """The specification of a panel: its title and unit, if specified, and its curves."""

    title: str | None
    unit: str | None
    curves: tuple[CurveSpec, ...]


@dataclass(frozen=True)
class ReferenceLine:
    """A line at a value: horizontal, or vertical at a value of x.

    Attributes:
      panel: the only panel with this line, counted from 1; None for all.
    """

    label: str
    value: float
    vertical: bool = False
    panel: int | None = None


def parse_panel(text: str, columns: Sequence[str], x: str | None = None) -> PanelSpec:
    """Parses a panel of a table with `columns`.

    Args:
      x: the column of the x axis, which wildcards omit.

    Raises:
      UnknownNameError, UsageError: a column is unknown, or an expression is malformed.
    """
    title = unit = None
    if text not in columns and (titled := _TITLE.fullmatch(text)):
        (title, unit), text = split_unit(titled[1]), titled[2]
    curves = [curve for part in _split(text, columns) for curve in parse_curves(part, columns, option("y"), x)]
    if not curves:
        raise BadValueError(option("y"), text, "a column, a wildcard or an expression")
    return PanelSpec(title, unit, tuple(curves))


def parse_curves(text: str, columns: Sequence[str], label: str, x: str | None = None) -> list[CurveSpec]:
    """Parses one part of a panel's text: several curves, without x, for a wildcard or a group."""
    if text in columns:  # of any name, such as one that ends with a space
        return [_of_column(text)]
    text = text.strip()
    if text in columns:
        return [_of_column(text)]
    named = _LABEL.fullmatch(text)
    if named and named[1].count("(") <= named[1].count(")"):  # otherwise `=` is within a call
        name, unit = split_unit(named[1])
        inner = parse_curves(named[2], columns, label, x)
        if len(inner) != 1:
            raise UsageError(f"{label}: {quoted(named[2].strip())} matches {len(inner)} columns, but has one name")
        return [CurveSpec(name, unit if unit is not None else inner[0].unit, inner[0].expression, inner[0].column)]
    matching = [name for name in columns if fnmatchcase(name, text) or name.startswith(f"{text}/")]
    matching = [name for name in matching if name != x] or matching
    if matching:
        return [_of_column(name) for name in matching]
    if _WILDCARD.fullmatch(text):
        raise UnknownNameError("column", text, columns, where=label)
    expression = parse_row_expression(text, TableVocabulary(columns), label)
    if isinstance(expression.root, ColumnReference):  # in quotes
        return [_of_column(expression.root.name)]
    return [CurveSpec(text, None, expression, None)]


def parse_reference_line(text: str) -> ReferenceLine:
    """Parses a mark: `m·g=87.356`, `2:m·g=87.356`, `x:impact=0.52`, or `0.5`, which is its own label.

    Raises:
      BadValueError: the text is not a mark.
    """
    vertical, panel, rest = False, None, text
    if text.startswith("x:"):
        vertical, rest = True, text[2:]
    elif numbered := _PANEL.fullmatch(text):
        panel, rest = int(numbered[1]), numbered[2]
    label, _, value = rest.rpartition("=")
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise BadValueError(option("mark"), text, "a NUMBER or LABEL=NUMBER; prefix x: for a vertical line")
    return ReferenceLine(label.strip() or value.strip(), number, vertical, panel)


def parse_log(texts: Sequence[str], panels: int) -> tuple[bool, frozenset[int]]:
    """Returns whether x is logarithmic, and the panels, counted from 0, whose y is.

    Raises:
      BadValueError: a text is not x, y or both, or the panel does not exist.
    """
    log_x, log_y = False, set[int]()
    for index, text in enumerate(texts):
        with concerning("log", index):
            numbered = _PANEL.fullmatch(text)
            axes = numbered[2].strip() if numbered else text
            if axes not in (("y",) if numbered else ("x", "y", "both")):
                raise BadValueError(option("log"), text, "x, y, both, or y of one panel as in 2:y")
            log_x |= axes in ("x", "both")
            if axes != "x":
                log_y |= {panel_index(int(numbered[1]), panels, "log")} if numbered else set(range(panels))
    return log_x, frozenset(log_y)


def parse_ylim(texts: Sequence[str], panels: int) -> dict[int, tuple[float, float]]:
    """Returns the ranges of y axes by panel; raises BadValueError if a text is not a range."""
    return _by_panel("ylim", texts, panels, RangeKind().parse)


def parse_ylabel(texts: Sequence[str], panels: int) -> dict[int, str]:
    """Returns the labels of y axes by panel."""
    return _by_panel("ylabel", texts, panels, str.strip)


def _by_panel(name: str, texts: Sequence[str], panels: int, parse: Callable[[str], T]) -> dict[int, T]:
    """Returns the values of an option by panel, counted from 0; the value of one panel precedes that of all.

    Raises:
      UsageError: the figure has fewer panels.
    """
    everywhere, own = dict[int, T](), dict[int, T]()
    for index, text in enumerate(texts):
        with concerning(name, index):
            numbered = _PANEL.fullmatch(text)
            try:
                value = parse(numbered[2] if numbered else text)
            except InvalidValueError as error:
                raise BadValueError(option(name), text, error.expected) from None
            if numbered:
                own[panel_index(int(numbered[1]), panels, name)] = value
            else:
                everywhere = dict.fromkeys(range(panels), value)
    return everywhere | own


def parse_marks(texts: Sequence[str], panels: int) -> list[ReferenceLine]:
    """Parses marks of a figure with these panels.

    Raises:
      BadValueError: a text is not a mark.
      UsageError: the figure has fewer panels.
    """
    marks: list[ReferenceLine] = []
    for index, text in enumerate(texts):
        with concerning("mark", index):
            marks.append(parse_reference_line(text))
            if marks[-1].panel is not None:
                panel_index(marks[-1].panel, panels, "mark")
    return marks


def panel_index(number: int, panels: int, name: str) -> int:
    """Returns the index of a panel from its number, counted from 1, in the option `name`.

    Raises:
      UsageError: the figure has fewer panels.
    """
    if number > panels:
        raise UsageError(f"{option(name)}: panel {number} does not exist; the last is {panels}")
    return number - 1


def _of_column(name: str) -> CurveSpec:
    return CurveSpec(name, None, parse_row_expression(spelled(name), [name], option("y")), name)


def _split(text: str, columns: Sequence[str]) -> Iterator[str]:
    """Yields the parts between commas outside of quotes, parentheses and brackets."""
    if text in columns:
        yield text
        return
    depth, quote, start = 0, "", 0
    for index, character in enumerate(text):
        if quote:
            quote = "" if character == quote else quote
        elif character in QUOTES:
            quote = character
        elif character in _OPENING:
            depth += 1
        elif character in _CLOSING:
            depth -= 1
        elif character == "," and depth <= 0:
            yield text[start:index]
            start = index + 1
    if text[start:].strip() or not start:
        yield text[start:]
