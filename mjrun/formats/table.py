"""A table in memory: columns of numbers with units."""

import html
from collections.abc import Iterator, Sequence
from dataclasses import field
from importlib import import_module
from typing import Any

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UnknownNameError, clean, counted
from mjrun.model.table_column import with_unit
from mjrun.packages import require

SHOWN_COLUMNS, SHOWN_ROWS = 20, 5  # in a notebook; the rows at either end


@dataclass(frozen=True, eq=False)
class NumericTable:
    """Columns of numbers, each with a unit: `table["qpos/knee"]`, `table.units["qpos/knee"]`.

    Iterating yields the names of the columns, in the order of the file.

    Attributes:
      columns: columns float64 `(n,)`, by name.
      units: units by name, as in `m/s`; empty for pure numbers, and where a file states no units.
    """

    columns: dict[str, np.ndarray]
    units: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "units", {name: self.units.get(name, "") for name in self.columns})

    @property
    def names(self) -> list[str]:
        """The names of the columns, in the order of the file."""
        return list(self.columns)

    def __getitem__(self, name: str) -> np.ndarray:
        """Returns the column `name`.

        Raises:
          UnknownNameError: it is missing; the message lists the columns.
        """
        if name not in self.columns:
            raise UnknownNameError("column", name, self.names)
        return self.columns[name]

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def __len__(self) -> int:
        """Returns the number of columns."""
        return len(self.columns)

    @property
    def rows(self) -> int:
        """The number of rows."""
        return len(next(iter(self.columns.values()), ()))

    def to_dict(self) -> dict[str, list[float]]:
        """Returns the columns as lists of numbers."""
        return {name: column.tolist() for name, column in self.columns.items()}

    def to_pandas(self) -> Any:
        """Returns a pandas.DataFrame; its `attrs` contain the units.

        Raises:
          MissingExtraError: pandas is not installed.
        """
        frame = _library("pandas").DataFrame(self.columns)
        frame.attrs["units"] = dict(self.units)
        return frame

    def to_polars(self) -> Any:
        """Returns a polars.DataFrame.

        Raises:
          MissingExtraError: polars is not installed.
        """
        return _library("polars").DataFrame(self.columns)

    def __repr__(self) -> str:
        names = [clean(with_unit(name, unit)) for name, unit in self.units.items()]
        width = max((len(name) for name in names[:SHOWN_COLUMNS]), default=0)
        lines = [f"Table of {counted(self.rows, 'row')} and {counted(len(self), 'column')}"]
        for name, column in zip(names[:SHOWN_COLUMNS], self.columns.values(), strict=False):
            span = f"{np.nanmin(column):.6g} to {np.nanmax(column):.6g}" if np.isfinite(column).any() else "no numbers"
            lines.append(f"  {name:{width}}  {span}")
        hidden = len(self) - SHOWN_COLUMNS
        return "\n".join([*lines, *([f"  … and {counted(hidden, 'column')} more"] if hidden > 0 else [])])

    def to_html(self) -> str:
        """Returns the first and last rows as an HTML table, which notebooks show."""
        shown = list(self.columns)[:SHOWN_COLUMNS]
        rows = range(self.rows)
        texts = [(html.escape(name), html.escape(self.units[name])) for name in shown]
        heads = "".join(f"<th>{name}<br/><small>{unit}</small></th>" for name, unit in texts)
        lines = [self._html_row(row, shown) for row in rows[:SHOWN_ROWS]]
        if self.rows > 2 * SHOWN_ROWS:
            lines.append(f"<tr>{'<td>…</td>' * len(shown)}</tr>")
        lines += [self._html_row(row, shown) for row in rows[max(SHOWN_ROWS, self.rows - SHOWN_ROWS) :]]
        hidden = f", of which {len(shown)} are shown" if len(shown) < len(self) else ""
        size = f"{counted(self.rows, 'row')}, {counted(len(self), 'column')}{hidden}"
        return f"<table><thead><tr>{heads}</tr></thead><tbody>{''.join(lines)}</tbody></table><p>{size}</p>"

    def _repr_html_(self) -> str:
        return self.to_html()

    def _html_row(self, row: int, names: Sequence[str]) -> str:
        return f"<tr>{''.join(f'<td>{self.columns[name][row]:.6g}</td>' for name in names)}</tr>"


def _library(name: str) -> Any:
    """Imports a library that mjrun does not require."""
    require(f"Table.to_{name}", "", name)
    return import_module(name)
