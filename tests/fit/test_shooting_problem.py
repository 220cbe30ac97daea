"""The least squares of multiple shooting: slopes against central differences and bare loops."""

from typing import Any

import mujoco
import numpy as np
import pytest

from mjrun.fit.free_parameter import free_parameters
from mjrun.fit.measurements import Segment
from mjrun.fit.prediction import Predictor
from mjrun.fit.shooting import SHORTEST, Shooting
from mjrun.fit.solution import with_noise
from mjrun.fit.starting_states import StartingStates
from mjrun.job.simulation import Simulation
from mjrun.model import state
from tests.fit.car import CAR, SIGNALS, drive
from tests.fit.logs import NOISE, NOMINAL, simulate
from tests.fit.problems import THREE, segments, shooting, solved


def test_sensitivities_are_slopes_of_the_residuals() -> None:
    shoot, parameters = shooting(THREE)
    log = segments()
    parts = shoot.cut(log, SHORTEST)
    states, noise = shoot.guessed(parts, None), np.array([NOISE])
    middle = np.full(len(parameters), 0.5)
    base = shoot.look(parts, middle, states, noise)
    step = 1e-4
    for j in range(len(parameters)):
        ends = [shoot.look(parts, middle + sign * step * np.eye(3)[j], states, noise).residuals for sign in (1, -1)]
        for chunk in range(3):
            slope = (ends[0][chunk] - ends[1][chunk]) / (2 * step)
            np.testing.assert_allclose(base.sensitivities[chunk][0][..., j], slope, rtol=1e-2, atol=0.05)


def test_sensitivities_of_rough_contacts_are_those_of_a_bare_loop() -> None:
    """The contacts of a car's wheels make fine differences jump: slopes over 2 % of the range are those that count."""
    simulation, noise, gear = Simulation(CAR), 1e-3, 1.2
    parameters = free_parameters((("scale:actuator/*.gear[0]", "0.3..3"),), simulation.source, SIGNALS)
    predictor = Predictor(simulation, SIGNALS, parameters)
    start = state.save(predictor.model, mujoco.MjData(predictor.model))
    shoot = Shooting(predictor, parameters, StartingStates(predictor.model, SIGNALS, start))
    angles, controls = drive(gear)
    parts = shoot.cut([Segment("log", 0.01 * np.arange(len(angles)), angles, controls)], 10**6)

    coordinate = parameters[0].coordinate(gear)
    look = shoot.look(parts, np.array([coordinate]), start[None], np.full(2, noise))
    more, less = (drive(parameters[0].value(coordinate + move))[0] for move in (0.02, -0.02))
    slope = (more - less) / 0.04 / noise
    assert np.linalg.norm(look.sensitivities[0][0][..., 0] - slope) < 0.15 * np.linalg.norm(slope)
    assert look.jitters
    jumps = with_noise(look, 2 * look.noise).jitters[0]
    np.testing.assert_allclose(2 * jumps, look.jitters[0])


def test_smooth_motions_have_no_jitter() -> None:
    assert not solved()[0].jitters


def test_parameters_that_are_fixed_stay() -> None:
    shoot, _ = shooting(THREE)
    parts = shoot.cut(segments(), 100)
    fixed = np.array([0.2, 0.3, 0.4])
    solution = shoot.follow(parts, fixed, shoot.guessed(parts, None), np.array([NOISE]))
    assert solution.coordinates.tolist() == fixed.tolist()


def test_the_model_as_it_was_is_followed_although_its_values_are_beyond_the_bounds() -> None:
    shoot, _ = shooting((("joint/hinge.damping", "log:1e-3..1e-2"), ("delay:qpos/hinge", "0.1..0.2")))
    nominal: dict[str, Any] = NOMINAL
    times, angles = simulate(2.0, **nominal)
    parts = shoot.cut([Segment("log", times, angles[:, None], np.zeros((len(times), 1)))], 100)
    solution = shoot.follow(parts, None, shoot.guessed(parts, None), np.array([NOISE]))
    assert solution.cost < 1e-2


def test_a_prior_holds_what_the_data_do_not_say() -> None:
    texts = (("actuator/motor.gear[0]", "0.5..2~normal(1.3, 0.1)"), THREE[0])
    shoot, parameters = shooting(texts)
    parts = shoot.cut(segments(1.0), SHORTEST)
    solution = shoot.solve(parts, np.array([0.1, 0.5]), shoot.guessed(parts, None), np.array([NOISE]))
    assert parameters[0].value(solution.coordinates[0]) == pytest.approx(1.3, abs=1e-3)
