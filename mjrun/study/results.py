"""The table of a study: a row for each point, in the order of the points, the same whatever simulated them."""

import re
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from mjrun.formats.atomic_output import publish_together
from mjrun.formats.table_writer import TableWriter
from mjrun.formats.tables import output_format
from mjrun.model.column import Column
from mjrun.study.design import Design, numbers
from mjrun.study.parameters import is_whole
from mjrun.study.simulate import PointResult

FILES = ("results.parquet", "results.csv")
STATUSES = ("ok", "unstable", "failed", "timeout", "crashed", "missing")
FRAME = 8_000  # bytes of a table without rows
BLOCK = 2**12  # rows that are written at a time
_COMPARED = re.compile(r"""\bstatus\s*(==|!=)\s*(["'])(\w+)\2""")
TABLE_COLUMNS = ("point", "status", "steps", "exit_code", "message")  # besides what varies and the metrics


def result_columns(
    design: Design, metrics: Sequence[str], results: Sequence[PointResult]
) -> tuple[list[Column], np.ndarray]:
    """The columns of the table, and its rows `(n, columns)`; texts are indices into the labels of their columns."""
    columns = [Column("point", meaning="number of the point", integer=True)]
    values = [np.arange(len(results), dtype=float)]

    def add(column: Column, numbers: np.ndarray) -> None:
        columns.append(column)
        values.append(numbers)

    for index, name in enumerate(design.names):
        texts = [point[index] for point in design.points]
        as_numbers = numbers(name, texts)
        if as_numbers is None:
            add(*_labelled(name, texts))
        else:
            add(Column(name, meaning="what varies", integer=is_whole(name)), as_numbers)
    for index, name in enumerate(metrics):
        add(Column(name, meaning="metric"), np.array([result.metrics[index] for result in results], float))

    add(*_labelled("status", [result.status for result in results]))
    add(Column("steps", meaning="steps taken", integer=True), np.array([result.steps for result in results], float))
    codes = np.array([result.exit_code for result in results], float)
    add(Column("exit_code", meaning="of this point alone", integer=True), codes)
    add(*_labelled("message", [result.message for result in results]))
    return columns, np.stack(values, axis=1)


def with_flags(text: str) -> str:
    """An expression in which `status == "ok"` is `ok == 1`: each status is a column of ones and zeros.

    No character moves, so that positions in it are those in `text`.
    """

    def flag(compared: re.Match[str]) -> str:
        operator, status = compared[1], compared[3]
        if status not in STATUSES:
            return compared[0]
        return f"{status} == {int(operator == '==')}".ljust(len(compared[0]))

    return _COMPARED.sub(flag, text)


def write_results(
    folder: Path,
    columns: Sequence[Column],
    rows: np.ndarray,
    manifest: Mapping[str, object],
    files: Sequence[str] = FILES,
) -> list[Path]:
    """Writes the table to `files` of the folder, each in the format of its suffix, and returns them.

    Raises:
      FileError: it cannot be written.
    """
    with ExitStack() as stack:
        return publish_together(open_results(stack, folder, columns, rows, manifest, files))


def open_results(
    stack: ExitStack,
    folder: Path,
    columns: Sequence[Column],
    rows: np.ndarray,
    manifest: Mapping[str, object],
    files: Sequence[str] = FILES,
) -> list[TableWriter]:
    """As `write_results`, but they still have to be published; `stack` discards them otherwise."""
    writers = list[TableWriter]()
    for name in files:
        path = str(folder / name)
        writers.append(stack.enter_context(TableWriter(path, output_format(path).name, columns, manifest)))
        for start in range(0, len(rows), BLOCK):
            writers[-1].write(rows[start : start + BLOCK])
    return writers


def table_bytes(design: Design, metrics: int) -> int:
    """About how large the tables of a study are [bytes]: numbers have 8 bytes in one, and their digits in the other."""
    count = len(design.points)
    digits = sum(len(text) + 1 for point in design.points[:1000] for text in point) * count // max(1, min(count, 1000))
    return FRAME + count * 8 * (len(design.names) + metrics) + digits + count * (20 * metrics + 20)


def _labelled(name: str, texts: Sequence[str]) -> tuple[Column, np.ndarray]:
    """A column of texts; an empty one is none."""
    labels = tuple(dict.fromkeys(text for text in texts if text)) or ("",)
    place = {label: index for index, label in enumerate(labels)}
    return Column(name, labels=labels), np.array([place.get(text, -1) if text else -1 for text in texts], float)
