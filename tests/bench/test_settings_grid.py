"""The points of a grid: every combination, its accuracy, and those that fail."""

import sys
from fractions import Fraction
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.bench.bench import Bench
from mjrun.bench.rollout_timing import RolloutInputs
from mjrun.bench.settings_grid import distance_from_finer, simulate_to
from mjrun.bench.step_timing import StepTimer
from mjrun.bench.testspeed_noise import controls
from mjrun.errors import BadValueError, UnstableError
from mjrun.model.sources.file import FileSource
from mjrun.physics.parameter_grid import settings

sys.path.append(str(Path(__file__).parent))

from bench_clocks import MODEL, FakeClock, bench


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "model.xml"
    path.write_text(MODEL)
    return path


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
    found = bench(path, scan=scan, threads=()).run(clock=FakeClock())
    assert [(row.integrator, row.timestep) for row in found.rows] == [
        ("euler", 0.01),
        ("euler", 0.02),
        ("rk4", 0.01),
        ("rk4", 0.02),
    ]
    assert found.rows[1].point == {"integrator": "euler", "timestep": ".02", "opt.gravity": "0,0,0"}
    assert all([threads.threads for threads in row.threads] == [1] for row in found.rows)
    assert all(row.step and row.step.samples == [1.0] * 8 for row in found.rows)


def test_accuracy_is_measured_without_noise_against_steps_finer_than_the_finest(path: Path) -> None:
    scan = {"integrator": ["euler", "rk4"], "timestep": [".01", ".02"]}
    found = bench(path, scan=scan, accuracy=True, horizon=0.5).run(clock=FakeClock())
    for row in found.rows:
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
    errors = [row.accuracy.distance for row in found.rows if row.accuracy and row.accuracy.distance]
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
        bench(FileSource(path, overrides=settings({"timestep": "1"}))).run(clock=FakeClock())


@pytest.mark.parametrize(
    ("given", "key", "center"), [(None, "test", 0.5), ("rest", "rest", 0.0), (1, "1", 0.0), (0, "0", 0.5)]
)
def test_it_starts_from_the_keyframe_called_test_with_noise_about_its_controls(
    path: Path, given: str | int | None, key: str, center: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs: list[RolloutInputs] = []
    begun = StepTimer.warm_up
    monkeypatch.setattr(StepTimer, "warm_up", lambda self: (begun(self), runs.append(self.run))[0])
    found = bench(path, key=given).run(clock=FakeClock())
    assert found.options.key == key
    model = mujoco.MjModel.from_xml_string(MODEL)
    assert runs[0].data().qpos[0] == (0.3 if center else 0)
    assert runs[0].controls is not None
    assert runs[0].controls.tolist() == controls(model, 20, center=np.array([center])).tolist()


def test_without_noise_the_controls_stay_those_of_the_start(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs: list[RolloutInputs] = []
    begun = StepTimer.warm_up
    monkeypatch.setattr(StepTimer, "warm_up", lambda self: (begun(self), runs.append(self.run))[0])
    bench(path, noise_std=0).run(clock=FakeClock())
    assert runs[0].controls is None
    assert runs[0].data().ctrl.tolist() == [0.5]


@pytest.mark.filterwarnings("ignore::mjrun.errors.MjrunWarning")
def test_real_models_are_timed(shared_models: Path) -> None:
    for name in ("humanoid/humanoid.xml", "sleep/dominos.xml", "plugin/sdf/torus.xml", "flex/flag.xml"):
        found = Bench(shared_models / name, steps=5, repeats=2, threads=(1, 2)).run(clock=FakeClock())
        assert found.rows[0].step is not None
        assert found.rows[0].threads[-1].threads == 2
