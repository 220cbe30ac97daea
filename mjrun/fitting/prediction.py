"""Predictions of measurements: rollouts of stretches of a log from any state, with any parameters."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import CompiledOverrideError, ModelError, counted, listing
from mjrun.fitting.free_parameter import FreeParameter, overrides
from mjrun.fitting.measurements import CONTROLS, LogSegment, align, commands, rotations
from mjrun.model import state
from mjrun.model.names import control_names
from mjrun.model.override import Override
from mjrun.model.variants import VariantLoader
from mjrun.physics.engine import AUTORESET, ENERGY, CEngine
from mjrun.probe.fields import Fields, RecordedFieldProbe, kinetic_sensors
from mjrun.probe.select import select
from mjrun.probe.vocabularies import ModelVocabulary
from mjrun.simulation.simulation import Simulation

CONSTRAINTS = "nefc"  # MuJoCo's number of constraint rows, which contacts and limits change
ALIKE = 1.25  # largest ratio of the lengths of rollouts that are simulated side by side


@dataclass(frozen=True, eq=False)
class Chunk:
    """A stretch of a segment that is simulated from its own initial state.

    Attributes:
      segment: the segment.
      rows: rows of the segment.
      first_step: start of the chunk, in timesteps after the first row of the segment.
      positions: times of the rows, in timesteps after this start, `(n,)`.
    """

    segment: LogSegment
    rows: slice
    first_step: int
    positions: np.ndarray

    @property
    def values(self) -> np.ndarray:
        """Measured values, `(n, signals)`."""
        return self.segment.values[self.rows]

    @property
    def steps(self) -> int:
        """Number of timesteps to the last row."""
        return max(math.ceil(self.positions[-1]), 1)


def chunks(segments: Sequence[LogSegment], rows: int, timestep: float, lead: int = 0) -> list[Chunk]:
    """Cuts segments into chunks of about `rows` rows; the last row of one is the first of the next.

    Args:
      lead: steps by which a chunk begins before its first row, where the segment has them.
    """
    parts: list[Chunk] = []
    for segment in segments:
        steps = segment.steps(timestep)
        count = max(1, round((len(steps) - 1) / rows))
        edges = np.round(np.linspace(0, len(steps) - 1, count + 1)).astype(int)
        for begin, end in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            first = max(0, math.floor(steps[begin] + 1e-9) - lead)
            parts.append(Chunk(segment, slice(begin, end + 1), first, steps[begin : end + 1] - first))
    return parts


@dataclass(frozen=True, eq=False)
class ChunkRolloutInputs:
    """The inputs of a rollout of a chunk: an initial state, and values of the parameters.

    Attributes:
      chunk: the chunk.
      values: values of the parameters, in order; None for the original model, without delays.
      start: integration state at the first step of the chunk, `(nstate,)`.
      added: changes of the model beside these values, on trial.
    """

    chunk: Chunk
    values: tuple[float, ...] | None
    start: np.ndarray
    added: tuple[Override, ...] = ()


class _SimulationFailures:
    """Simulations that failed.

    Attributes:
      count: number of failed simulations.
    """

    def __init__(self) -> None:
        self.count = 0
        self._example: tuple[tuple[float, ...], str] | None = None

    def unstable(self, values: tuple[float, ...] | None) -> None:
        """Notes that a simulation became unstable; `values` is None for the original model."""
        self._note(values, "a simulation becomes unstable")

    def refused(self, values: tuple[float, ...], why: str) -> None:
        """Notes the reason why the model does not compile."""
        self._note(values, f"the model does not compile: {why.splitlines()[0]}")

    def sentence(self, parameters: Sequence[FreeParameter]) -> str | None:
        """Returns a sentence on the failures, or None."""
        if self._example is None:
            return None
        values, what = self._example
        place = listing([f"{p.path}={value:.4g}" for p, value in zip(parameters, values, strict=True)])
        return f"{what} with {place}; {counted(self.count, 'simulation')} failed in all, and such values are avoided"

    def _note(self, values: tuple[float, ...] | None, what: str) -> None:
        if values is not None:
            self.count += 1
            self._example = self._example or (values, what)


class Predictor:
    """A predictor of the signals of chunks.

    Args:
      simulation: the model and its settings.
      signals: names of the measured columns.
      parameters: free parameters.

    Attributes:
      model: the original model.
      timestep: its timestep [s].
      columns: columns of the signals.
      rotations: indices of the signals that are quaternions.
      lead: the longest delay, in timesteps.
      failures: failed simulations.
      rollouts: number of simulated chunks.
      has_impacts: whether contacts or limits began or ended in any of them.
    """

    def __init__(self, simulation: Simulation, signals: Sequence[str], parameters: Sequence[FreeParameter]) -> None:
        self._source, self._parameters = simulation.source, parameters
        self.failures, self.rollouts, self.has_impacts = _SimulationFailures(), 0, False
        self._linear = simulation.ctrl_interpolation == "linear"
        self._needs_energy = any(name.startswith("energy/") for name in signals)
        self._variants = VariantLoader(self._set_flags)
        self._engine = CEngine()
        self.model = self._variants.load(self._source).model
        self.timestep = float(self.model.opt.timestep)
        probes = select(self.model, signals)
        self._probes = [probe for probe in probes if isinstance(probe, RecordedFieldProbe)]
        columns = [column for probe in self._probes for column in probe.columns]
        self._order = [[column.name for column in columns].index(name) for name in signals]
        self.columns = [columns[i] for i in self._order]
        self._fields = sorted({CONSTRAINTS, *(name for probe in self._probes for name in probe.fields)})
        self._signals = list(signals)
        controls = control_names(self.model)
        delays = [(i, name) for i, each in enumerate(parameters) for name in each.delayed]
        self._late_controls = {
            controls.index(name.removeprefix(CONTROLS)): i for i, name in delays if name.startswith(CONTROLS)
        }
        self._late_signals = {self._signals.index(name): i for i, name in delays if not name.startswith(CONTROLS)}
        self.rotations = rotations(self._signals, ModelVocabulary(self.model).names)
        longest = max([parameters[i].high for i in self._late_signals.values()], default=0.0)
        self.lead = math.ceil(longest / self.timestep)

    def _set_flags(self, model: mujoco.MjModel) -> None:
        model.opt.disableflags |= AUTORESET
        if self._needs_energy or kinetic_sensors(model):
            model.opt.enableflags |= ENERGY

    def model_with(self, values: Sequence[float] | None, added: Sequence[Override] = ()) -> mujoco.MjModel:
        """Returns the model with these values of the parameters, or the original one; callers must not change it."""
        changed = [] if values is None else overrides(self._parameters, values)
        source = replace(self._source, overrides=(*self._source.overrides, *changed, *added))
        return self._variants.load(source).model

    def predict(self, rollouts: Sequence[ChunkRolloutInputs]) -> list[np.ndarray]:
        """Predicts the signals of each rollout, `(n, signals)` of its chunk; NaN where the simulation fails."""
        self.rollouts += len(rollouts)
        compiled = {key: self.compiled(*key) for key in dict.fromkeys((each.values, each.added) for each in rollouts)}
        predicted = [np.full((len(each.chunk.positions), len(self._signals)), np.nan) for each in rollouts]
        able = [i for i, each in enumerate(rollouts) if compiled[each.values, each.added] is not None]
        for places in _alike(able, [each.chunk.steps for each in rollouts]):
            models = [model for i in places if (model := compiled[rollouts[i].values, rollouts[i].added])]
            for i, rows in zip(places, self._recorded([rollouts[i] for i in places], models), strict=True):
                predicted[i] = self._sampled(rollouts[i], rows)
                if not (np.isfinite(predicted[i]).all() or rollouts[i].added):
                    self.failures.unstable(rollouts[i].values)
        return predicted

    def compiled(self, values: tuple[float, ...] | None, added: Sequence[Override] = ()) -> mujoco.MjModel | None:
        """Returns the model with these values; None if it does not compile."""
        try:
            return self.model_with(values, added)
        except (ModelError, CompiledOverrideError) as error:
            if values is None:
                raise
            if not added:
                self.failures.refused(values, str(error))
            return None

    def _recorded(self, rollouts: Sequence[ChunkRolloutInputs], models: Sequence[mujoco.MjModel]) -> list[np.ndarray]:
        """Records the signals at every step, `(steps + 1, signals)` of each rollout; NaN where the simulation fails."""

        def signals(fields: Fields, initial: Fields) -> np.ndarray:
            self.has_impacts = self.has_impacts or bool(np.ptp(fields[CONSTRAINTS], axis=1).any())
            parts = [probe.compute(fields, initial) for probe in self._probes]
            return np.concatenate(parts, axis=-1)[..., self._order]

        return self._measured(rollouts, models, self._fields, signals)

    def field(
        self, name: str, parts: Sequence[Chunk], values: tuple[float, ...], states: np.ndarray
    ) -> list[np.ndarray]:
        """Simulates a field of the model with these values, such as `qpos`, at the rows of each chunk, `(n, size)`.

        Args:
          states: integration states at the beginning of each chunk, `(chunks, nstate)`.
        """
        rollouts = [ChunkRolloutInputs(part, values, start) for part, start in zip(parts, states, strict=True)]
        models = [self.model_with(values)] * len(parts)
        measured = self._measured(rollouts, models, [name], lambda fields, _: fields[name])
        return [_interpolated(rows, part.positions, slice(None)) for part, rows in zip(parts, measured, strict=True)]

    def _measured(
        self,
        rollouts: Sequence[ChunkRolloutInputs],
        models: Sequence[mujoco.MjModel],
        names: Sequence[str],
        measure: Callable[[Fields, Fields], np.ndarray],
    ) -> list[np.ndarray]:
        """Applies `measure` to fields at every step of each rollout; NaN where the simulation fails."""
        steps = max(each.chunk.steps for each in rollouts)
        controls = np.stack([self.controls(each, steps) for each in rollouts])
        starts = np.stack([each.start for each in rollouts])
        recorded: list[np.ndarray] = []
        for block in self._engine.rollout(models, starts, controls, steps, names):
            columns = measure(block.fields, block.initial)
            is_over = np.arange(len(block.steps)) >= block.counts[:, None]
            recorded.append(np.where(is_over[..., None], np.nan, columns))
        values: np.ndarray = np.concatenate(recorded, axis=1)
        return list(values)

    def controls(self, rollout: ChunkRolloutInputs, steps: int) -> np.ndarray:
        """Returns the controls of the first steps of a rollout, `(steps, nu)`, with their delays."""
        chunk, values = rollout.chunk, rollout.values
        delays = {} if values is None else {actuator: values[i] for actuator, i in self._late_controls.items()}
        return commands(chunk.segment, chunk.first_step, steps, self.timestep, self._linear, delays)

    def _sampled(self, rollout: ChunkRolloutInputs, rows: np.ndarray) -> np.ndarray:
        """Interpolates `rows` of all steps at the positions of the chunk's rows, with the delays of signals."""
        positions = rollout.chunk.positions
        values = _interpolated(rows, positions, slice(None))
        if rollout.values is not None:
            for signal, i in self._late_signals.items():
                late = positions - rollout.values[i] / self.timestep
                values[:, signal] = _interpolated(rows, late, signal)
        align(values, rollout.chunk.values, self.rotations)
        return values


def _interpolated(rows: np.ndarray, positions: np.ndarray, columns: slice | int) -> np.ndarray:
    """Interpolates linearly between rows, and extrapolates before the first one."""
    low = np.clip(np.floor(positions).astype(int), 0, len(rows) - 2)
    share = positions - low
    share = share if isinstance(columns, int) else share[:, None]
    return rows[low, columns] * (1 - share) + rows[low + 1, columns] * share


def _alike(places: Sequence[int], steps: Sequence[int]) -> list[list[int]]:
    """Groups the indices of rollouts by similar numbers of steps."""
    groups: list[list[int]] = []
    for place in sorted(places, key=lambda i: steps[i]):
        if groups and steps[place] <= ALIKE * steps[groups[-1][0]]:
            groups[-1].append(place)
        else:
            groups.append([place])
    return groups


class ChunkInitialStates:
    """Initial states of chunks, as small deviations from a guess.

    A deviation has `nv` numbers of positions in the tangent space, `nv` of velocities, and `na` of activations.

    Attributes:
      size: length of a deviation.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model, self._data = model, mujoco.MjData(model)
        self.size = 2 * model.nv + model.na

    def moved(self, guess: np.ndarray, deviation: np.ndarray) -> np.ndarray:
        """Returns the integration state `(nstate,)` that deviates from `guess` by `deviation`, `(size,)` or empty."""
        if not len(deviation):
            return guess
        model, data, nv = self._model, self._data, self._model.nv
        state.restore(model, data, guess)
        mujoco.mj_integratePos(model, data.qpos, deviation[:nv], 1.0)
        data.qvel += deviation[nv : 2 * nv]
        data.act += deviation[2 * nv :]
        return state.save(model, data)
