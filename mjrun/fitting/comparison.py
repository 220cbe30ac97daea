"""The table of measured signals beside the predictions of the model before and after a fit."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace

import numpy as np

from mjrun.fitting.shooting_fit import SHORTEST
from mjrun.fitting.shooting_problem import Solution
from mjrun.formats.table_writer import TableWriter
from mjrun.formats.tables import output_format
from mjrun.model.table_column import Column

HORIZON = 8 * SHORTEST  # held-out rows predicted from one initial state
TIME = Column("time", "s", "time in the log")
HELD = Column("holdout", meaning="whether the row was held out of the fit", integer=True)
LOG = Column("log", meaning="index of the table that the row belongs to, from 0", integer=True)
Solutions = Mapping[tuple[str, str], Solution]  # by part, `fitted` or `held`, and model, `nominal` or `fitted`
WHICH = {"nominal": "predicted by the original model", "fitted": "predicted by the fitted model"}


def comparison_columns(signals: Sequence[Column]) -> list[Column]:
    """Returns the columns: time, each signal as measured and predicted, whether it was held out, and its log."""
    columns = [TIME]
    for signal in signals:
        columns += [signal, *(replace(signal, name=f"{signal.name}/{which}", meaning=WHICH[which]) for which in WHICH)]
    return [*columns, HELD, LOG]


def comparison_rows(comparisons: Solutions, logs: Sequence[str]) -> np.ndarray:
    """Returns a row for each sample, in the order of the logs and of time: `(n, columns)`.

    Args:
      comparisons: the predictions.
      logs: names of the measured tables.
    """
    rows = np.concatenate(
        [_rows(part, comparisons, logs) for part in ("fitted", "held") if (part, "fitted") in comparisons]
    )
    return rows[np.lexsort((rows[:, 0], rows[:, -1]))]


def write_comparison(stack: ExitStack, path: str, signals: Sequence[Column], rows: np.ndarray) -> TableWriter:
    """Writes the table, to be published by the caller; `stack` discards it otherwise.

    Raises:
      FileError: the table cannot be written.
    """
    writer = stack.enter_context(TableWriter(path, output_format(path).name, comparison_columns(signals)))
    writer.write(rows)
    return writer


def _rows(part: str, comparisons: Solutions, logs: Sequence[str]) -> np.ndarray:
    solutions = [comparisons[part, which] for which in WHICH]
    chunks = solutions[0].chunks
    tables: list[np.ndarray] = []
    for index, chunk in enumerate(chunks):
        measured = chunk.values
        predicted = [measured + each.residuals[index] * each.noise for each in solutions]
        table = np.stack([measured, *predicted], axis=-1).reshape(len(measured), -1)
        last = len(measured) - (index + 1 < len(chunks) and chunks[index + 1].segment is chunk.segment)
        times = chunk.segment.times[chunk.rows]
        held, log = (np.full(len(times), value) for value in (float(part == "held"), logs.index(chunk.segment.source)))
        tables.append(np.column_stack([times, table, held, log])[:last])
    return np.concatenate(tables)
