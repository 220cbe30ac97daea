"""The observation vector of a task: its values from one control instant to the next, as the policy gets them."""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from math import pi
from typing import Any

import numpy as np

from mjrun.task.expressions import Inputs
from mjrun.task.observation_plan import ObservationPlan, ObservedTerm
from mjrun.task.random_streams import ObservationNoise
from mjrun.task.task import Observation


class ObservationVector:
    """The observations of n worlds, from one control instant to the next.

    Args:
      plan: the plan of the observation.
      count: the number of worlds.
      rotations: the rotations of all bodies, a view `(n, nbody, 9)`; None if no term has a frame.

    Attributes:
      rotations: the same; views of another MjData may take their place.
      has_inputs: whether an action, a command or a phase is observed.
      places_of_values: the places of expressions among the values of all terms, in their order.
    """

    def __init__(self, plan: ObservationPlan, count: int, control_dt: Fraction, rotations: np.ndarray | None) -> None:
        self._plan, self.rotations = plan, rotations
        self._measured = _runs([each for each in plan.terms if each.is_measured])
        self._inputs = [each for each in plan.terms if not each.is_measured and not each.expression]
        self._values = [each for each in plan.terms if each.expression]
        self.has_inputs = bool(self._inputs)
        self.places_of_values = [each.place.start for each in self._values]
        self._dt = control_dt
        self._frames = plan.frames
        noise = [each.term.noise for each in plan.terms for _ in each.columns]
        self._noise = ObservationNoise(noise, count) if any(noise) else None
        self._shifted, self._scaled = bool(plan.offset.any()), bool((plan.scale != 1).any())
        self._clipped = bool(np.isfinite(plan.low).any() or np.isfinite(plan.high).any())
        self._is_changed = bool(self._frames or self._noise or self._shifted or self._scaled or self._clipped)
        self._is_measured = not (self._inputs or self._values) and len(self._measured) == 1  # all of it in order
        self._remembered = [each for each in plan.terms if each.term.delay or each.term.history > 1]
        self._memory = [
            np.zeros((count, each.term.delay + each.term.history, len(each.columns))) for each in self._remembered
        ]

    def begin(self, world: int, seed: int) -> None:
        """Begins the noise of an episode in a world."""
        if self._noise:
            self._noise.begin(world, seed)

    @property
    def memory(self) -> list[np.ndarray]:
        """The delayed terms and the noise of each world `(count, …)`."""
        return [*self._memory, *(self._noise.memory if self._noise else ())]

    @property
    def noise(self) -> "list[np.random.Generator | None]":
        """The generator of the noise of each world; empty without noise."""
        return self._noise.streams if self._noise else []

    def observe(
        self, measured: np.ndarray, inputs: Inputs, values: Mapping[str, Any], rows: np.ndarray | int, first: bool
    ) -> np.ndarray:
        """Returns the observations `(k, nobs)` of the worlds `rows` `(k,)`; of a single one `(nobs,)`.

        Args:
          measured: the columns of the model that terms observe, in their order, `(k, …)`.
          inputs: the last actions and the commands of this instant.
          values: the values of expressions `(k,)`, by the name of the term.
          first: whether an episode begins here.
        """
        current = self.collect(measured, inputs)
        for each in self._values:
            current[..., each.place.start] = values[each.term.name]
        return self.finish(current, rows, first)

    def collect(self, measured: np.ndarray, inputs: Inputs) -> np.ndarray:
        """Returns the current values of all terms except expressions: `(k, width)`, or `(width,)` of a single world.

        Args:
          measured, inputs: as for `observe`.
        """
        if self._is_measured:
            return measured.copy()
        now = np.empty((*measured.shape[:-1], self._plan.width))
        for source, place in self._measured:
            now[..., place] = measured[..., source]
        for each in self._inputs:
            now[..., each.place] = self._input(each.term, inputs)
        return now

    def finish(self, now: np.ndarray, rows: np.ndarray | int, first: bool) -> np.ndarray:
        """Returns the observations from the array of `collect`, after expressions were written into their places."""
        if self._is_changed:
            self._change(now, rows)
        if not self._remembered:
            return now
        parts, done = [], 0
        for each, memory in zip(self._remembered, self._memory, strict=True):
            parts.append(now[..., done : each.place.start])
            parts.append(self._recalled(each, memory, now[..., each.place], rows, first))
            done = each.place.stop
        return np.concatenate([*parts, now[..., done:]], axis=-1)

    def _input(self, term: Observation, inputs: Inputs) -> np.ndarray:
        """Returns the action, command or phase of a term: `(k, width)`, or `(width,)` of a single world."""
        if term.action is not None:
            return inputs.actions
        if term.command is not None:
            return inputs.commands[..., self._plan.command_slices[term.command]]
        assert term.phase is not None
        angles = 2 * pi * (inputs.instants * float(self._dt / term.phase))
        return np.stack([np.sin(angles), np.cos(angles)], axis=-1)

    def _change(self, now: np.ndarray, rows: np.ndarray | int) -> None:
        """Rotates all terms, adds noise, shifts, scales and clips them, in place."""
        plan = self._plan
        for each, body in self._frames:
            assert self.rotations is not None
            _turn(now[..., each.place], self.rotations[rows, body])
        if self._noise:
            now[..., self._noise.columns] += self._noise.next(rows)
        if self._shifted:
            now -= plan.offset
        if self._scaled:
            now *= plan.scale
        if self._clipped:
            now.clip(plan.low, plan.high, out=now)

    def _recalled(
        self, each: ObservedTerm, memory: np.ndarray, now: np.ndarray, rows: np.ndarray | int, first: bool
    ) -> np.ndarray:
        """Returns the history of a term, the oldest first: `(k, history·width)`; it begins with equal values."""
        if first:
            memory[rows] = now[..., None, :]
        else:
            memory[rows, :-1] = memory[rows, 1:]
            memory[rows, -1] = now
        return memory[rows, : each.term.history].reshape(*now.shape[:-1], -1)


def _runs(terms: Sequence[ObservedTerm]) -> list[tuple[slice, slice]]:
    """Returns the source and target of each run of the columns of `terms`, as few runs as possible."""
    runs: list[tuple[slice, slice]] = []
    source = 0
    for each in terms:
        width = len(each.columns)
        if runs and runs[-1][1].stop == each.place.start:
            before = runs.pop()
            runs.append((slice(before[0].start, source + width), slice(before[1].start, each.place.stop)))
        else:
            runs.append((slice(source, source + width), each.place))
        source += width
    return runs


def _turn(vectors: np.ndarray, rotations: np.ndarray) -> None:
    """Rotates vectors `(k, 3·m)` in world axes into the axes `(k, 9)` of a body, in place."""
    axes = rotations.reshape(*vectors.shape[:-1], 3, 3)  # its columns, in the world
    for start in range(0, vectors.shape[-1], 3):
        x, y, z = (vectors[..., start + i].copy() for i in range(3))
        for i in range(3):
            vectors[..., start + i] = axes[..., 0, i] * x + axes[..., 1, i] * y + axes[..., 2, i] * z
