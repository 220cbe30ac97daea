"""Logs of a system: measured signals and commands over time, under the names of a model's columns, and their noise."""

import itertools
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, FileError, UnknownNameError, UsageError, clean, counted, listing, option
from mjrun.formats.table_reader import STDIN
from mjrun.model.names import control_names, names
from mjrun.physics.timed_rows import SLACK, require_times, without_gaps
from mjrun.probe.fields import RecordedFieldProbe
from mjrun.probe.select import select
from mjrun.probe.vocabularies import ModelVocabulary
from mjrun.simulation.mapped_table import (
    TIME,
    ColumnMap,
    column_map,
    column_names,
    evaluated,
    split_header,
    time_hint,
    units_of,
)

Floats = NDArray[np.float64]

PARTS = ("qw", "qx", "qy", "qz")
SHORTEST = 0.5  # least norm of a quaternion that was rounded or averaged
LEAST_NOISE = 1e-7  # noise of simulated data, as a share of the standard deviation of a signal
ROUNDING = 1e-7  # error of simulated numbers in any unit: solvers stop at a tolerance, so that resting bodies creep
FINEST = 1e-12  # least noise that a user may set: residuals over it are squared
FEWEST_DIFFERENCES = 3  # differences that show a resolution
NORMAL_MEDIAN = 1.4826  # standard deviation of a normal distribution over the median of absolute values
OUTLYING = 2.5  # standard deviations at which differences are clipped: contacts and outliers make some large
THIRD_DIFFERENCES = 20  # variance of the third differences of white noise, over its own
CLIPPED = 0.97756  # variance of a normal distribution that is clipped there
CONTROLS = "ctrl/"
GAP = 5  # multiple of the usual time between rows above which a new segment begins
FEWEST = 16  # least number of rows of a segment
SPARSE = 100  # timesteps between rows above which times are probably milliseconds
# Signs that a log has angles in degrees where the model has radians.
BEYOND = 8.0  # multiple of a joint's limit that no measurement in radians reaches
WITHIN = 1.1  # multiple of a joint's limit that a measurement in degrees reaches at most
DEGREES = 180 / np.pi  # in a radian
TOLERANCE = 0.2  # of the ratio of two rates
AGREEMENT = 0.9  # least correlation of two rates


def rotations(signals: Sequence[str], available: Sequence[str]) -> list[list[int]]:
    """Groups the indices of the four signals of each rotation, in the order of `PARTS`.

    Args:
      available: columns of the model.

    Raises:
      UsageError: some signals of a rotation are missing.
    """
    groups: list[list[int]] = []
    known = set(available)
    for whole in dict.fromkeys(name.rpartition("/")[0] for name in signals if name.rpartition("/")[2] in PARTS):
        names = [f"{whole}/{part}" for part in PARTS]
        if not known.issuperset(names):  # a joint with such a name
            continue
        if missing := [name for name in names if name not in signals]:
            raise UsageError(
                f"{listing(missing)} of the rotation {clean(whole)} must be measured too, or none of it is"
            )
        groups.append([signals.index(name) for name in names])
    return groups


def normalize(values: Floats, groups: Sequence[Sequence[int]], where: str) -> None:
    """Normalizes quaternions in place, with the sign of the row before; incomplete ones become NaN.

    Args:
      values: rows of signals, `(n, signals)`.
      where: name of the table, for errors.

    Raises:
      UsageError: the norm of a quaternion is below `SHORTEST`.
    """
    for group in groups:
        quaternions = values[:, group]
        norms = np.linalg.norm(quaternions, axis=1)
        bad = np.flatnonzero(norms < SHORTEST)
        if len(bad):
            raise UsageError(f"{where}, row {bad[0]}: a quaternion of length {norms[bad[0]]:.3g} is not a rotation")
        quaternions = quaternions / norms[:, None]
        rows = np.flatnonzero(np.isfinite(norms))
        dots = np.sum(quaternions[rows[1:]] * quaternions[rows[:-1]], axis=1)
        quaternions[rows[1:]] *= np.cumprod(np.where(dots < 0, -1.0, 1.0))[:, None]
        values[:, group] = quaternions


def align(predicted: Floats, measured: Floats, groups: Sequence[Sequence[int]]) -> None:
    """Normalizes predicted quaternions in place, with the sign that is nearer to the measured ones.

    Their difference is then the chord between two rotations: its length is 2·sin(θ/4) for an angle θ.
    """
    for group in groups:
        quaternions = predicted[:, group]
        nearer = np.where(np.sum(quaternions * measured[:, group], axis=1) < 0, -1.0, 1.0)
        predicted[:, group] = quaternions * (nearer / np.linalg.norm(quaternions, axis=1))[:, None]


def shared(deviations: Floats, groups: Sequence[Sequence[int]]) -> Floats:
    """Replaces the standard deviations of the four numbers of each rotation by their root mean square, `(signals,)`.

    Separately they depend on the orientation: near the identity, `qw` hardly changes.
    """
    deviations = deviations.copy()
    for group in groups:
        deviations[group] = np.sqrt(np.mean(deviations[group] ** 2))
    return deviations


def spread_of(values: Floats, loss: str = "linear") -> Floats:
    """Returns the standard deviation of each signal, `(signals,)`; with a robust loss, estimated by medians."""
    if loss == "linear":
        return np.nanstd(values, axis=0)
    return np.nanmedian(np.abs(values - np.nanmedian(values, axis=0)), axis=0) * NORMAL_MEDIAN


def set_noise(texts: Sequence[tuple[str, str]], signals: Sequence[str]) -> dict[int, float]:
    """Returns the standard deviations that the user has given, by index of the signal.

    Raises:
      UsageError: no signal has this name, or a number is below `FINEST`.
    """
    known: dict[int, float] = {}
    for pattern, text in texts:
        matches = [i for i, name in enumerate(signals) if name == pattern or fnmatchcase(name, pattern)]
        if not matches:
            raise UnknownNameError("signal", pattern, signals, where=option("noise"))
        try:
            deviation = float(text)
        except ValueError:
            deviation = 0.0
        if not FINEST <= deviation < np.inf:
            raise BadValueError(f"{option('noise')} {clean(pattern)}", text, f"a standard deviation above {FINEST:g}")
        known |= dict.fromkeys(matches, deviation)
    return known


def first_noise(parts: Sequence[Floats], rotations: Sequence[Sequence[int]] = ()) -> Floats:
    """Estimates the noise of each signal from third differences, in which smooth motion hardly shows: `(signals,)`.

    Third differences of white noise with standard deviation s have the standard deviation √20·s.

    Args:
      parts: measured values of each segment, `(n, signals)`.
    """
    differences = np.concatenate([np.diff(values, 3, axis=0) for values in parts])
    spread = np.nanmedian(np.abs(differences), axis=0) * NORMAL_MEDIAN
    limit = OUTLYING * np.where(spread > 0, spread, np.inf)
    squares = np.nanmean(np.clip(differences, -limit, limit) ** 2, axis=0) / CLIPPED
    spread = np.sqrt(squares / THIRD_DIFFERENCES) * (spread > 0)
    return np.maximum(shared(spread, rotations), rounding(np.concatenate(parts), rotations))


def rounding(values: Floats, groups: Sequence[Sequence[int]]) -> Floats:
    """Returns the noise of simulated values that are rounded to the steps of a log, `(signals,)`."""
    return np.maximum(least_noise(values, groups), shared(resolution(values) / np.sqrt(12), groups))


def least_noise(values: Floats, rotations: Sequence[Sequence[int]]) -> Floats:
    """Returns the noise of simulated values, `(signals,)`."""
    return LEAST_NOISE * shared(np.nanstd(values, axis=0), rotations) + ROUNDING


def resolution(values: Floats) -> Floats:
    """Returns the largest step of which all differences of a signal are multiples, `(signals,)`; about 0 without one.

    Logs with few digits and encoders have one: its rounding is noise even where a signal is constant most of the time.
    """
    steps = np.zeros(values.shape[1])
    for i, column in enumerate(values.T):
        sizes: Floats = np.diff(np.unique(column[np.isfinite(column)]))
        left = sizes[sizes > ROUNDING]
        while len(sizes) >= FEWEST_DIFFERENCES and len(left):  # Euclid's algorithm
            step = float(left.min())
            left = np.abs(sizes - step * np.round(sizes / step))
            left = left[left > ROUNDING]
            steps[i] = step
    return steps


@dataclass(frozen=True, eq=False)
class LogSegment:
    """A stretch of a log without gaps.

    Attributes:
      source: file name of the log.
      times: times of the rows [s], `(n,)`.
      values: measured values, `(n, signals)`; NaN where a sample is missing.
      controls: commands, `(n, nu)`, each of which acts from its time on.
    """

    source: str
    times: np.ndarray
    values: np.ndarray
    controls: np.ndarray

    def part(self, rows: slice) -> "LogSegment":
        """Returns consecutive rows as a separate segment."""
        return LogSegment(self.source, self.times[rows], self.values[rows], self.controls[rows])

    def steps(self, timestep: float) -> np.ndarray:
        """Returns the times of the rows in timesteps after the first, `(n,)`."""
        return (self.times - self.times[0]) / timestep


@dataclass(frozen=True, eq=False)
class Measurements:
    """All segments of all logs, and the signals that they measure.

    Attributes:
      signals: names of columns of the model.
      segments: segments in the order of the files and of time.
      remarks: remarks for the user.
      rotations: indices of the signals that are quaternions.
      commands: names of the controls that every log commands.
    """

    signals: Sequence[str]
    segments: Sequence[LogSegment]
    remarks: Sequence[str] = ()
    rotations: Sequence[Sequence[int]] = ()
    commands: frozenset[str] = frozenset()

    @property
    def rows(self) -> int:
        """Number of rows of all segments."""
        return sum(len(segment.times) for segment in self.segments)

    def without(self, sources: Collection[str]) -> tuple["Measurements", "Measurements"]:
        """Separates the logs `sources` from all others, which come first."""
        rest = [segment for segment in self.segments if segment.source not in sources]
        held = [segment for segment in self.segments if segment.source in sources]
        return replace(self, segments=rest), replace(self, segments=held)

    def split(self, share: float) -> tuple["Measurements", "Measurements"]:
        """Separates the last `share` of every file's time, which is held out, from the first part."""
        first: list[LogSegment] = []
        last: list[LogSegment] = []
        for source in dict.fromkeys(segment.source for segment in self.segments):
            own = [segment for segment in self.segments if segment.source == source]
            begin, end = float(own[0].times[0]), float(own[-1].times[-1])
            limit = end - share * (end - begin)
            for segment in own:
                row = int(np.searchsorted(segment.times, limit))
                first += [segment.part(slice(0, row))] if row >= FEWEST else []
                rest = segment.part(slice(row, None))
                last += [rest] if len(rest.times) >= FEWEST and np.isfinite(rest.values).any() else []
        return replace(self, segments=first), replace(self, segments=last)


def read_measurements(
    paths: Sequence[str],
    model: mujoco.MjModel,
    texts: Sequence[str],
    constant: np.ndarray,
    fitted: Callable[[Measurements], Measurements] | None = None,
    *,
    linear: bool = False,
) -> Measurements:
    """Reads the measurements of `model` from tables.

    Columns are named as in a trace of the model: `time`, `qpos/knee`, `sensor/gyro/x`, and `ctrl/motor` for commands.
    A map, `COLUMN=EXPRESSION`, translates other names.

    Args:
      texts: entries of the map.
      constant: controls of actuators without commands, `(nu,)`.
      fitted: returns the part in which signals must vary; None for all.
      linear: whether commands are interpolated linearly; otherwise they hold until the next one.

    Raises:
      UsageError: no columns in common, times that do not increase, infinite numbers, or an invalid map.
      FileError: a table cannot be read.
    """
    tables = [_Table(path, model, texts, linear) for path in paths]
    signals = list(dict.fromkeys(name for table in tables for name in table.signals))
    segments: list[LogSegment] = []
    remarks: list[str] = []
    for table in tables:
        segments += table.segments(signals, constant, remarks)
    for segment in segments:
        columns = dict(zip(signals, segment.values.T, strict=True))
        for remark in degree_remarks(model, segment.times, columns):
            remarks.append(f"{clean(segment.source)}: {remark}")
    remarks = list(dict.fromkeys(remarks))
    available = ModelVocabulary(model).names
    whole = Measurements(signals, segments)
    values = np.concatenate([segment.values for segment in (fitted(whole) if fitted else whole).segments])
    varies = [bool((column[1:] != column[:-1]).any()) for column in (c[np.isfinite(c)] for c in values.T)]
    for group in rotations(signals, available):
        for i in group:
            varies[i] = any(varies[j] for j in group)
    still = [name for name, is_moving in zip(signals, varies, strict=True) if not is_moving]
    relative = [name for name in _relative_to_the_start(model, signals) if name not in still]
    measured = [name for name in signals if name not in still and name not in relative]
    if not measured:
        raise UsageError(f"nothing varies in the measurements: {listing(signals)}")
    if still:
        remarks.append(f"constant, so left out: {listing(still)}")
    if relative:
        remarks.append(f"measured from the start of the log, so left out: {listing(relative)}")
    places = [signals.index(name) for name in measured]
    parts = [replace(each, values=each.values[:, places]) for each in segments]
    parts = [each for each in parts if np.isfinite(each.values).any()]
    commanded = frozenset(name for name in control_names(model) if all(name in table.commands for table in tables))
    return Measurements(measured, parts, remarks, rotations(measured, available), commanded)


def _relative_to_the_start(model: mujoco.MjModel, signals: Sequence[str]) -> list[str]:
    """Returns the signals that refer to the first instant of a simulation, which a segment of a log lacks."""
    probes = [probe for probe in select(model, signals) if isinstance(probe, RecordedFieldProbe)]
    relative = {name for probe in probes for name in probe.relative}
    return [name for name in signals if name in relative]


class _Table:
    """One log and the expressions for its signals and commands."""

    def __init__(self, path: str, model: mujoco.MjModel, texts: Sequence[str], linear: bool) -> None:
        if path == STDIN:
            raise UsageError("measurements are read more than once, which standard input does not allow")
        self._path, self._model, self._linear = path, model, linear
        self._commands = [f"{CONTROLS}{name}" for name in control_names(model)]
        names = column_names(path)
        mapped = self._mapped(names, texts)
        if mapped.time is None:
            raise UsageError(f"{clean(path)} has no column 'time'\n{time_hint(names)}")
        self._has_time_map = mapped.time_is_mapped
        in_table = [name for each in names if (name := split_header(each)[0]) in mapped.sources]
        ordered = {name: mapped.sources[name] for name in in_table} | mapped.sources
        self._expressions = {TIME: mapped.time, **ordered}
        self.commands = {name.removeprefix(CONTROLS) for name in ordered if name.startswith(CONTROLS)}
        mapped_columns = {name for expression in self._expressions.values() for name in expression.columns}
        self._unused = [name for name in mapped.unused if name not in mapped_columns]
        self.signals = [name for name in self._expressions if name != TIME and not name.startswith(CONTROLS)]
        if not self.signals:
            valid = listing([*ModelVocabulary(model).names][1:4])
            raise UsageError(
                f"{clean(path)} measures nothing of this model\nits columns are {listing(names)}\n"
                f"the model has columns such as {valid}; {option('map')} translates names: qpos/knee=knee_deg*pi/180"
            )
        self._units = units_of(model, ["ctrl"] if model.nu else [])
        for probe in select(model, self.signals):
            self._units |= {column.name: column.unit for column in probe.columns}
            if not isinstance(probe, RecordedFieldProbe):
                raise UsageError(f"{listing([c.name for c in probe.columns])} cannot be fitted: no engine records them")

    def segments(self, signals: Sequence[str], constant: np.ndarray, remarks: list[str]) -> list[LogSegment]:
        """Reads its stretches without gaps, with a column for each of `signals`."""
        columns = evaluated(self._path, self._expressions, self._units)
        times = columns[TIME]
        require_times(times, self._path)
        missing = np.full(len(times), np.nan)
        values = np.column_stack([columns.get(name, missing) for name in signals])
        if self._unused:
            remarks.append(f"{clean(self._path)}: unused columns: {listing(self._unused)}")
        if np.isinf(values).any():
            row, column = np.argwhere(np.isinf(values))[0]
            raise UsageError(f"{clean(self._path)}, row {row}: {clean(signals[int(column)])} is infinite")
        if holes := int(np.isnan(values[:, [i for i, name in enumerate(signals) if name in columns]]).sum()):
            remarks.append(f"{clean(self._path)}: {counted(holes, 'sample')} missing and skipped")
        normalize(values, rotations(signals, ModelVocabulary(self._model).names), clean(self._path))
        controls = self._controls(columns, constant, remarks)
        if unknown := int(np.isnan(controls).any(axis=1).sum()):  # at the beginning
            remarks.append(f"{clean(self._path)}: skipped the {counted(unknown, 'row')} before the first command")
            times, values, controls = times[unknown:], values[unknown:], controls[unknown:]

        usual = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
        if usual > SPARSE * self._model.opt.timestep and not self._has_time_map:
            steps = usual / self._model.opt.timestep
            raise UsageError(
                f"{clean(self._path)}: rows are {usual:g} s apart, {steps:,.0f} timesteps of the model\n"
                f"if the times are milliseconds, add {option('map')} time=time/1000; if they are seconds, confirm with "
                f"{option('map')} time=time"
            )
        starts = [0, *(np.flatnonzero(np.diff(times) > GAP * usual) + 1).tolist(), len(times)]
        parts = [slice(a, b) for a, b in itertools.pairwise(starts)]
        long = [part for part in parts if part.stop - part.start >= FEWEST]
        if not long:
            after = " after its first command" if unknown else ""
            raise FileError(self._path, f"has no {FEWEST} consecutive rows without a gap{after}")
        if len(parts) > 1:
            short = len(parts) - len(long)
            left_out = f"; skipped {short} with fewer than {FEWEST} rows" if short else ""
            remarks.append(f"{clean(self._path)}: gaps in time split it into {len(parts)} segments{left_out}")
        return [LogSegment(self._path, times[part], values[part], controls[part]) for part in long]

    def _controls(self, columns: Mapping[str, np.ndarray], constant: np.ndarray, remarks: list[str]) -> np.ndarray:
        """Returns controls `(count, nu)`: commands hold until the next one; before the first one they are NaN."""
        times = columns[TIME]
        missing = 0
        controls = np.tile(constant, (len(times), 1))
        for index, name in enumerate(self._commands):
            if (commanded := columns.get(name)) is None:
                continue
            bad = np.flatnonzero(np.isinf(commanded))
            if len(bad):
                raise UsageError(
                    f"{clean(self._path)}, row {bad[0]}: {clean(name)} is {commanded[bad[0]]}, not a command"
                )
            known = np.flatnonzero(np.isfinite(commanded))
            if not len(known):
                raise UsageError(f"{clean(self._path)}: {clean(name)} has no command in any row")
            missing += len(times) - len(known)
            filled = without_gaps(times, commanded, known, self._linear)
            controls[:, index] = np.where(np.arange(len(times)) < known[0], np.nan, filled)
        if missing:
            filled_by = "linear interpolation" if self._linear else "the one before"
            remarks.append(f"{clean(self._path)}: {counted(missing, 'command')} missing and replaced by {filled_by}")
        return controls

    def _mapped(self, names: Sequence[str], texts: Sequence[str]) -> ColumnMap:
        """Returns the expressions for its times, signals and commands."""
        available = ModelVocabulary(self._model)
        headers = {split_header(name)[0]: name for name in names} | {name: name for name in names}
        measured = [name for name in headers if _is_measured(name, available)]
        readable = [headers[name] for name in (TIME, *self._commands, *measured) if name in headers]
        others = [name for name in available.names if name != TIME and not name.startswith(CONTROLS)]
        columns: dict[str, list[str]] = {}
        for name in dict.fromkeys([*self._commands, *others, *measured]):
            columns.setdefault(name.partition("/")[0], []).append(name)
        return column_map(columns, names, texts, self._path, by_name=readable)


def _is_measured(name: str, available: ModelVocabulary) -> bool:
    return not name.startswith(CONTROLS) and available.column(name) == name and name != TIME


def commands(
    segment: LogSegment, first: int, count: int, timestep: float, linear: bool, delays: Mapping[int, float]
) -> np.ndarray:
    """Returns the controls `(count, nu)` of the steps from `first` on, counted from the beginning of `segment`.

    A command holds until the next one or is interpolated linearly; the first one also acts before its time.

    Args:
      delays: delays of actuators [s], by index. The control of a step is then the mean over it, which changes smoothly
        with the delay.
    """
    times = (segment.times - segment.times[0]) / timestep
    steps = np.arange(first, first + count)
    if linear:
        columns: list[Floats] = [np.interp(steps, times, column) for column in segment.controls.T]
        controls = np.column_stack(columns)
    else:
        rows = np.searchsorted(times, steps + SLACK, side="right") - 1
        controls = segment.controls[np.maximum(rows, 0)]
    controls = np.array(controls.reshape(count, -1))
    for actuator, delay in delays.items():
        edges = np.arange(first, first + count + 1) - delay / timestep
        controls[:, actuator] = np.diff(_integral(times, segment.controls[:, actuator], edges, linear))
    return controls


def _integral(times: np.ndarray, values: np.ndarray, at: np.ndarray, linear: bool) -> np.ndarray:
    """Integrates a signal from its first time to each of `at`."""
    if linear:
        fine = np.union1d(times, at)
        inner = np.interp(fine, times, values)
        sums = np.concatenate([[0.0], np.cumsum(np.diff(fine) * (inner[1:] + inner[:-1]) / 2)])
        return np.interp(at, fine, sums)
    knots = np.concatenate([[min(at[0], times[0])], times[1:], [max(at[-1], times[-1]) + 1]])
    sums = np.concatenate([[0.0], np.cumsum(np.diff(knots) * values)])
    return np.interp(at, knots, sums)


def degree_remarks(
    model: mujoco.MjModel, times: NDArray[np.float64], signals: Mapping[str, NDArray[np.float64]]
) -> Iterator[str]:
    """Yields a remark on each hinge whose angles are probably degrees; uncertain cases yield none.

    Degrees are beyond the limits of a joint, and within them once converted; or they change 57 times as fast as the
    measured velocity says.

    Args:
      times: times of the rows [s], `(n,)`.
      signals: measured columns by name, `(n,)` each, NaN for missing values.
    """
    for joint, name in enumerate(names(model, "joint")):
        angles = signals.get(f"qpos/{name}")
        if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE or angles is None or not np.isfinite(angles).any():
            continue
        peak, limit = float(np.nanmax(np.abs(angles))), float(np.abs(model.jnt_range[joint]).max())
        column = f"qpos/{clean(name)}"
        if model.jnt_limited[joint] and peak > BEYOND * limit and peak / DEGREES <= WITHIN * limit:
            reason = f"{column} reaches {peak:.3g} rad, and the joint is limited to {limit:.3g} rad"
        elif (rates := signals.get(f"qvel/{name}")) is not None and _is_multiple(_rates(angles, times), rates):
            reason = f"{column} changes 57 times as fast as qvel/{clean(name)} says"
        else:
            continue
        yield f"{reason}: if it is in degrees, add {option('map')} '{column}={column}*pi/180'"


def _rates(angles: NDArray[np.float64], times: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.gradient(angles, times), np.float64)


def _is_multiple(changes: NDArray[np.float64], rates: NDArray[np.float64]) -> bool:
    """Returns whether changes of an angle are about `DEGREES` times its measured velocity."""
    known = np.isfinite(changes) & np.isfinite(rates)
    changes, rates = changes[known], rates[known]
    products, squares = float(changes @ rates), float(rates @ rates)
    total = float(np.sqrt(squares * (changes @ changes)))
    return total > 0 and products > AGREEMENT * total and abs(products / squares / DEGREES - 1) < TOLERANCE
