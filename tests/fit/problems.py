"""A pendulum's log and what fits it, shared by tests of what follows from a solution."""

from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import mujoco
import numpy as np

from mjrun.fit.free_parameter import FreeParameter, free_parameters
from mjrun.fit.measurements import Segment
from mjrun.fit.noise import first_noise
from mjrun.fit.prediction import Predictor
from mjrun.fit.shooting import Shooting
from mjrun.fit.solution import Solution, with_noise
from mjrun.fit.starting_states import StartingStates
from mjrun.model import state
from mjrun.simulation.simulation import Simulation
from tests.fit.logs import noisy, simulate, write_model

THREE = (
    ("joint/hinge.damping", "log:1e-3..1"),
    ("joint/hinge.armature", "log:1e-3..1"),
    ("joint/hinge.frictionloss", "log:1e-3..1"),
)


def segments(seconds: float = 3.0, seed: int = 0, *, exact: bool = False) -> list[Segment]:
    """The log of the true pendulum."""
    times, angles = simulate(seconds)
    values = angles if exact else noisy(angles, seed)
    return [Segment("log", times, values[:, None], np.zeros((len(times), 1)))]


def shooting(texts: tuple[tuple[str, str], ...]) -> tuple[Shooting, list[FreeParameter]]:
    """What fits the nominal pendulum."""
    simulation = Simulation(str(write_model(Path(mkdtemp()))))
    parameters = free_parameters(texts, simulation.source, ["qpos/hinge", "ctrl/motor"])
    predictor = Predictor(simulation, ["qpos/hinge"], parameters)
    start = state.save(predictor.model, mujoco.MjData(predictor.model))
    return Shooting(predictor, parameters, StartingStates(predictor.model, ["qpos/hinge"], start)), parameters


@cache
def solved() -> tuple[Solution, tuple[FreeParameter, ...]]:
    """The solution of the log, whose noise is that of its residuals."""
    shoot, parameters = shooting(THREE)
    parts = segments()
    start = np.array([each.first_coordinate for each in parameters])
    last = shoot.search(parts, [start], first_noise(parts)).best
    return with_noise(last, last.observed_noise), tuple(parameters)


def predictor_of(shoot: Shooting) -> Predictor:
    """That which simulates for `shoot`."""
    return shoot._predictor
