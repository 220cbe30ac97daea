"""The comparison of recordings: their states step by step, in memory that does not grow with their length."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from mjrun.diff.result import TableDifference
from mjrun.diff.sentences import manifest_part, provenance_notes
from mjrun.diff.tables import compare_rows
from mjrun.diff.tolerances import Tolerance, Tolerances, matches, require_matches
from mjrun.errors import UsageError, clean, option
from mjrun.formats.recording import RecordingReader
from mjrun.model import state
from mjrun.options.diff import TableDiffOptions
from mjrun.probe.fields import state_columns

STEP = "step"


class _RecordedRows:
    """The states of a recording as rows, after a column with their steps."""

    def __init__(self, recording: RecordingReader, names: Sequence[str]) -> None:
        self.path: Path = recording.path
        self.names = [STEP, *names]
        self.units: Mapping[str, str] = {}
        self._recording = recording

    def blocks(self) -> Iterator[np.ndarray]:
        """Yields blocks of float64 `(n, 1 + size)`."""
        for steps, states in self._recording.blocks():
            yield np.column_stack([steps, states])


def compare_recordings(
    a: str, b: str, options: TableDiffOptions, model: mujoco.MjModel | None = None
) -> tuple[TableDifference | None, list[str], list[str]]:
    """Compares the states of the same steps.

    Args:
      model: the model whose joints name the numbers of a state; without it, they have their index in their field:
        `qpos/3`.

    Returns:
      The differences of the states, None if their sizes differ; other differences; and possible reasons, in sentences.

    Raises:
      FileError: a file is not a complete recording.
      UnknownNameError: a wildcard matches no number of the state.
      UsageError: an option does not apply to recordings, or they do not belong to `model`.
    """
    with ExitStack() as stack:
        one, other = (stack.enter_context(RecordingReader(path)) for path in (a, b))
        notes = provenance_notes(one.facts, other.facts)
        if differences := _size_differences(one, other, clean(a), clean(b)):
            return None, differences, notes

        names = _names(one, model)
        require_matches("columns", options.columns, names)
        chosen = [n for n in names if not options.columns or any(matches(n, pattern) for pattern in options.columns)]
        tolerances = Tolerances(Tolerance(options.atol, options.rtol), options.tol)
        tolerances.require(chosen)
        rows = _RecordedRows(one, names), _RecordedRows(other, names)
        return compare_rows(*rows, chosen, STEP, tolerances, chosen, chosen), [], notes


def _names(recording: RecordingReader, model: mujoco.MjModel | None) -> list[str]:
    """Returns the names of the numbers of a state."""
    sizes = recorded_sizes(recording.facts)
    if model is not None:
        ours = state.sizes(model)
        others = [f"{name} is {sizes[name]}, not {ours[name]}" for name in sizes if sizes[name] != ours[name]]
        if others or recording.size != state.size(model):
            facts = f": {', '.join(others)}" if others else ""
            raise UsageError(f"{option('model')}: the recordings were made with another model{facts}")
        return state_columns(model)

    names = [
        "time" if field == "time" else f"{field}/{i}"
        for field, part in (state.fields(sizes) if sizes else {}).items()
        for i in range(part.stop - part.start)
    ]
    return names if len(names) == recording.size else [f"state/{i}" for i in range(recording.size)]


def recorded_sizes(facts: Mapping[str, Any]) -> dict[str, int]:
    """Returns the sizes of the recorded model; empty unless the untrusted recording has all of them."""
    sizes = manifest_part(facts, "sizes")
    if not all(type(sizes.get(name)) is int for name in state.SIZES):
        return {}
    return {name: sizes[name] for name in state.SIZES}


def _size_differences(one: RecordingReader, other: RecordingReader, a: str, b: str) -> list[str]:
    """Returns a sentence for each difference in the sizes of two models."""
    first, second = recorded_sizes(one.facts), recorded_sizes(other.facts)
    pairs = [(name, first[name], second[name]) for name in first if second]
    differing = [f"{name} is {x} in {a}, {y} in {b}" for name, x, y in pairs if x != y]
    if not differing and one.size != other.size:
        differing = [f"a state has {one.size} numbers in {a}, {other.size} in {b}"]
    return differing
