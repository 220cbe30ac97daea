"""The groups of the columns that a model offers, for lists that fit on a page."""

from collections.abc import Iterable, Sequence

from mjrun.dataclass import dataclass
from mjrun.model.table_column import Column


@dataclass(frozen=True)
class ColumnGroup:
    """The columns whose names begin with the same word.

    Attributes:
      name: that word, by which a probe selects all of them.
      columns: the columns, in order.
    """

    name: str
    columns: Sequence[Column]

    def texts(self, attribute: str) -> list[str]:
        """Returns the different texts of an attribute of the columns, in order, without empty ones."""
        return [text for text in dict.fromkeys(getattr(column, attribute) for column in self.columns) if text]


def column_groups(columns: Iterable[Column]) -> list[ColumnGroup]:
    """Returns the groups of columns, in the order of their first columns."""
    groups: dict[str, list[Column]] = {}
    for column in columns:
        groups.setdefault(column.name.partition("/")[0], []).append(column)
    return [ColumnGroup(name, members) for name, members in groups.items()]
