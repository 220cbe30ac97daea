"""Rows that belong together by the cells of some columns, in any order, as the points of two studies do."""

from collections.abc import Iterator, Sequence

import numpy as np

from mjrun.diff.alignment import Pairs, Rows
from mjrun.diff.cells import cell_text
from mjrun.diff.result import UnmatchedRows
from mjrun.errors import clean


class KeyedRows:
    """All rows of a table, by their keys.

    Args:
      columns: those to compare.
      key: the columns whose cells are the key.

    Attributes:
      values: the cells to compare, `(n, columns)`.
      texts: the keys, as messages show them.
      row: how many rows there are.
      unmatched: those without any that belongs to them.
    """

    def __init__(self, table: Rows, columns: Sequence[str], key: Sequence[str]) -> None:
        names, blocks = list(table.names), list(table.blocks())
        rows = np.concatenate(blocks) if blocks else np.empty((0, len(names)))
        self.values = rows[:, [names.index(name) for name in columns]]
        cells = rows[:, [names.index(name) for name in key]].tolist()
        self.texts = [", ".join(f"{clean(n)} = {_text(c)}" for n, c in zip(key, row, strict=True)) for row in cells]
        self.row = len(rows)
        self.unmatched = UnmatchedRows(0, None, None)
        self._places: dict[tuple[str, int], int] = {}
        counts: dict[str, int] = {}
        for index, text in enumerate(self.texts):
            number = counts[text] = counts.get(text, -1) + 1
            self._places[text, number] = index

    def matches(self, other: "KeyedRows") -> tuple[np.ndarray, np.ndarray]:
        """The indices of rows of the same key in both, several of one key in their order; the others are noted."""
        both = [(index, other._places[key]) for key, index in self._places.items() if key in other._places]
        pairs = np.array(sorted(both), int).reshape(-1, 2)
        for rows, matched in ((self, pairs[:, 0]), (other, pairs[:, 1])):
            rows._note_unmatched(np.setdiff1d(np.arange(rows.row), matched))
        return pairs[:, 0], pairs[:, 1]

    def _note_unmatched(self, indices: np.ndarray) -> None:
        if len(indices):
            first = int(indices[0])
            self.unmatched = UnmatchedRows(len(indices), first, None, self.texts[first])


def pairs_by_columns(a: KeyedRows, b: KeyedRows) -> Iterator[Pairs]:
    """The rows of the same key."""
    rows_a, rows_b = a.matches(b)
    if len(rows_a):
        keys = np.array(a.texts, object)[rows_a]
        yield Pairs(a.values[rows_a], b.values[rows_b], rows_a, rows_b, keys)


def _text(cell: float | int | str) -> str:
    """A cell of a key: the same for 3, 3.0 and the text 3, for 0 and -0, and for an empty text and none."""
    if isinstance(cell, str):
        try:
            cell = float(cell)
        except ValueError:
            return clean(str(cell))
    if cell != cell:
        return ""
    whole = cell == int(cell) if abs(cell) < np.inf else False
    return str(int(cell)) if whole else cell_text(cell)
