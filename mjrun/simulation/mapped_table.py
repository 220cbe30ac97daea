"""Tables whose columns are named or mapped: column names, values of expressions, and motions of models."""

from collections.abc import Hashable, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import TypeVar

import mujoco
import numpy as np

from mjrun.errors import UsageError, clean, option
from mjrun.formats.table_reader import open_table
from mjrun.physics.kinematic_motion import KinematicMotion
from mjrun.physics.kinematic_samples import Interpolation, KinematicSamples
from mjrun.probe.row_expression import RowExpression
from mjrun.simulation.column_map import TIME, column_map, time_hint
from mjrun.timeline import seconds

K = TypeVar("K", bound=Hashable)


def column_names(path: str | Path) -> list[str]:
    """Returns the names of all columns of a table.

    Raises:
      FileError: the table cannot be read.
    """
    names = list[str]()

    def note(name: str) -> bool:
        names.append(name)
        return False

    with open_table(path, note):
        return names


def evaluated(path: str | Path, expressions: Mapping[K, RowExpression]) -> dict[K, np.ndarray]:
    """Evaluates expressions on all rows of a table, `(n,)` each; NaN where a cell is missing.

    Columns that no expression reads are not loaded; the others are loaded block by block.

    Raises:
      FileError: the table cannot be read.
    """
    evaluators = {key: expression.evaluator() for key, expression in expressions.items()}
    parts: dict[K, list[np.ndarray]] = {key: [np.empty(0)] for key in expressions}
    read = list(dict.fromkeys(name for expression in expressions.values() for name in expression.columns))
    with open_table(path, read or column_names(path)[:1], missing="nan") as table:  # one column, to count the rows
        for block in table.blocks():
            columns = dict(zip(table.names, block.T, strict=True))
            for key, evaluator in evaluators.items():
                parts[key].append(evaluator.feed(columns))
    return {key: np.concatenate(blocks) for key, blocks in parts.items()}


def read_motion(
    path: Path,
    model: mujoco.MjModel,
    start: mujoco.MjData,
    texts: Sequence[str] = (),
    quat: str = "wxyz",
    rate: Fraction | None = None,
    interpolation: Interpolation | None = None,
) -> KinematicMotion:
    """Reads the motion of `model` from a table.

    Args:
      start: state of everything that the table does not contain.
      texts: map, as in `column_map`.
      quat: order of quaternions whose components are not named.
      rate: rows per second [Hz] of a table without times.
      interpolation: interpolation between rows.

    Raises:
      UsageError: the table has no positions of this model or no times, or is not a motion; or the map is invalid.
      FileError: the table cannot be read.
    """
    names = column_names(path)
    mapped = column_map(model, names, texts, quat, str(path))
    if mapped.time is None and rate is None:
        raise UsageError(f"{clean(str(path))} has no column 'time'\n{time_hint(names)}")
    if mapped.time is not None and rate is not None:
        raise UsageError(
            f"{clean(str(path))} has a column 'time', and {option('replay_rate')} is for tables without one\n"
            f"{option('map')} can specify another time: time=EXPRESSION"
        )
    expressions = {(field, i): source for field, sources in mapped.sources.items() for i, source in sources.items()}
    values = evaluated(path, expressions if mapped.time is None else {**expressions, (TIME, 0): mapped.time})
    if rate is None:
        times = values.pop((TIME, 0))
    else:
        times = np.array(seconds(np.arange(len(next(iter(values.values())))), 1 / rate), float)
    by_field = dict[str, dict[int, np.ndarray]]()
    for (field, index), numbers in values.items():
        by_field.setdefault(field, {})[index] = numbers
    return KinematicMotion(model, start, KinematicSamples(str(path), times, mapped.columns, by_field), interpolation)
