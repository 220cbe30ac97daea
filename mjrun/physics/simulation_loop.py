"""The simulation loop, which takes each step once and serves any number of taps, and the states that taps record.

Recorded states are stored in memory or on disk, replayed instead of physics, or their inputs are applied to physics.
"""

import copy
import heapq
import math
import tempfile
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import groupby, takewhile
from operator import itemgetter
from types import MappingProxyType
from typing import Any, Protocol, cast

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import FileError, UsageError, clean, listing, option, quoted
from mjrun.model import state
from mjrun.physics.stepper import Stepper, derive, instant_of
from mjrun.timeline import rational


@dataclass(frozen=True)
class Tap:
    """A cadence, and what is recorded at its steps.

    Attributes:
      steps: the steps, in non-decreasing order; at a repeated step it records twice.
      record: reads from the stepper, without changing it, and stores or writes the values; videos and images store
        states, with `StateBuffer.record`.
    """

    steps: Sequence[int]
    record: Callable[[Stepper], object]


def run_with_taps(stepper: Stepper, taps: Sequence[Tap], until: int) -> None:
    """Moves `stepper` to step `until`, and serves every tap on the way.

    Taps of the same step read the same instant; none reads a step beyond `until`. Observation does not change the
    motion: it is bit for bit that of a run without taps.

    Raises:
      SimulationError: a step fails; everything recorded before is valid.
    """
    looks = takewhile(lambda look: look[0] <= until, heapq.merge(*map(_schedule, taps), key=itemgetter(0)))
    for step, due in groupby(looks, key=itemgetter(0)):
        stepper.advance(step)
        for _, tap in due:
            tap.record(stepper)
    stepper.advance(until)


def _schedule(tap: Tap) -> Iterator[tuple[int, Tap]]:
    return ((step, tap) for step in tap.steps)


SLEEP = int(mujoco.mjtEnableBit.mjENBL_SLEEP)
FAR = 1000  # the most steps from a recorded state to the next that are repeated
ALIKE = 1e-4  # relative: times of states are sums of floats
SPILL = 2**20  # bytes of states in memory; more go to disk
AHEAD = 50  # steps that are searched for a change of inputs


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


class StateBuffer(SpooledRows):
    """A buffer of integration states `(nstate,)` of one model."""

    def __init__(self, model: mujoco.MjModel) -> None:
        super().__init__(state.size(model))
        self.model = model

    def record(self, stepper: Stepper) -> None:
        """Adds the state of the stepper at the end."""
        self.append(stepper.state())

    @property
    def steps(self) -> np.ndarray:
        """The steps of the states `(n,)`, of a recording of every step."""
        return np.arange(self._count)

    def state(self, index: int) -> np.ndarray:
        """Returns state number `index` as a new array."""
        return self[index].copy()


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


class ReplayStepper:
    """A stepper along recorded states, with a copy of `model`.

    Every state is bit for bit the recorded one, and every instant that of the recorded simulation, if MuJoCo and the
    machine are the same. States do not include which bodies sleep: where bodies may sleep, every step is repeated from
    the recorded state to find out, and the next recorded state replaces the result. Where inputs changed between two
    recorded states, a body that slept may be awake.

    Args:
      facts: the facts of the recording, which may state the layout of its states.
      simulated: whether the states come from physics, in which bodies may sleep, or from a table.

    Raises:
      UsageError: the recording was made with another model, or of another timestep.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        states: RecordedStates,
        facts: Mapping[str, Any] = MappingProxyType({}),
        simulated: bool = True,
    ) -> None:
        require_model(model, states, facts)
        if simulated:
            require_timestep(model, states)
        self._source = "recording" if simulated else "table"
        self.model = copy.copy(model)
        self.step = 0
        self._states, self._steps = states, states.steps
        self._timestep = rational(model.opt.timestep)
        self._sleeps = simulated and bool(model.opt.enableflags & SLEEP)
        self._data = mujoco.MjData(self.model)
        self._instant = mujoco.MjData(self.model)
        self._instant_step = -1
        self._initial: mujoco.MjData | None = None
        self._put(0)

    def require(self, steps: Sequence[int]) -> None:
        """Checks that all of `steps` are recorded.

        Raises:
          UsageError: one is missing; the message names the first.
        """
        for step in steps:
            self._find(step)

    def advance(self, step: int) -> None:
        """Moves forward to `step`, which must not be before the current step.

        Raises:
          UsageError: the step is not recorded.
        """
        if step < self.step:
            raise ValueError(f"cannot go back from step {self.step} to step {step}")
        index = self._find(step)
        if self._sleeps:
            for following in range(self._index + 1, index + 1):
                self._follow(following)
        elif index != self._index:
            self._put(index)

    def state(self) -> np.ndarray:
        """Returns the recorded state at `self.step` as a new array `(nstate,)`."""
        return self._state.copy()

    def instant(self) -> mujoco.MjData:
        """Returns an MjData in which every field belongs to `self.step`; it must not be kept or changed.

        Raises:
          FailedStepError: MuJoCo raised an error.
        """
        if self._instant_step != self.step:
            derive(self.model, self._data, self._instant, self.step)
            self._instant_step = self.step
        return self._instant

    def initial(self) -> mujoco.MjData:
        """Returns an MjData in which every field belongs to step 0, at any current step; it must not be changed."""
        self._initial = self._initial or instant_of(self.model, self._states.state(0))
        return self._initial

    def _put(self, index: int) -> None:
        """Moves to a state. MuJoCo wakes bodies in it that move, or have moved since they fell asleep."""
        self._index, self.step = index, int(self._steps[index])
        self._state = self._states.state(index)
        state.restore(self.model, self._data, self._state)

    def _follow(self, index: int) -> None:
        """Moves to the next state through physics, so that bodies fall asleep and wake up as in the simulation."""
        count = int(self._steps[index]) - self.step
        try:
            mujoco.mj_step(self.model, self._data, nstep=min(count, FAR))
        except mujoco.FatalError:
            self._data = mujoco.MjData(self.model)  # the old one is in the middle of a step
        self._put(index)

    def _find(self, step: int) -> int:
        """Returns the index of the state at `step`."""
        steps = self._steps
        index = bisect_left(steps, step)
        if index == len(steps):
            last = int(steps[-1])
            raise UsageError(
                f"the {self._source} ends at {self._place(last)}, before {self._place(step)}\n"
                f"request step {last} or an earlier one"
            )
        if steps[index] != step:
            before = f"{self._place(int(steps[index - 1]))}, and "
            raise UsageError(
                f"{self._place(step)} is not in the {self._source}\n"
                f"the nearest recorded ones: {before if index else ''}{self._place(int(steps[index]))}"
            )
        return index

    def _place(self, step: int) -> str:
        return f"step {step}, time {float(step * self._timestep):.9g} s"


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
