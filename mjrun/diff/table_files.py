"""Compares two files of tables, of any formats: which columns, by which key, within which tolerances."""

from collections.abc import Collection, Mapping, Sequence
from contextlib import ExitStack
from functools import partial

from mjrun.diff.provenance import provenance_notes
from mjrun.diff.result import TableDifference
from mjrun.diff.tables import compare_rows
from mjrun.diff.tolerances import Tolerance, Tolerances, matches, require_matches
from mjrun.errors import CellError, UsageError, clean, listing, option
from mjrun.formats.table_reader import STDIN, TableReader, open_table
from mjrun.options.diff import TableDiffOptions

TIME = "time"


def compare_tables(a: str, b: str, options: TableDiffOptions) -> tuple[TableDifference, list[str]]:
    """Compares the columns that two tables have in common.

    Args:
      a, b: files, of which one may be `-`, standard input.

    Returns:
      How they differ, and what may be the reason of it, in sentences.

    Raises:
      FileError: a file cannot be read as a table, has no rows, or its time falls.
      UnknownNameError: a wildcard matches no column.
      UsageError: the tables have no columns in common, or cannot be aligned as asked for.
    """
    if a == b == STDIN:
        raise UsageError("only one of the two can come from standard input")
    with ExitStack() as stack:
        (reader_a, names_a), (reader_b, names_b) = _open_both(a, b, options, stack)
        require_matches("columns", options.columns, dict.fromkeys([*names_a, *names_b]))
        key = _key(names_a, names_b, options)
        columns = [name for name in reader_a.names if name != key and _is_chosen(name, options)]
        if not columns:
            raise UsageError(_nothing_in_common({a: names_a, b: names_b}, options))

        tolerances = Tolerances(Tolerance(options.atol, options.rtol), options.tol)
        tolerances.require([*columns, *([key] if key else [])])
        chosen_a, chosen_b = ([name for name in names if _is_chosen(name, options)] for names in (names_a, names_b))
        skip = partial(reader_a.skip_equal_rows, reader_b)
        try:
            table = compare_rows(reader_a, reader_b, columns, key, tolerances, chosen_a, chosen_b, skip)
        except CellError as error:
            error.add_note(f"{option('columns')} chooses columns; others may hold anything")
            raise
        return table, provenance_notes(reader_a.manifest, reader_b.manifest)


def _open_both(a: str, b: str, options: TableDiffOptions, stack: ExitStack) -> list[tuple[TableReader, list[str]]]:
    """Opens both with the columns that they have in common, each beside the names of all of its columns."""
    first, second = (b, a) if b == STDIN else (a, b)  # standard input can be opened once only
    second_names, first_names = _names(second), list[str]()
    others = set(second_names)

    def is_common(name: str) -> bool:
        first_names.append(name)
        return name in others and (name == TIME or _is_chosen(name, options))

    reader = stack.enter_context(open_table(first, is_common, missing="nan"))
    other = stack.enter_context(open_table(second, reader.names, missing="nan"))
    both = [(reader, first_names), (other, second_names)]
    return both[::-1] if b == STDIN else both


def _names(path: str) -> list[str]:
    """All columns of a file."""
    names: list[str] = []

    def collect(name: str) -> bool:
        names.append(name)
        return False

    open_table(path, collect).close()
    return names


def _is_chosen(name: str, options: TableDiffOptions) -> bool:
    return not options.columns or any(matches(name, pattern) for pattern in options.columns)


def _key(names_a: Collection[str], names_b: Collection[str], options: TableDiffOptions) -> str | None:
    """The column that tells which rows belong together."""
    has_time = TIME in names_a and TIME in names_b
    if options.align == "time" and not has_time:
        raise UsageError(f"{option('align')} time: only a table with a column 'time' can be aligned by it")
    return TIME if has_time and options.align != "row" else None


def _nothing_in_common(names: Mapping[str, Sequence[str]], options: TableDiffOptions) -> str:
    which = f" that {option('columns')} chooses" if options.columns else ""
    besides = " but time" if all(TIME in each for each in names.values()) else ""
    lists = [f"{clean(path)}: {listing(each) or 'none'}" for path, each in names.items()]
    return "\n".join([f"the tables have no columns{which} in common{besides}", *lists])
