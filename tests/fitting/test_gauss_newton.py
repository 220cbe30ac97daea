"""Gauss-Newton steps against least squares of scipy, and motions whose derivatives mislead."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from mjrun.fitting.gauss_newton import GaussNewton, is_rough, solve_normal
from mjrun.fitting.measurements import LogSegment, first_noise
from mjrun.fitting.prediction import ChunkInitialStates, ChunkRolloutInputs
from mjrun.fitting.shooting_problem import STATE_SCALE, ShootingProblem, together
from tests.fitting.box import FRICTION, box_shooting
from tests.fitting.logs import NOISE
from tests.fitting.problems import THREE, predictor_of, segments, shooting, shooting_of, solved

DOUBLE = """<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody><body>
    <joint name="one" axis="0 1 0" damping="{one}"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".02" mass="1"/>
    <body pos="0 0 -.4">
      <joint name="two" axis="0 1 0" damping="{two}"/>
      <geom name="tip" type="capsule" fromto="0 0 0 0 0 -.3" size=".02" mass="{mass}"/>
    </body>
  </body></worldbody>
</mujoco>"""


@pytest.mark.parametrize("loss", ["linear", "huber"])
def test_it_ends_where_scipy_does(loss: str) -> None:
    from scipy.optimize import least_squares

    shoot, parameters = shooting(THREE[:2])
    predictor = predictor_of(shoot)
    (part,) = shoot.cut(segments(1.0))
    guess, noise = shoot.guessed([part], None), np.array([NOISE])
    states = ChunkInitialStates(predictor.model)
    problem = ShootingProblem(predictor, parameters, states, [part], np.array([0.5, 0.5]), guess, noise, loss, False)
    (solution,) = together(predictor, [GaussNewton(problem).minimize()])

    def residuals(x: np.ndarray) -> np.ndarray:
        values = tuple(p.value(c) for p, c in zip(parameters, x[:2], strict=True))
        (rows,) = predictor.predict([ChunkRolloutInputs(part, values, states.moved(guess[0], x[2:]))])
        return np.concatenate([((rows - part.values) / noise).ravel(), x[2:] / STATE_SCALE])

    start: Any = np.concatenate([solution.coordinates, np.zeros(2)])
    bounds = ([0, 0, -np.inf, -np.inf], [1, 1, np.inf, np.inf])
    expected = least_squares(residuals, start, bounds=bounds, x_scale="jac", loss=loss, xtol=1e-12, ftol=1e-12)
    np.testing.assert_allclose(solution.coordinates, expected.x[:2], atol=2e-4)


def test_it_follows_a_curved_valley_to_its_end(tmp_path: Path) -> None:
    """Of a log that hardly shows the damping of a joint, each step gains little of the sum of squares."""
    generator = np.random.default_rng(6)
    model = mujoco.MjModel.from_xml_string(DOUBLE.format(one=0.03, two=0.02, mass=0.6))
    data = mujoco.MjData(model)
    data.qpos[:] = generator.uniform(-1.3, 1.3, 2)
    angles = np.empty((300, 2))
    for row in angles:
        row[:] = data.qpos
        mujoco.mj_step(model, data, nstep=5)
    angles += NOISE * generator.normal(size=angles.shape)
    log = LogSegment("log", np.arange(240) * 0.01, angles[:240], np.zeros((240, 0)))
    (tmp_path / "double.xml").write_text(DOUBLE.format(one=0.1, two=0.005, mass=0.4))
    free = (("joint/one.damping", "log:1e-3..1"), ("joint/two.damping", "log:1e-3..1"), ("geom/tip.mass", "0.1..2"))
    shoot, _, _, parameters = shooting_of(tmp_path / "double.xml", free, ["qpos/one", "qpos/two"], [], log)
    noise = first_noise([log.values])
    end = shoot.search([log], [np.array([each.first_coordinate for each in parameters])], noise).best
    again = shoot.solve(end.chunks, end.coordinates, end.states, noise)
    assert 240 * (end.cost**2 - again.cost**2) < 0.5


def test_parameters_stop_at_their_bounds() -> None:
    """The true damping is below the bounds."""
    shoot, _ = shooting((("joint/hinge.damping", "0.2..1"), THREE[1]))
    (part,) = shoot.cut(segments(1.0))
    solution = shoot.solve([part], np.array([0.5, 0.5]), shoot.guessed([part], None), np.array([NOISE]))
    assert solution.coordinates[0] == 0.0
    assert 0 < solution.coordinates[1] < 1


@pytest.mark.slow
def test_problems_side_by_side_come_to_what_each_comes_to_alone() -> None:
    shoot, _ = shooting(THREE[:1])
    parts = shoot.cut(segments(0.5))
    alone = [shoot.solve(parts, np.array(x), shoot.guessed(parts, None), np.array([NOISE])) for x in ([0.4], [0.7])]
    tasks = [
        GaussNewton(shoot._problem(parts, np.array(x), shoot.guessed(parts, None), np.array([NOISE]))).minimize()
        for x in ([0.4], [0.7])
    ]
    beside = together(predictor_of(shoot), tasks)
    for one, other in zip(alone, beside, strict=True):
        np.testing.assert_array_equal(one.coordinates, other.coordinates)


def test_steep_slopes_leave_normal_equations_solvable() -> None:
    """Two unknowns that residuals only tell the sum of, beside which what holds them in place is lost in rounding."""
    matrix = 1e20 * np.ones((2, 2)) + np.eye(2)
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.solve(matrix, np.ones(2))
    np.testing.assert_allclose(solve_normal(matrix, 1e20 * np.ones((2, 1))).sum(), 1.0)


def test_derivatives_mislead_beside_contacts_and_not_where_motion_is_smooth() -> None:
    """A box that slides and rattles, and a pendulum, both at the true values."""
    shoot, log, noise, parameters = box_shooting()
    parts = shoot.cut([log])
    truth = np.array([parameters[0].coordinate(FRICTION)])
    states = shoot.guessed(parts, truth)
    box = shoot._problem(parts, truth, states, noise), shoot.look(parts, truth, states, noise)

    solution, _ = solved()
    smooth, _ = shooting(THREE)
    pendulum = smooth._problem(solution.chunks, solution.coordinates, solution.states, solution.noise), solution

    for one, (problem, at), rough in ((shoot, box, True), (smooth, pendulum, False)):
        (answer,) = together(predictor_of(one), [is_rough(problem, at.sensitivities)])
        assert answer == rough
