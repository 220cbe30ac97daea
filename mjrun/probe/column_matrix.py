"""Columns that lie side by side in a matrix, so that vectors of them are parts of it."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np


class ColumnLayout:
    """Where columns are in a matrix.

    Attributes:
      places: by name.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.places = {name: place for place, name in enumerate(names)}
        self.run = cache(self._run)

    def _run(self, names: tuple[str, ...]) -> slice | None:
        """Where the columns `names` stand one after the other; None if they do not."""
        places = [self.places.get(name, -1) for name in names]
        run = slice(places[0], places[0] + len(names))
        return run if places == list(range(run.start, run.stop)) and run.start >= 0 else None


class ColumnMatrix(Mapping[str, Any]):
    """Columns of n rows, each `(n,)`, contiguous; and vectors of them. Those of a single row are numbers of Python.

    Args:
      layout: of the matrix.
      matrix: `(n, columns)`, or `(columns,)`.
      others: columns that are not in it.
    """

    def __init__(self, layout: ColumnLayout, matrix: np.ndarray, others: Mapping[str, Any]) -> None:
        self._layout, self._matrix, self._others = layout, matrix, others
        self._places = layout.places
        self._columns: Any = matrix.tolist() if matrix.ndim == 1 else np.ascontiguousarray(matrix.T)

    def __getitem__(self, name: str) -> Any:
        try:
            return self._columns[self._places[name]]
        except KeyError:
            return self._others[name]

    def __iter__(self) -> Iterator[str]:
        yield from self._layout.places
        yield from self._others

    def __len__(self) -> int:
        return len(self._layout.places) + len(self._others)

    def vector(self, names: tuple[str, ...]) -> np.ndarray:
        """The columns `names` side by side: `(n, len(names))` in C order, of a single row `(len(names),)`."""
        run = self._layout.run(names)
        if run is None:
            return np.stack([self[name] for name in names], axis=-1)
        return np.ascontiguousarray(self._matrix[..., run])
