"""A pendulum's log and what fits it, shared by tests of what follows from a solution."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import mujoco
import numpy as np

from mjrun.fitting.free_parameter import FreeParameter, free_parameters
from mjrun.fitting.measurements import LogSegment, first_noise
from mjrun.fitting.prediction import Predictor
from mjrun.fitting.shooting_fit import ShootingFit
from mjrun.fitting.shooting_problem import Solution, with_noise
from mjrun.fitting.starting_states import StateGuesses
from mjrun.model import state
from mjrun.simulation.simulation import Simulation
from tests.fitting.logs import noisy, simulate, write_model

THREE = (
    ("joint/hinge.damping", "log:1e-3..1"),
    ("joint/hinge.armature", "log:1e-3..1"),
    ("joint/hinge.frictionloss", "log:1e-3..1"),
)


def segments(seconds: float = 3.0, seed: int = 0, *, exact: bool = False) -> list[LogSegment]:
    """The log of the true pendulum."""
    times, angles = simulate(seconds)
    values = angles if exact else noisy(angles, seed)
    return [LogSegment("log", times, values[:, None], np.zeros((len(times), 1)))]


def shooting_of(
    model: Path,
    free: Sequence[tuple[str, str]],
    signals: Sequence[str],
    controls: Sequence[str],
    log: LogSegment | None = None,
) -> tuple[ShootingFit, Predictor, StateGuesses, list[FreeParameter]]:
    """Returns a shooting of a model from its default state, and its parts; with a log, guesses know its noise."""
    simulation = Simulation(str(model))
    parameters = free_parameters(free, simulation.source, [*signals, *controls])
    predictor = Predictor(simulation, signals, parameters)
    noise = first_noise([log.values], predictor.rotations) if log else None
    start = state.save(predictor.model, mujoco.MjData(predictor.model))
    starting = StateGuesses(predictor.model, signals, start, noise)
    return ShootingFit(predictor, parameters, starting), predictor, starting, parameters


def shooting(
    texts: tuple[tuple[str, str], ...], log: LogSegment | None = None
) -> tuple[ShootingFit, list[FreeParameter]]:
    """Returns a shooting of the nominal pendulum, and its parameters."""
    shoot, _, _, parameters = shooting_of(write_model(Path(mkdtemp())), texts, ["qpos/hinge"], ["ctrl/motor"], log)
    return shoot, parameters


@cache
def solved() -> tuple[Solution, tuple[FreeParameter, ...]]:
    """The solution of the log, whose noise is that of its residuals."""
    shoot, parameters = shooting(THREE)
    parts = segments()
    start = np.array([each.first_coordinate for each in parameters])
    last = shoot.search(parts, [start], first_noise([each.values for each in parts])).best
    return with_noise(last, last.observed_noise), tuple(parameters)


def predictor_of(shoot: ShootingFit) -> Predictor:
    """That which simulates for `shoot`."""
    return shoot._predictor
