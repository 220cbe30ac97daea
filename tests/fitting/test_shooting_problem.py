"""The least squares of multiple shooting: slopes against central differences and bare loops."""

from typing import Any

import numpy as np
import pytest

from mjrun.fitting.measurements import Segment
from mjrun.fitting.shooting_fit import SHORTEST
from tests.fitting.logs import NOISE, NOMINAL, simulate
from tests.fitting.problems import THREE, segments, shooting


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


def test_parameters_that_are_fixed_stay() -> None:
    shoot, _ = shooting(THREE)
    parts = shoot.cut(segments(), 100)
    fixed = np.array([0.2, 0.3, 0.4])
    solution = shoot.follow(parts, fixed, np.array([NOISE]))
    assert solution.coordinates.tolist() == fixed.tolist()


def test_the_model_as_it_was_is_followed_although_its_values_are_beyond_the_bounds() -> None:
    shoot, _ = shooting((("joint/hinge.damping", "log:1e-3..1e-2"), ("delay:qpos/hinge", "0.1..0.2")))
    nominal: dict[str, Any] = NOMINAL
    times, angles = simulate(2.0, **nominal)
    parts = shoot.cut([Segment("log", times, angles[:, None], np.zeros((len(times), 1)))], 100)
    solution = shoot.follow(parts, None, np.array([NOISE]))
    assert solution.cost < 1e-2


def test_a_prior_holds_what_the_data_do_not_say() -> None:
    texts = (("actuator/motor.gear[0]", "0.5..2~normal(1.3, 0.1)"), THREE[0])
    shoot, parameters = shooting(texts)
    parts = shoot.cut(segments(1.0), SHORTEST)
    solution = shoot.solve(parts, np.array([0.1, 0.5]), shoot.guessed(parts, None), np.array([NOISE]))
    assert parameters[0].value(solution.coordinates[0]) == pytest.approx(1.3, abs=1e-3)
