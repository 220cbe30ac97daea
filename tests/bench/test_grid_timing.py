"""Points of a grid: every combination, its accuracy against closed forms, and those that fail."""

import math
from fractions import Fraction
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.bench.bench import Bench, distance_from_finer, noisy_controls, position_distance, simulate_to
from mjrun.bench.block_timing import RolloutInputs
from mjrun.bench.step_timing import StepTimer
from mjrun.errors import BadValueError, UnstableError
from mjrun.model.override import Override
from mjrun.model.sources.file import FileSource
from tests.bench.bench_clocks import MODEL, FakeClock, bench


def test_a_step_has_what_a_bare_loop_finds(path: Path) -> None:
    (row,) = bench(path).run(clock=FakeClock()).rows
    assert row.counts is not None
    assert (row.integrator, row.timestep, row.counts.solver) == ("euler", 0.01, "newton")
    assert row.counts.contacts == 0
    assert row.counts.arena is not None
    assert row.counts.arena_size is not None
    assert row.counts.arena_size > row.counts.arena
    assert row.phases is not None
    assert row.phases.name == "step"
    assert row.phases.seconds > 0


def test_a_grid_is_every_combination_and_each_is_that_model(path: Path) -> None:
    scan = {"integrator": ["euler", "rk4"], "timestep": [".01", ".02"], "opt.gravity": ["0,0,0"]}
    result = bench(path, scan=scan, threads=()).run(clock=FakeClock())
    assert [(row.integrator, row.timestep) for row in result.rows] == [
        ("euler", 0.01),
        ("euler", 0.02),
        ("rk4", 0.01),
        ("rk4", 0.02),
    ]
    assert result.rows[1].point == {"integrator": "euler", "timestep": ".02", "opt.gravity": "0,0,0"}
    assert all([threads.threads for threads in row.threads] == [1] for row in result.rows)
    assert all(row.step and row.step.samples == [1.0] * 8 for row in result.rows)


def test_accuracy_is_measured_without_noise_against_steps_finer_than_the_finest(path: Path) -> None:
    scan = {"integrator": ["euler", "rk4"], "timestep": [".01", ".02"]}
    result = bench(path, scan=scan, accuracy=True, horizon=0.5).run(clock=FakeClock())
    for row in result.rows:
        model = mujoco.MjModel.from_xml_string(MODEL)
        model.opt.timestep = row.timestep
        model.opt.integrator = 1 if row.integrator == "rk4" else 0
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        there = simulate_to(model, data, Fraction(1, 2))
        assert row.accuracy is not None
        assert (row.accuracy.horizon, row.accuracy.energy_drift) == (0.5, there.drift)
        assert row.accuracy.reference == 0.01 / 8
        assert row.accuracy.distance == distance_from_finer(model, data, there, Fraction(1, 800))
    errors = [row.accuracy.distance for row in result.rows if row.accuracy and row.accuracy.distance]
    assert errors[0] < errors[1]
    assert errors[2] < errors[3] < errors[0]


@pytest.mark.parametrize(("reference", "refused"), [(".009", False), (".01", True), (".015", True)])
def test_a_reference_must_be_finer_than_every_timestep(
    path: Path, monkeypatch: pytest.MonkeyPatch, reference: str, refused: bool
) -> None:
    job = bench(path, scan={"timestep": [".02", ".01"]}, accuracy=True, reference=reference)
    if not refused:
        assert {row.accuracy and row.accuracy.reference for row in job.run(clock=FakeClock()).rows} == {0.009}
        return
    monkeypatch.setattr(StepTimer, "warm_up", lambda self: pytest.fail("was timed"))
    with pytest.raises(BadValueError, match=rf"reference: '0{reference}' is not finer than.* finest is 0.01 s"):
        job.run(clock=FakeClock())


def test_an_unstable_point_of_a_grid_is_a_result_and_a_grid_of_them_an_error(path: Path) -> None:
    good, bad = bench(path, scan={"timestep": [".01", "1"]}, accuracy=True, horizon=100).run(clock=FakeClock()).rows
    assert good.failure is None
    assert bad.step is None
    assert bad.failure is not None
    assert bad.failure.startswith("the simulation became unstable at step")
    assert bad.accuracy is not None
    assert bad.accuracy.failure is not None
    with pytest.raises(UnstableError, match="joint 'x'"):
        bench(path, scan={"timestep": ["1", "2"]}).run(clock=FakeClock())
    with pytest.raises(UnstableError):
        bench(FileSource(path, overrides=(Override("opt.timestep", "1"),))).run(clock=FakeClock())


@pytest.mark.parametrize(
    ("options", "key", "center"), [(None, "test", 0.5), ("rest", "rest", 0.0), (1, "1", 0.0), (0, "0", 0.5)]
)
def test_it_starts_from_the_keyframe_called_test_with_noise_about_its_controls(
    path: Path, options: str | int | None, key: str, center: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs: list[RolloutInputs] = []
    begun = StepTimer.warm_up
    monkeypatch.setattr(StepTimer, "warm_up", lambda self: (begun(self), runs.append(self.run))[0])
    result = bench(path, key=options).run(clock=FakeClock())
    assert result.options.key == key
    model = mujoco.MjModel.from_xml_string(MODEL)
    assert runs[0].data().qpos[0] == (0.3 if center else 0)
    assert runs[0].controls is not None
    assert runs[0].controls.tolist() == noisy_controls(model, 20, center=np.array([center])).tolist()


def test_without_noise_the_controls_stay_those_of_the_start(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs: list[RolloutInputs] = []
    begun = StepTimer.warm_up
    monkeypatch.setattr(StepTimer, "warm_up", lambda self: (begun(self), runs.append(self.run))[0])
    bench(path, noise_std=0).run(clock=FakeClock())
    assert runs[0].controls is None
    assert runs[0].data().ctrl.tolist() == [0.5]


@pytest.mark.filterwarnings("ignore::mjrun.errors.MjrunWarning")
def test_real_models_are_timed(shared_models: Path) -> None:
    for name in ("humanoid/humanoid.xml", "car/car.xml"):
        result = Bench(shared_models / name, steps=5, repeats=2, threads=(1, 2)).run(clock=FakeClock())
        assert result.rows[0].step is not None
        assert result.rows[0].threads[-1].threads == 2


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
    result = simulate_to(model, data, Fraction(1, 3))
    assert result.time == Fraction(33, 100)
    for _ in range(33):
        mujoco.mj_step(model, data)
    assert result.qpos.tolist() == data.qpos.tolist()
    energy = 50 * data.qpos[0] ** 2 + 0.5 * data.qvel[0] ** 2
    assert result.drift == pytest.approx(energy - 50)
    assert abs(result.drift) > 0.1


def test_nothing_is_changed_by_looking() -> None:
    model, data = spring("Euler")
    flags, before = int(model.opt.enableflags), data.qpos.copy()
    distance_from_finer(model, data, simulate_to(model, data, Fraction(1, 3)), Fraction(1, 1000))
    assert (model.opt.enableflags, model.opt.timestep) == (flags, 0.01)
    assert data.qpos.tolist() == before.tolist()


@pytest.mark.parametrize(("integrator", "tolerance"), [("Euler", 2e-2), ("RK4", 1e-3)])
def test_the_distance_from_a_finer_run_is_that_from_the_closed_form(integrator: str, tolerance: float) -> None:
    model, data = spring(integrator)
    result = simulate_to(model, data, Fraction(1))
    error = abs(result.qpos[0] - math.cos(10))
    assert distance_from_finer(model, data, result, Fraction(1, 10_000)) == pytest.approx(error, rel=tolerance)


def test_a_finer_run_that_does_not_meet_the_instant_goes_the_rest_by_its_velocity() -> None:
    model, data = spring("RK4")
    result = simulate_to(model, data, Fraction(1, 2))
    meeting = distance_from_finer(model, data, result, Fraction(1, 8000))
    missing = distance_from_finer(model, data, result, Fraction(1, 7777))
    assert (result.time / Fraction(1, 7777)).denominator > 1
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
