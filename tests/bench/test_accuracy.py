"""How far a simulation is from the truth, against closed forms."""

import math
from fractions import Fraction

import mujoco
import numpy as np
import pytest

from mjrun.bench.settings_grid import distance_from_finer, position_distance, simulate_to
from mjrun.errors import UnstableError

# A mass on a spring: x = cos(10 t).
SPRING = """
<mujoco>
  <option timestep="{timestep}" integrator="{integrator}" gravity="0 0 0"/>
  <worldbody>
    <body><joint name="x" type="slide" axis="1 0 0" stiffness="100"/><geom size=".1" mass="1"/></body>
  </worldbody>
</mujoco>
"""
POSES = """
<mujoco>
  <worldbody><body><freejoint/><geom size=".1"/></body><body><joint/><geom size=".1"/></body></worldbody>
</mujoco>
"""


def spring(integrator: str, timestep: str = ".01") -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(SPRING.format(integrator=integrator, timestep=timestep))
    data = mujoco.MjData(model)
    data.qpos[0] = 1
    return model, data


def test_it_arrives_at_the_whole_step_nearest_to_the_horizon_and_drift_is_the_energy_it_has_made() -> None:
    model, data = spring("Euler")
    found = simulate_to(model, data, Fraction(1, 3))
    assert found.time == Fraction(33, 100)
    for _ in range(33):
        mujoco.mj_step(model, data)
    assert found.qpos.tolist() == data.qpos.tolist()
    energy = 50 * data.qpos[0] ** 2 + 0.5 * data.qvel[0] ** 2
    assert found.drift == pytest.approx(energy - 50)
    assert abs(found.drift) > 0.1


def test_nothing_is_changed_by_looking() -> None:
    model, data = spring("Euler")
    flags, before = int(model.opt.enableflags), data.qpos.copy()
    distance_from_finer(model, data, simulate_to(model, data, Fraction(1, 3)), Fraction(1, 1000))
    assert (model.opt.enableflags, model.opt.timestep) == (flags, 0.01)
    assert data.qpos.tolist() == before.tolist()


@pytest.mark.parametrize(("integrator", "tolerance"), [("Euler", 2e-2), ("RK4", 1e-3)])
def test_the_distance_from_a_finer_run_is_that_from_the_closed_form(integrator: str, tolerance: float) -> None:
    model, data = spring(integrator)
    found = simulate_to(model, data, Fraction(1))
    error = abs(found.qpos[0] - math.cos(10))
    assert distance_from_finer(model, data, found, Fraction(1, 10_000)) == pytest.approx(error, rel=tolerance)


def test_a_finer_run_that_does_not_meet_the_instant_goes_the_rest_by_its_velocity() -> None:
    model, data = spring("RK4")
    found = simulate_to(model, data, Fraction(1, 2))
    meeting = distance_from_finer(model, data, found, Fraction(1, 8000))
    missing = distance_from_finer(model, data, found, Fraction(1, 7777))
    assert (found.time / Fraction(1, 7777)).denominator > 1
    assert missing == pytest.approx(meeting, abs=100 / 2 / 7777**2)  # what acceleration adds in half a step


def test_positions_are_a_root_mean_square_over_degrees_of_freedom_apart() -> None:
    model = mujoco.MjModel.from_xml_string(POSES)
    data = mujoco.MjData(model)
    moved = data.qpos.copy()
    mujoco.mj_integratePos(model, moved, np.array([1.0, 2, 3, 0, 0.4, 0, 0.5]), 1)
    assert position_distance(model, data.qpos, moved) == pytest.approx(math.sqrt((1 + 4 + 9 + 0.16 + 0.25) / 7))
    assert position_distance(mujoco.MjModel.from_xml_string("<mujoco/>"), np.empty(0), np.empty(0)) == 0


def test_an_unstable_simulation_does_not_arrive() -> None:
    model, data = spring("Euler", "1")
    with pytest.raises(UnstableError):
        simulate_to(model, data, Fraction(1000))
