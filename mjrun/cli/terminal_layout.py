"""Layout of tables and labelled lines, fitted to the width of the terminal; unlimited without a terminal."""

import os
import sys
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import zip_longest

from rich.cells import cell_len, chop_cells
from rich.console import Console as Terminal
from rich.padding import Padding
from rich.text import Text

from mjrun.cli.table_cells import ReportColumn

GAP, INDENT = 2, 2
READABLE = 100  # characters of a line of labels and values
NARROW, SCANT = 24, 8  # least width of a folded text: if columns can be left out, and if not
CELL = 1000  # characters of a cell that are shown
STEMS = " │├└─"  # characters before the names in a tree
NEEDED = 2  # columns that are never left out
UNLIMITED = 1 << 16


class TerminalReport:
    """A report for the terminal: titled tables and lines, which are collected first."""

    def __init__(self) -> None:
        self._terminal = _terminal()
        self._empty = True
        self._text = ""

    def table(
        self, title: str, columns: Sequence[ReportColumn], rows: int, shown: int | None = None, hint: str = ""
    ) -> None:
        """Adds a table with its title and number of rows; `shown` limits the rows."""
        cut = rows if shown is None else min(rows, shown)
        self._title(title, str(rows) if rows else "none")
        room = self._terminal.width - INDENT
        short = [replace(column, cells=[_cut(cell) for cell in column.cells[:cut]]) for column in columns]
        fitting, left_out = _fitting(short, room)
        if cut:
            self._rows(fitting, _widths(fitting, room))
        if cut < rows:
            self._note(f"… {rows - cut} more: {hint}")
        if left_out:
            self._note(f"no room for {', '.join(column.heading for column in left_out)}; --json has them")

    def lines(self, title: str, pairs: Sequence[tuple[str, str]], about: str = "") -> None:
        """Adds labels and values under a title, without empty values. Words, such as paths, are never broken."""
        self._title(title, about)
        shown = [(label, _cut(value)) for label, value in pairs if value]
        begin = INDENT + max((cell_len(label) for label, _ in shown), default=0) + GAP
        room = max(1, min(self._terminal.width, READABLE) - begin)
        for label, value in shown:
            lines = textwrap.wrap(value, room, break_long_words=False, break_on_hyphens=False)
            for index, line in enumerate(lines):
                head = f"{' ' * INDENT}{'' if index else label}"
                padding = " " * (begin - cell_len(head))
                self._print(
                    Text.assemble((head, "dim"), padding, line), max(self._terminal.width, begin + cell_len(line))
                )

    def verbatim(self, title: str, lines: Iterable[str]) -> None:
        """Adds lines under a title without folding them, so that commands can be copied."""
        self._title(title, "")
        self._text += "".join(f"{' ' * INDENT}{line}\n" for line in lines)

    def note(self, text: str) -> None:
        """Adds a line, after a blank one unless it is the first."""
        if self._text:
            self._print(Text(""))
        self._print(Text(text, style="dim"))

    def text(self) -> str:
        """Returns the page, with colours if standard output is a terminal that supports them."""
        lines = self._text.removesuffix("\n").split("\n")
        return "\n".join(lines if self._terminal.is_terminal else [line.rstrip() for line in lines])

    def _rows(self, columns: Sequence[ReportColumn], widths: Sequence[int]) -> None:
        """Adds a table without its title; cells that are wider than their column are folded."""
        height = max(len(column.unit.split("\n")) if column.unit else 0 for column in columns)
        folded = [self._folded(_heading(column, height), width) for column, width in zip(columns, widths, strict=True)]
        for line in _lines(columns, widths, folded):
            self._print(Text(line, style="dim"), max(self._terminal.width, cell_len(line)))
        for i, cells in enumerate(zip(*(column.cells for column in columns), strict=True)):
            folded = [
                _folded_branch(cell, column.below[i], width) if column.below else self._folded(cell, width)
                for column, cell, width in zip(columns, cells, widths, strict=True)
            ]
            height = max(map(len, folded))
            for column, lines, width in zip(columns, folded, widths, strict=True):
                lines += [column.below[i][:width]] * (height - len(lines)) if column.below else []
            self._text += "".join(f"{line}\n" for line in _lines(columns, widths, folded))

    def _folded(self, cell: str, width: int) -> list[str]:
        """Folds a text to lines of a width, between words where possible."""
        if cell_len(cell) <= width and "\n" not in cell:
            return [cell]
        return [line.plain for line in Text(cell).wrap(self._terminal, width, overflow="fold")]

    def _title(self, title: str, about: str) -> None:
        if not self._empty:
            self._print(Text(""))
        self._empty = False
        self._print(Text.assemble((title, "bold"), "  ", (about, "dim")))

    def _note(self, text: str) -> None:
        self._print(Padding(Text(text, style="dim"), (0, 0, 0, INDENT), expand=False))

    def _print(self, what: object, width: int | None = None) -> None:
        own = self._terminal.width
        self._terminal.width = width or own  # otherwise printing is limited to the terminal's width
        with self._terminal.capture() as printed:
            self._terminal.print(what)
        self._terminal.width = own
        self._text += printed.get()


def terminal_width() -> int:
    """Returns the width of the terminal, or `COLUMNS`; unlimited without either."""
    return _terminal().width


def folded_words(text: str, width: int, first: str, others: str) -> list[str]:
    """Folds a text between words, with a beginning of the first line and one of the others; words are never broken."""
    if len(first) + cell_len(text) <= width:
        return [first + text]
    return textwrap.wrap(
        text, width, initial_indent=first, subsequent_indent=others, break_long_words=False, break_on_hyphens=False
    )


def _terminal() -> Terminal:
    terminal = Terminal(file=sys.stdout, highlight=False, markup=False, emoji=False)
    columns = os.environ.get("COLUMNS", "")
    if not terminal.is_terminal and not (columns.isdecimal() and int(columns)):
        terminal.width = UNLIMITED
    return terminal


def _lines(columns: Sequence[ReportColumn], widths: Sequence[int], cells: Sequence[Sequence[str]]) -> list[str]:
    """Returns the lines of a row, each of whose cells has some lines, from its top."""
    made = list[str]()
    for parts in zip_longest(*cells, fillvalue=""):
        spaces = [" " * (width - cell_len(part)) for part, width in zip(parts, widths, strict=True)]
        padded = [
            space + part if column.right else part + space
            for column, part, space in zip(columns, parts, spaces, strict=True)
        ]
        made.append((" " * INDENT + (" " * GAP).join(padded)).rstrip())
    return made


def _folded_branch(cell: str, below: str, width: int) -> list[str]:
    """Folds a name in a tree by characters; every line of it stands right of the stems, which continue as `below`."""
    name = cell.lstrip(STEMS)
    start = len(cell) - len(name)
    first, *others = chop_cells(name, max(1, width - start)) or [""]
    return [cell[:start] + first, *(below.ljust(start)[:start] + part for part in others)]


def _fitting(columns: Sequence[ReportColumn], width: int) -> tuple[list[ReportColumn], list[ReportColumn]]:
    """Returns the columns that are not blank: those that fit, and those that do not."""
    filled = [column for column in columns if any(column.cells)]
    main = [column for column in filled if not column.extra]
    fitting = [*main]
    while len(fitting) > NEEDED and _total(map(_readable_width, fitting)) > width:
        paired = fitting.pop().paired
        if paired and len(fitting) > NEEDED:
            fitting.pop()
    room = width - _total(map(_width, fitting)) if fitting == main else 0
    for column in filled:
        if column.extra and _width(column) + GAP <= room:
            fitting.append(column)
            room -= _width(column) + GAP
    return [column for column in filled if column in fitting], [column for column in filled if column not in fitting]


def _cut(cell: str) -> str:
    """Cuts a long cell in the middle."""
    half = CELL // 2
    return cell if len(cell) <= CELL else f"{cell[:half]}…{cell[-half:]}"


def _total(widths: Iterable[int]) -> int:
    """Returns the total width of columns side by side."""
    return sum(width + GAP for width in widths) - GAP


def _readable_width(column: ReportColumn) -> int:
    """Returns the width at which a column is easy to read."""
    if column.right:  # a heading may be folded, and numbers may not
        return max(_cell_width(column), min(_width(column), SCANT))
    return min(_width(column), NARROW)


def _width(column: ReportColumn) -> int:
    return max(_cell_width(column), *map(cell_len, _heading(column, 0).split("\n")))


def _cell_width(column: ReportColumn) -> int:
    return max(map(cell_len, column.cells), default=0)


def _widths(columns: Sequence[ReportColumn], room: int) -> list[int]:
    """Returns the widths of the columns; texts that do not fit are folded, those of the first column last."""
    widths = [_width(column) for column in columns]
    texts = [i for i, column in enumerate(columns) if i and not column.right and not column.whole]
    every = [i for i, column in enumerate(columns) if not column.whole]
    first = [i for i in every[:1] if not columns[i].below]
    numbers = [i for i, column in enumerate(columns) if column.right]
    folded = [(texts, NARROW), (first, NARROW), (numbers, SCANT), (first, SCANT), (texts, SCANT), (every, 1)]
    for group, least in folded:
        limits = [max(least, _cell_width(column) if group is numbers else 0) for column in columns]
        while _total(widths) > room and (wide := [i for i in group if widths[i] > limits[i]]):
            widths[max(wide, key=lambda i: widths[i])] -= 1
    return widths


def _heading(column: ReportColumn, height: int) -> str:
    """Formats a heading over `height` lines of units."""
    units = [f"[{unit}]" for unit in column.unit.split("\n")] if column.unit else []
    return "\n".join([column.heading, *units, *[""] * (height - len(units))])
