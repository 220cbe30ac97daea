"""Where chunks begin in what is not measured: a simulation along the log that is put back to what is measured."""

import math
from collections.abc import Sequence

import mujoco
import numpy as np

from mjrun.fit.measurements import Segment
from mjrun.fit.prediction import Chunk, Predictor, Rollout
from mjrun.fit.starting_states import WINDOW, StartingStates
from mjrun.model import state


def simulated_starts(
    predictor: Predictor, starting: StartingStates, parts: Sequence[Chunk], values: tuple[float, ...] | None
) -> np.ndarray:
    """States at the beginning of each chunk, `(chunks, nstate)`.

    Every segment is simulated as it was commanded, and at each of its rows measured positions and velocities are set to
    what was measured. The rest follows from the model: a car whose wheels alone are measured moves as these roll.

    Args:
      values: of the parameters; None for the model as it was.
    """
    starts = np.empty((len(parts), len(starting.start)))
    for segment in {id(part.segment): part.segment for part in parts}.values():
        places = [i for i, part in enumerate(parts) if part.segment is segment]
        wanted = [parts[i].first_step for i in places]
        states = _simulated(predictor, starting, segment, values, wanted)
        for i in places:
            starts[i] = starting.guess(parts[i], predictor.timestep, states[parts[i].first_step])
    return starts


def _simulated(
    predictor: Predictor,
    starting: StartingStates,
    segment: Segment,
    values: tuple[float, ...] | None,
    wanted: Sequence[int],
) -> dict[int, np.ndarray]:
    """States of the simulation at the steps `wanted`; that of the start where nothing can be simulated."""
    states = dict.fromkeys(wanted, starting.start)
    model = predictor.compiled(values)
    if model is None:
        return states
    data = mujoco.MjData(model)
    state.restore(model, data, starting.start)
    rows = _rows_by_step(segment, predictor.timestep)
    last = max(wanted)
    whole = Chunk(segment, slice(None), 0, segment.steps(predictor.timestep))
    controls = predictor.controls(Rollout(whole, values, starting.start), last + 1)

    for step in range(last + 1):
        if step in rows:
            starting.place(data, rows[step], predictor.timestep)
        if not (np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()):
            break
        if step in states:
            states[step] = state.save(model, data)
        data.ctrl[:] = controls[step]
        mujoco.mj_step(model, data)
    return states


def _rows_by_step(segment: Segment, timestep: float) -> dict[int, Chunk]:
    """A few rows from each on, by the step before it."""
    steps = segment.steps(timestep)
    rows: dict[int, Chunk] = {}
    for row in range(len(steps)):
        first = math.floor(steps[row] + 1e-9)
        near = slice(row, row + WINDOW)
        rows.setdefault(first, Chunk(segment, near, first, steps[near] - first))
    return rows
