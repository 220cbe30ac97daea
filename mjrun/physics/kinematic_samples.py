"""Samples of a motion in time, some of them missing: checked, completed, differentiated, and as states at any time.

Samples come from motion capture, logs, tables of any simulator. Between them, positions follow a straight line, and
quaternions the shortest arc at constant angular velocity; or all of them hold. At the time of a sample, the state is
that sample.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UsageError, clean, listing
from mjrun.model import state
from mjrun.model.names import BALL, FREE
from mjrun.physics.timed_rows import SLACK, require_times, without_gaps
from mjrun.timeline import rational

# The fields of MjData that samples may contain.
FIELDS = ("qpos", "qvel", "act", "ctrl", "mocap_pos", "mocap_quat")
UNIT_TOLERANCE = 1e-3  # a larger deviation of a quaternion from unit length is reported
EXACT_UNIT = 1e-14  # a smaller one is left unchanged, so that a trace replays bit for bit
LONG = 1.5  # median intervals between samples; a longer one is a gap


@dataclass(frozen=True)
class KinematicSamples:
    """Samples of a motion in a table.

    Attributes:
      source: the name of the table in messages.
      time: the time of each sample [s], `(n,)`.
      columns: names of the columns of each of `FIELDS`, in the order of its numbers.
      values: `(n,)` by field and index, for the columns of the table; NaN where a sample is missing.
    """

    source: str
    time: np.ndarray
    columns: Mapping[str, Sequence[str]]
    values: Mapping[str, Mapping[int, np.ndarray]]

    def missing(self, field: str) -> list[str]:
        """Returns the columns of a field that the table lacks."""
        columns = self.values.get(field, {})
        return [name for index, name in enumerate(self.columns[field]) if index not in columns]


@dataclass(frozen=True)
class Interpolation:
    """The interpolation of a motion between its samples.

    Attributes:
      hold: positions and velocities hold until the next sample, instead of following a straight line to it.
      hold_controls: controls hold likewise.
      unwrap: a jump of a hinge by more than half a turn is a turn in the other direction, past the end of its scale.
    """

    hold: bool = False
    hold_controls: bool = True
    unwrap: bool = False


class GaplessSamples:
    """Samples without gaps: missing samples are interpolated, and columns that the table lacks are as at the start.

    Quaternions have unit length, and keep their sign from one sample to the next.

    Args:
      start: provides the values that the table lacks.

    Attributes:
      time: the time of each sample since the first one [s], `(n,)`.
      fields: `(n, size)` for each of `FIELDS` that the table has, and for qpos and qvel.
      position_remarks, other_remarks: warnings about its positions, and about the rest.
      note: how velocities, activations and controls are filled if the table has none; empty if it has all.

    Raises:
      UsageError: times that do not ascend, infinite numbers, a missing first sample, or a quaternion that is zero or
        lacks a component.
    """

    def __init__(
        self, model: mujoco.MjModel, start: mujoco.MjData, samples: KinematicSamples, interpolation: Interpolation
    ) -> None:
        require_times(samples.time, samples.source)
        self.time = samples.time - samples.time[0]
        self._model, self._samples, self._interpolation = model, samples, interpolation
        self._gaps: dict[tuple[int, int], str] = {}
        self._ends: dict[str, float] = {}
        self._lengths: dict[str, float] = {}

        initial = {name: np.array(getattr(start, name)).ravel() for name in FIELDS}
        present = {name: values for name in FIELDS if (values := samples.values.get(name)) and name != "qvel"}
        self.fields = {name: self._complete(name, initial[name]) for name in ("qpos", *present)}
        self.fields["qvel"] = self._velocities()
        self.position_remarks, self.other_remarks = list(self._on_positions()), list(self._on_the_rest())
        filled = "; ".join(self._usual())
        self.note = f"{clean(samples.source)}: {filled}" if filled else ""

    def _complete(self, field: str, initial: np.ndarray) -> np.ndarray:
        """Returns the numbers of a field `(n, size)`."""
        complete = np.tile(initial, (len(self.time), 1))
        columns = self._samples.values.get(field, {})
        names = self._samples.columns[field]
        turning = set(quaternions(self._model, field))
        within = {first + i for first in turning for i in range(4)}

        for first in sorted(turning):
            present = [i for i in range(first, first + 4) if i in columns]
            if present:
                self._require_all([names[i] for i in present], list(names[first : first + 4]))
                label = names[first].rpartition("/")[0]
                complete[:, first : first + 4] = self._quaternions(
                    label, np.column_stack([columns[i] for i in present])
                )
        for index in sorted(columns.keys() - within):
            complete[:, index] = self._numbers(field, index, columns[index])
        return complete

    def _numbers(self, field: str, index: int, values: np.ndarray) -> np.ndarray:
        """Returns one column without its gaps."""
        name = self._samples.columns[field][index]
        rows = self._present(name, values)
        if field == "qpos" and self._interpolation.unwrap and index in hinges(self._model):
            values = values.copy()
            values[rows] = np.unwrap(values[rows])
        hold = self._interpolation.hold_controls if field == "ctrl" else self._interpolation.hold
        return without_gaps(self.time, values, rows, linear=not hold)

    def _quaternions(self, name: str, values: np.ndarray) -> np.ndarray:
        """Returns quaternions `(n, 4)` without gaps, normalized and of continuous sign."""
        rows = self._present(name, values)
        turned = values[rows]
        length = np.linalg.norm(turned, axis=1)
        if not length.all():
            row = rows[int(np.argmin(length))]
            raise UsageError(f"{self._row(row)}: the quaternion {clean(name)} is zero, which is not a rotation")
        if abs(length - 1).max() > UNIT_TOLERANCE:
            self._lengths[name] = float(length[np.argmax(abs(length - 1))])
        inexact = abs(length - 1) > EXACT_UNIT
        turned[inexact] /= length[inexact, None]
        flips = np.where((turned[1:] * turned[:-1]).sum(axis=1) < 0, -1.0, 1.0)
        turned[1:] *= np.cumprod(flips)[:, None]

        complete = np.empty_like(values)
        complete[rows] = turned
        for before, after in pairwise([*rows.tolist(), len(values)]):
            for row in range(before + 1, after):
                share = 0.0
                if after < len(values) and not self._interpolation.hold:
                    share = (self.time[row] - self.time[before]) / (self.time[after] - self.time[before])
                complete[row] = slerp(complete[before], complete[min(after, len(values) - 1)], share)
        return complete

    def _velocities(self) -> np.ndarray:
        """Returns velocities `(n, nv)`: those in the table, the rest from positions."""
        measured = self._samples.values.get("qvel", {})
        model = self._model
        velocities = np.empty((len(self.time), model.nv))
        if len(measured) < model.nv:
            velocities = finite_differences(model, self.time, self.fields["qpos"])
        for index, values in measured.items():
            velocities[:, index] = self._numbers("qvel", index, values)
        return velocities

    def _present(self, name: str, values: np.ndarray) -> np.ndarray:
        """Returns the rows in which no value is missing; records the gaps between them."""
        rows = values.reshape(len(values), -1)
        present = np.atleast_1d(~np.isnan(rows).any(axis=1))
        bad = np.flatnonzero(np.isinf(rows).any(axis=1))
        if len(bad):
            raise UsageError(f"{self._row(bad[0])}: {clean(name)} is infinite")
        if not present.any():
            raise UsageError(
                f"{clean(self._samples.source)} has no value of {clean(name)} in any row\n"
                "leave the column out, or map another"
            )
        if not present[0]:
            raise UsageError(
                f"{self._row(0)}: {clean(name)} is missing (empty or nan), but a motion must begin with all of its "
                f"columns\nremove the rows before the first complete one; {clean(name)} begins in row "
                f"{np.flatnonzero(present)[0]}, and the first row is row 0"
            )
        whole = np.flatnonzero(present)
        self._note_gaps(name, whole)
        return whole

    def _note_gaps(self, name: str, rows: np.ndarray) -> None:
        last = len(self.time) - 1
        if not last:
            return
        usual = float(np.median(np.diff(self.time)))
        everywhere = len(rows) == len(self.time)
        for before in np.flatnonzero(np.diff(self.time[rows]) > LONG * usual):
            self._gaps.setdefault((int(rows[before]), int(rows[before + 1])), "" if everywhere else name)
        if rows[-1] < last:
            self._ends[name] = float(self.time[last] - self.time[rows[-1]])

    def _on_positions(self) -> Iterator[str]:
        source = clean(self._samples.source)
        if self._samples.time[0]:
            yield f"{source}: its time {self._samples.time[0]:.15g} s is time 0 here"
        if missing := self._samples.missing("qpos"):
            yield f"{source} lacks {listing(missing)}: as in the initial state"
        yield from self._on_gaps(source)
        if self._lengths:
            name, length = max(self._lengths.items(), key=lambda item: abs(item[1] - 1))
            yield f"{source}: quaternions of {clean(name)} have lengths such as {length:.6g}, not 1; normalized"

    def _on_the_rest(self) -> Iterator[str]:
        source = clean(self._samples.source)
        missing = {field: self._samples.missing(field) for field in ("qvel", "act", "ctrl") if self._has(field)}
        if velocities := missing.pop("qvel", ()):
            yield f"{source} lacks {listing(velocities)}: they are finite differences of the positions"
        absent = [name for names in missing.values() for name in names]
        absent += ["mocap"] if self._model.nmocap and not {"mocap_pos", "mocap_quat"} & self.fields.keys() else []
        if absent:
            yield f"{source} lacks {listing(absent)}: as in the initial state"

    def _has(self, field: str) -> bool:
        return bool(self._samples.values.get(field))

    def _usual(self) -> Iterator[str]:
        """Yields how fields that the table lacks as a whole are filled."""
        if self._samples.missing("qvel") and not self._has("qvel"):
            yield "velocities are finite differences of the positions"
        if absent := [field for field in ("act", "ctrl") if self._samples.missing(field) and not self._has(field)]:
            yield f"{listing(absent)} as in the initial state"

    def _on_gaps(self, source: str) -> Iterator[str]:
        if self._gaps:
            (before, after), name = max(self._gaps.items(), key=lambda gap: self.time[gap[0][1]] - self.time[gap[0][0]])
            count = f"{len(self._gaps)} gaps, the longest" if len(self._gaps) > 1 else "a gap"
            where = f" in {clean(name)}" if name else ""
            how = "held" if self._interpolation.hold else "interpolated"
            length, begin = self.time[after] - self.time[before], self._samples.time[before]
            yield f"{source}: {count}{where} of {length:.4g} s from {begin:.15g} s on; {how}"
        if self._ends:
            name, length = max(self._ends.items(), key=lambda end: end[1])
            yield f"{source}: {listing([*self._ends])} end up to {length:.6g} s before the table does; held"

    def _require_all(self, present: Sequence[str], names: Sequence[str]) -> None:
        if len(present) < len(names):
            missing = [name for name in names if name not in present]
            raise UsageError(
                f"{clean(self._samples.source)} has {listing(present)}, and lacks {listing(missing)}: "
                "a quaternion has four numbers"
            )

    def _row(self, row: int | np.integer) -> str:
        return f"{clean(self._samples.source)}, row {row}"


def quaternions(model: mujoco.MjModel, field: str) -> list[int]:
    """Returns the places in a field at which quaternions begin."""
    if field == "mocap_quat":
        return list(range(0, 4 * model.nmocap, 4))
    if field != "qpos":
        return []
    offset = {FREE: 3, BALL: 0}
    joints = zip(model.jnt_type.tolist(), model.jnt_qposadr.tolist(), strict=True)
    return [address + offset[kind] for kind, address in joints if kind in offset]


def hinges(model: mujoco.MjModel) -> set[int]:
    """Returns the indices of hinge angles in qpos."""
    return set(model.jnt_qposadr[model.jnt_type == int(mujoco.mjtJoint.mjJNT_HINGE)].tolist())


def slerp(first: np.ndarray, last: np.ndarray, share: float) -> np.ndarray:
    """Returns the quaternion at the fraction `share` of the shortest arc from `first` to `last`.

    The angular velocity along the arc is constant.

    K. Shoemake, "Animating rotation with quaternion curves", SIGGRAPH 1985.
    """
    between, turn = first.copy(), np.empty(3)
    if share:
        mujoco.mju_subQuat(turn, last, first)
        mujoco.mju_quatIntegrate(between, turn, share)
    return between


def finite_differences(model: mujoco.MjModel, time: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Returns velocities `(n, nv)` from `positions` `(n, nq)` at `time` `(n,)` [s].

    The velocity at a sample is the mean of the differences before and after it, weighted so that it is exact for
    constant accelerations; at either end it is the only difference. The differences are MuJoCo's
    (`mj_differentiatePos`): angular velocities are in the frame of the body.
    """
    velocities = np.zeros((len(time), model.nv))
    if len(time) == 1 or not model.nv:
        return velocities
    spans = np.diff(time)
    differences = np.empty((len(spans), model.nv))
    for index, span in enumerate(spans):
        mujoco.mj_differentiatePos(model, differences[index], span, positions[index], positions[index + 1])
    velocities[0], velocities[-1] = differences[0], differences[-1]
    before, after = spans[:-1, None], spans[1:, None]
    velocities[1:-1] = (after * differences[:-1] + before * differences[1:]) / (before + after)
    return velocities


class KinematicMotion:
    """The states of `model` at every step from the first sample, which is step 0.

    Each state is computed on request: memory holds the samples alone, whatever the number of steps.

    Args:
      start: provides the values that the samples lack.

    Attributes:
      steps: all steps.
      size: the length of a state.
      has_controls: whether the samples include controls.
      remarks: warnings for the user.
      position_remarks: those about positions.
      note: see `GaplessSamples`.

    Raises:
      UsageError: as `GaplessSamples`.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        start: mujoco.MjData,
        samples: KinematicSamples,
        interpolation: Interpolation | None = None,
    ) -> None:
        self._interpolation = interpolation or Interpolation()
        complete = GaplessSamples(model, start, samples, self._interpolation)
        self._model, self._start = model, state.save(model, start)
        self._places = state.fields(state.sizes(model))
        self._time, self._fields = complete.time, complete.fields
        self._timestep = rational(model.opt.timestep)
        self._slack = SLACK * model.opt.timestep
        self.steps = range(int((self._time[-1] + self._slack) / model.opt.timestep) + 1)
        self.size = state.size(model)
        self.has_controls = "ctrl" in complete.fields
        self.position_remarks = complete.position_remarks
        self.remarks = [*complete.position_remarks, *complete.other_remarks]
        self.note = complete.note

    @property
    def samples(self) -> "SampleStates":
        """The states at the times of the samples, wherever the steps fall."""
        return SampleStates(self, self._time)

    def state(self, index: int) -> np.ndarray:
        """Returns the integration state at step `index` as a new array `(size,)`.

        Raises:
          IndexError: the step does not exist.
        """
        return self.state_at(float(self.steps[index] * self._timestep))

    def state_at(self, time: float) -> np.ndarray:
        """Returns the integration state `time` [s] after the first sample, held before the first and after the last."""
        row, share = self._place(time)
        moving = 0.0 if self._interpolation.hold else share
        fields = self._fields
        values = {"time": np.array([time]), "qpos": self._positions(row, moving)}
        for name in ("qvel", "act", "mocap_pos"):
            if name in fields:
                values[name] = _between(fields[name], row, moving)
        if "ctrl" in fields:
            values["ctrl"] = _between(fields["ctrl"], row, 0.0 if self._interpolation.hold_controls else share)
        if "mocap_quat" in fields:
            values["mocap_quat"] = self._mocap_rotations(row, moving).ravel()
        made = self._start.copy()
        for name, numbers in values.items():
            made[self._places.get(name, slice(0))] = numbers  # a field without numbers has no place
        return made

    def _place(self, time: float) -> tuple[int, float]:
        """Returns the last row at or before `time`, and the fraction of the way to the next."""
        row = max(0, int(np.searchsorted(self._time, float(time + self._slack), side="right")) - 1)
        since = time - self._time[row]
        if since <= self._slack or row == len(self._time) - 1:
            return row, 0.0
        return row, float(since / (self._time[row + 1] - self._time[row]))

    def _positions(self, row: int, share: float) -> np.ndarray:
        positions = self._fields["qpos"]
        if not share:
            return positions[row]
        way, between = np.empty(self._model.nv), positions[row].copy()
        mujoco.mj_differentiatePos(self._model, way, 1.0, positions[row], positions[row + 1])
        mujoco.mj_integratePos(self._model, between, way, share)
        return between

    def _mocap_rotations(self, row: int, share: float) -> np.ndarray:
        rotations = self._fields["mocap_quat"].reshape(len(self._time), -1, 4)
        if not share:
            return rotations[row]
        pairs = zip(rotations[row], rotations[row + 1], strict=True)
        return np.array([slerp(first, last, share) for first, last in pairs])


class SampleStates:
    """The states of `motion` at `times` `(n,)` [s], numbered instead of by steps."""

    def __init__(self, motion: KinematicMotion, times: np.ndarray) -> None:
        self._motion, self._times = motion, times
        self.steps, self.size = range(len(times)), motion.size

    def state(self, index: int) -> np.ndarray:
        """Returns state number `index` as a new array `(size,)`."""
        return self._motion.state_at(float(self._times[index]))


def _between(values: np.ndarray, row: int, share: float) -> np.ndarray:
    """Returns the numbers at the fraction `share` of the straight way from a row of `values` to the next."""
    return values[row] + share * (values[row + 1] - values[row]) if share else values[row]
