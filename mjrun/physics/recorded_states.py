"""Recorded states: where they are stored, the model and the times that they fit, and the inputs that they include."""

import math
import tempfile
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from fractions import Fraction
from types import MappingProxyType
from typing import Any, Protocol, cast

import mujoco
import numpy as np

from mjrun.errors import FileError, UsageError, clean, listing, option, quoted
from mjrun.model import state
from mjrun.timeline import rational

SPILL = 2**20  # bytes of states in memory; more go to disk
AHEAD = 50  # steps that are searched for a change of inputs
ALIKE = 1e-4  # relative: times of states are sums of floats


class RecordedStates(Protocol):
    """Recorded integration states."""

    @property
    def steps(self) -> np.ndarray | range:
        """The step of each state, `(n,)` integers, n ≥ 1, ascending from 0."""
        ...

    @property
    def size(self) -> int:
        """The length of a state."""
        ...

    def state(self, index: int) -> np.ndarray:
        """Returns state number `index` as a new array `(size,)`."""
        ...


class SpooledRows:
    """A list of rows of `size` numbers, in the order they were added; a long one is on the disk."""

    def __init__(self, size: int) -> None:
        self.size = size
        self._file = tempfile.SpooledTemporaryFile(max_size=SPILL)  # noqa: SIM115  (closed by close)
        self._count = 0

    def append(self, row: np.ndarray) -> None:
        """Adds one row at the end.

        Raises:
          FileError: the disk is full.
        """
        self.extend(row[None])

    def extend(self, rows: np.ndarray) -> None:
        """Adds `rows` `(n, size)` at the end.

        Raises:
          FileError: the disk is full.
        """
        if rows.shape[1:] != (self.size,):
            raise ValueError(f"a row has {self.size} numbers, not {rows.shape[1:]}")
        try:
            self._file.seek(8 * self.size * self._count)
            self._file.write(np.ascontiguousarray(rows, np.float64).tobytes())
        except OSError as error:
            where = tempfile.tempdir or "no folder"  # tempfile sets it when it opens the file on disk
            hint = "set TMPDIR to another folder"
            raise FileError(where, f"cannot store the recording: {error.strerror or error}", hint) from None
        self._count += len(rows)

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: int) -> np.ndarray:
        if not 0 <= index < self._count:
            raise IndexError(index)
        return self.read(index, 1)[0]

    def read(self, start: int, count: int) -> np.ndarray:
        """Returns the rows from `start`, `(count, size)`, fewer at the end."""
        count = min(count, self._count - start)
        self._file.seek(8 * self.size * start)
        return np.frombuffer(self._file.read(8 * self.size * count), np.float64).reshape(count, self.size)

    def close(self) -> None:
        """Frees the memory or the file."""
        self._file.close()


class RecordedInputs:
    """All recorded inputs of a simulation: controls, applied forces, mocap poses. The last ones hold to the end."""

    def __init__(self, model: mujoco.MjModel, states: RecordedStates) -> None:
        self._states, self._nu = states, model.nu
        start = state.controls(model).start
        self._part = slice(start, start + state.size(model, state.INPUTS))  # controls come first
        self._recent: dict[int, np.ndarray] = {}

    def apply(self, ctrl: np.ndarray, first: int, timestep: Fraction) -> None:
        """Writes the controls of the steps from `first` into `ctrl` `(n, nu)`."""
        for index in range(len(ctrl)):
            ctrl[index] = self.at(first + index)[: self._nu]

    def at(self, step: int) -> np.ndarray:
        """Returns the inputs at `step`, in the order of `state.INPUTS`."""
        if step not in self._recent:
            if len(self._recent) > 2 * AHEAD:
                self._recent.clear()
            index = bisect_right(self._states.steps, step) - 1
            self._recent[step] = self._states.state(index)[self._part]
        return self._recent[step]

    def next_change(self, step: int) -> int:
        """Returns a step after `step` up to which all inputs except controls are constant."""
        others = self.at(step)[self._nu :]
        for following in range(step + 1, step + AHEAD):
            if not np.array_equal(self.at(following)[self._nu :], others):
                return following
        return step + AHEAD


def require_model(
    model: mujoco.MjModel, states: RecordedStates, facts: Mapping[str, Any] = MappingProxyType({})
) -> None:
    """Checks that `states` may be states of `model`; `facts` of a recording may state their layout.

    Raises:
      UsageError: the recording was made with another model.
    """
    ours, recorded = state.sizes(model), facts.get("sizes")
    theirs = cast("Mapping[str, Any]", recorded if isinstance(recorded, Mapping) else {})  # a recording is untrusted
    differing = [name for name in state.SIZES if theirs.get(name, ours[name]) != ours[name]]
    if differing:
        texts = [f"{name} {clean(str(theirs[name]))}, not {ours[name]}" for name in differing]
        raise UsageError(f"the recording was made with another model: it has {'; '.join(texts)}")
    if states.size != state.size(model):
        texts = [f"{name} {size}" for name, size in ours.items() if size]
        raise UsageError(
            f"the recording was made with another model: its states have {states.size} numbers, "
            f"those of this model {state.size(model)}\nthis model has {listing(texts)}"
        )
    if moved := moved_name(facts, state.layout(model)):
        kind, name, there, here = moved
        raise UsageError(
            f"the recording was made with another model: {kind} {quoted(name)} is number {there} in it, not {here}\n"
            "replay a trace of it instead, made with its own model: tables assign positions by name"
        )


def moved_name(first: Mapping[str, Any], second: Mapping[str, Any]) -> tuple[str, str, int, int] | None:
    """Returns a joint, actuator or mocap body that has different places in the states of two models.

    Args:
      first, second: what `state.layout` returns, or the facts of a recording, which are untrusted.

    Returns:
      Its kind, its name and its places, counted from 0; None if all have the same place.
    """
    for kind in ("joint", "actuator", "mocap body"):
        one, other = (_places(facts.get("names"), kind) for facts in (first, second))
        for name, place in one.items():
            if other.get(name, place) != place:
                return kind, name, place, other[name]
    return None


def _places(names: object, kind: str) -> dict[str, int]:
    """Returns the place of each name of a kind; empty if untrusted facts lack them."""
    owners = cast("Mapping[str, object]", names).get(kind) if isinstance(names, Mapping) else None
    if not isinstance(owners, list):
        return {}
    return {name: place for place, name in enumerate(cast("list[object]", owners)) if isinstance(name, str)}


def require_timestep(model: mujoco.MjModel, states: RecordedStates) -> None:
    """Checks that `states` are as far apart in time as the steps of `model`.

    Raises:
      UsageError: the recording was made with another timestep.
    """
    last = len(states.steps) - 1
    if not last:
        return
    begin, end = (float(states.state(index)[0]) for index in (0, last))  # the time is first in a state
    timestep = (end - begin) / int(states.steps[last])
    if not math.isclose(timestep, model.opt.timestep, rel_tol=ALIKE):
        raise UsageError(
            f"the recording was made with a timestep of {timestep:.6g} s, not {model.opt.timestep:g} s\n"
            f"set {option('timestep')} to that of the recording, or use the recorded model"
        )


def states_at(states: RecordedStates, timestep: Fraction, times: Sequence[float | Fraction]) -> list[np.ndarray]:
    """Returns the last recorded state at or before each of `times` [s]; the first one before the beginning.

    Args:
      timestep: the timestep of the recording [s]; step k is at k·timestep.
      times: a float represents any number that rounds to it, so that the time of a step selects that step.
    """
    rows: list[np.ndarray] = []
    before, steps = -1, states.steps
    for time in times:
        index = max(0, bisect_right(steps, _step(time, timestep)) - 1)
        rows.append(rows[-1] if index == before else states.state(index))
        before = index
    return rows


def _step(time: float | Fraction, timestep: Fraction) -> int:
    """Returns the last step at or before `time`."""
    step = math.floor(rational(time) / timestep)
    return step + (isinstance(time, float) and float((step + 1) * timestep) <= time)
