"""What differs, in a sentence each."""

from collections.abc import Iterator, Sequence

from mjrun.diff.result import CellDifference, ColumnDifference, GoldenFacts, TableDifference, UnmatchedRows
from mjrun.errors import clean, counted, listing, option, quoted


def table_sentences(table: TableDifference, a: str, b: str, what: str = "row", *, common: bool = False) -> list[str]:
    """What differs between two tables or recordings.

    Args:
      a, b: what they are called.
      what: a row or a state.
      common: whether only rows and columns that both have count.
    """
    if common:
        of_one = [] if table.rows else [f"no {what} is in both"]
    else:
        of_one = [
            *_columns_of_one(table.columns_only_a, a),
            *_columns_of_one(table.columns_only_b, b),
            *_rows_of_one(table.only_a, a, table.aligned, what),
            *_rows_of_one(table.only_b, b, table.aligned, what),
        ]
    return [
        *of_one,
        *(f"the unit of {quoted(unit.name)} is {clean(unit.a)} in {a}, {clean(unit.b)} in {b}" for unit in table.units),
        *(_column(column, table, what) for column in table.columns if column.first),
    ]


def place(cell: CellDifference, aligned: str) -> str:
    """Where a number that differs is: `row 207, time 0.412 s`."""
    if aligned == "step":
        return f"step {cell.at:.0f}"
    row = f"row {cell.row}" if cell.row == cell.row_b else f"rows {cell.row} and {cell.row_b}"
    if cell.key:
        return f"{row}, {cell.key}"
    return row if cell.at is None else f"{row}, time {cell.at!r} s"


def golden_versions(golden: GoldenFacts) -> str:
    """Which versions made a golden table, and which simulate now."""
    made = ", ".join(f"{name} {v}" for name, v in (("mjrun", golden.mjrun), ("MuJoCo", golden.mujoco)) if v)
    now = f"mjrun {golden.mjrun_now}, MuJoCo {golden.mujoco_now}"
    if made == now:
        return f"both are of {now}"
    return f"it is of {clean(made) or 'unknown versions'}, this is {now}"


def _columns_of_one(names: Sequence[str], where: str) -> Iterator[str]:
    if names:
        count = "1 column is" if len(names) == 1 else f"{len(names)} columns are"
        yield f"{count} in {where} only: {listing(names)}"


def _rows_of_one(rows: UnmatchedRows, where: str, aligned: str, what: str) -> Iterator[str]:
    if rows.count:
        count = f"1 {what} is" if rows.count == 1 else f"{rows.count} {what}s are"
        first = "" if rows.count == 1 else "the first is "
        yield f"{count} in {where} only: {first}{unmatched_place(rows, aligned)}"


def unmatched_place(rows: UnmatchedRows, aligned: str) -> str:
    """Where the first of them is."""
    if rows.at is None:
        return f"row {rows.first}{', ' if rows.key else ''}{rows.key}"
    return f"step {rows.at:.0f}" if aligned == "step" else f"row {rows.first}, time {rows.at!r} s"


def _column(column: ColumnDifference, table: TableDifference, what: str) -> str:
    assert column.first
    where = place(column.first, table.aligned)
    often = f"in {column.differing} of {table.rows} {what}s, first in" if column.differing > 1 else "in"
    a, b = cell_texts(column, column.first)
    return f"{clean(column.name)} differs {often} {where}: {a}, not {b}"


def cell_texts(column: ColumnDifference, cell: CellDifference) -> tuple[str, str]:
    """The two cells of a column as messages show them: texts in quotes."""
    return (quoted(cell.a), quoted(cell.b)) if column.text else (cell.a, cell.b)


def shared_sentence(table: TableDifference, what: str = "row") -> str:
    """That what both tables have agrees, although they differ; empty if it does not."""
    if not table.shared_agree:
        return ""
    both = f"{counted(table.rows, what)} and {counted(len(table.columns), 'column')}"
    return f"the {both} that both have agree; {option('common')} compares nothing else"
