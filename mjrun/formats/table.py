"""A table in memory, as it is read from a file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from mjrun.errors import UnknownNameError

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of numbers, each with a unit: `table["qpos/knee"]`, `table.units["qpos/knee"]`.

    Iterating yields the names of the columns, in the order of the file.

    Attributes:
      columns: float64 `(n,)` by name.
      units: by name, as in `m/s`; empty for pure numbers, and in formats that hold no units (.csv, .jsonl).
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
        """The column `name`.

        Raises:
          UnknownNameError: there is none; the message lists those there are.
        """
        if name not in self.columns:
            raise UnknownNameError("column", name, self.names)
        return self.columns[name]

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def __len__(self) -> int:
        """The number of columns."""
        return len(self.columns)
