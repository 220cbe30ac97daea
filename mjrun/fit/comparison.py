"""The table of what was measured beside what a model says, before a fit and after."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from mjrun.fit.shooting import Solution
from mjrun.formats.table_writer import TableWriter
from mjrun.formats.tables import output_format
from mjrun.model.column import Column

TIME = Column("time", "s", "time in the log")
HELD = Column("holdout", meaning="whether the row was held out of the fit", integer=True)
WHICH = {"nominal": "by the model as it was", "fitted": "by the fitted model"}


def write_comparison(
    path: str, signals: Sequence[Column], comparisons: Mapping[tuple[str, str], Solution]
) -> list[str]:
    """Writes the table: a row for each sample, in the order of the logs, and returns its files.

    Args:
      comparisons: of the parts `fitted` and `held`, what the models `nominal` and `fitted` predict.

    Raises:
      FileError: it cannot be written.
    """
    columns = [TIME]
    for signal in signals:
        columns += [signal, *(replace(signal, name=f"{signal.name}/{which}", meaning=WHICH[which]) for which in WHICH)]
    parts = [_rows(part, comparisons) for part in ("fitted", "held") if (part, "fitted") in comparisons]
    rows = np.concatenate(parts)
    with TableWriter(path, output_format(path).name, [*columns, HELD]) as writer:
        writer.write(rows[np.argsort(rows[:, 0], kind="stable")])
        return [str(file) for file in writer.publish()]


def _rows(part: str, comparisons: Mapping[tuple[str, str], Solution]) -> np.ndarray:
    solutions = [comparisons[part, which] for which in WHICH]
    chunks = solutions[0].chunks
    tables: list[np.ndarray] = []
    for index, chunk in enumerate(chunks):
        measured = chunk.values
        predicted = [measured + each.residuals[index] * each.noise for each in solutions]
        table = np.stack([measured, *predicted], axis=-1).reshape(len(measured), -1)
        last = len(measured) - (index + 1 < len(chunks) and chunks[index + 1].segment is chunk.segment)
        times = chunk.segment.times[chunk.rows]
        tables.append(np.column_stack([times, table, np.full(len(times), float(part == "held"))])[:last])
    return np.concatenate(tables)
