"""Every point of a study equals the simulation alone, bit for bit, with any neighbours."""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import chain
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from mjrun.errors import DeviceMemoryError, UnstableError
from mjrun.experiment.design import ABSENT
from mjrun.model.fields import VariedModel
from mjrun.model.source import ModelSource
from mjrun.model.variants import ModelVariant, SharedCompilation, VariantLoader, model_bytes
from mjrun.outputs.recording import Recording
from mjrun.physics.engine import CEngine, Models, RolloutBlock, models_of
from mjrun.physics.warp_engine import WarpEngine
from mjrun.simulation.simulation import Simulation
from mjrun.study import simulate
from mjrun.study.simulate import PointSimulator
from mjrun.study.spec import PointResult, StudyPoint, StudySpec, with_end
from tests.evaluation.tasks import cart_task
from tests.study.models import BALL, BALL_WITH_MEMORY, PENDULUM

METRICS = (
    ("lowest", "min(qpos/ball/z)"),
    ("drift", "max(abs(energy/drift))"),
    ("touch", "first(time, contact/ncon > 0)"),
)


def spec_of(tmp_path: Path, names: tuple[str, ...], every: int = 1, **options: object) -> StudySpec:
    path = tmp_path / "ball.xml"
    path.write_text(BALL)
    return StudySpec(Simulation(str(path), **{"steps": 300, **options}), names, METRICS, every)  # type: ignore[arg-type]


def simulated(spec: StudySpec, points: list[tuple[str, ...]]) -> list[PointResult]:
    parts = PointSimulator(spec).run([StudyPoint(index, values) for index, values in enumerate(points)])
    return sorted(chain.from_iterable(parts), key=lambda result: result.index)


def bare(
    z: float = 0.3, size: float = 0.1, every: int = 1, steps: int = 300, timestep: str = "0.002"
) -> tuple[float, float, float]:
    """Computes the metrics in a bare MuJoCo loop."""
    spec = mujoco.MjSpec.from_string(BALL)
    spec.geom("ball").size[0] = size
    model = spec.compile()
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    model.opt.timestep = float(timestep)
    data = mujoco.MjData(model)
    data.qpos[2] = z
    heights, energies, touches = [], [], []
    for step in range(steps + 1):
        mujoco.mj_forward(model, data)
        if step % every == 0 or step == steps:
            heights.append(data.qpos[2])
            energies.append(data.energy.sum())
            touches.append(data.ncon > 0)
        mujoco.mj_step(model, data)
    first = float(min(touches.index(True) * every, steps) * Fraction(timestep)) if any(touches) else math.nan
    return min(heights), float(np.abs(np.array(energies) - energies[0]).max()), first


@pytest.mark.parametrize("every", [1, 7])
def test_the_metrics_are_those_of_a_bare_loop(tmp_path: Path, every: int) -> None:
    spec = spec_of(tmp_path, ("qpos/ball/z", "geom/ball.size[0]"), every)
    points = [(z, size) for z in ("0.3", "0.5", "2") for size in ("0.1", "0.15")]
    for result, (z, size) in zip(simulated(spec, points), points, strict=True):
        assert result.status == "ok"
        assert result.steps == 300
        np.testing.assert_array_equal(result.metrics, bare(float(z), float(size), every))


def test_a_point_does_not_depend_on_its_neighbours(tmp_path: Path) -> None:
    spec = spec_of(tmp_path, ("opt.timestep", "steps", "ctrl_noise", "opt.integrator", "perturb"))
    points = [
        ("0.002", "300", "0", "implicitfast", "0.1"), ("0.002", "300", "0", "euler", "0.1"),
        ("0.002", "99", "0", "rk4", "0"),
        ("0.004", "300", "0", "euler", "0.2"), ("0.002", "300", "0.1", "euler", "0"), ("0.002", "1", "0", "euler", "0"),
    ]  # fmt: skip
    together = simulated(spec, points)
    for index, values in enumerate(points):
        alone = simulated(spec, [values])[0]
        np.testing.assert_array_equal(together[index].metrics, alone.metrics)
        assert together[index].status == alone.status == "ok", alone.message


def test_numbers_that_are_copied_are_those_of_a_model_alone(tmp_path: Path) -> None:
    names = ("geom/ball.friction[0]", "scale:geom/ball.solref[0]", "opt.gravity", "opt.timestep")
    options = {"perturb": 0.2, "set": [("geom/ball.friction", "0.2 0.01"), ("opt.density", "2")], "timestep": "0.003"}
    points = [
        ("0.3", "1", "0 0 -9", ABSENT), ("0.4", "2", "1 0 -5", ABSENT), ("-1", "1", "0 0 -9", ABSENT),
        ("0.4", ABSENT, "1 0 -5", ABSENT), ("x", "2", "0 0 -1", ABSENT), ("0.5", "3", "0 0", ABSENT),
        ("0.5", "2", "0 -2 -1", "0.004"), ("0.6", "2", "0 -2 -1", "0.002"), ("0.7", "1.5", "0 -2 1e999", "0.002"),
    ]  # fmt: skip
    for count, rows in ((3, [point[:3] for point in points if ABSENT not in point[:3]]), (4, points)):
        spec = spec_of(tmp_path, names[:count], **options)
        together = simulated(spec, rows)
        for result, values in zip(together, rows, strict=True):
            alone = simulated(replace(spec, base=spec.base, names=names[:count]), [values])[0]
            assert (result.status, result.message, result.steps) == (alone.status, alone.message, alone.steps)
            np.testing.assert_array_equal(result.metrics, alone.metrics)
        assert {result.status for result in together} == {"ok", "failed"}
        assert len({result.metrics for result in together if result.status == "ok"}) > 2


@pytest.mark.parametrize(("steps", "duration"), [(300, None), (None, "0.6")])
def test_points_that_differ_in_the_timestep_share_one_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, steps: int | None, duration: str | None
) -> None:
    copies = list[object]()
    monkeypatch.setattr(SharedCompilation, "model_with", lambda self, arrays: copies.append(arrays))
    timesteps = ("0.001", "0.0015", "0.002", "0.003", "0.0015")
    spec = spec_of(tmp_path, ("opt.timestep",), steps=steps, duration=duration)
    for result, timestep in zip(simulated(spec, [(each,) for each in timesteps]), timesteps, strict=True):
        count = steps or int(Fraction("0.6") / Fraction(timestep))
        assert (result.status, result.steps) == ("ok", count)
        np.testing.assert_array_equal(result.metrics, bare(steps=count, timestep=timestep))
    assert not copies


@pytest.mark.parametrize(("path", "most"), [("geom/ball.friction[0]", 1), ("geom/ball.size[0]", 3)])
def test_models_side_by_side_take_no_more_memory_than_the_budget(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, path: str, most: int
) -> None:
    spec = spec_of(tmp_path, (path,))
    points = [(str(0.1 + index / 100),) for index in range(10)]
    expected = simulated(spec, points)
    size, counts = model_bytes(spec.base.load()), list[int]()
    real = CEngine.rollout

    def counted(self: CEngine, models: Models, starts: np.ndarray, *how: object) -> Iterator[RolloutBlock]:
        counts.append(1 if isinstance(models, VariedModel) else len(set(map(id, models_of(models, len(starts))))))
        return real(self, models, starts, *how)  # type: ignore[arg-type]

    monkeypatch.setattr(CEngine, "rollout", counted)
    monkeypatch.setattr(simulate, "BYTES", int(3.5 * size))
    results = simulated(spec, points)
    assert max(counts) == most  # with the one that copies are made of
    assert [result.metrics for result in results] == [result.metrics for result in expected]


@pytest.mark.parametrize("noise", ["0", "0.1"])  # side by side, and alone
def test_the_time_of_a_point_includes_that_of_its_compilation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, noise: str
) -> None:
    now = 0.0

    def load(self: VariantLoader, source: ModelSource) -> ModelVariant:
        nonlocal now
        now += 5.0
        return real(self, source)

    real = VariantLoader.load
    monkeypatch.setattr(VariantLoader, "load", load)
    monkeypatch.setattr(simulate.time, "perf_counter", lambda: now)
    points = [("0.1", noise), ("0.12", noise), ("-1", noise)]
    results = simulated(spec_of(tmp_path, ("geom/ball.size[0]", "ctrl_noise")), points)
    assert [result.status for result in results] == ["ok", "ok", "failed"]
    assert [result.wall for result in results] == [5.0] * 3


@pytest.mark.parametrize("noise", ["0", "1e-300"])  # side by side, and alone
@pytest.mark.parametrize("every", [1, 7])
def test_a_point_ends_where_the_condition_holds(tmp_path: Path, every: int, noise: str) -> None:
    until = "contact/ncon > 0"
    options = {"steps": 600, "ctrl_noise": float(noise)}
    metrics = with_end(METRICS, Simulation("ball.xml", until=until))
    spec = replace(spec_of(tmp_path, ("qpos/ball/z",), every, until=until, **options), metrics=metrics)
    heights = (0.3, 0.31, 1.5, 9)  # the last does not reach the floor
    for result, z in zip(simulated(spec, [(str(z),) for z in heights]), heights, strict=True):
        touch = bare(z, steps=600)[2]
        steps = 600 if math.isnan(touch) else round(touch / 0.002)
        low, drift, _ = bare(z, every=every, steps=steps)
        assert (result.status, result.steps) == ("ok", steps)
        np.testing.assert_array_equal(result.metrics, (low, drift, touch, touch))


@pytest.mark.parametrize("noise", ["0", "1e-300"])
def test_a_failure_after_its_end_is_not_one_of_a_point(tmp_path: Path, noise: str) -> None:
    spec = spec_of(tmp_path, ("qvel/ball/vx",), ctrl_noise=float(noise))
    points = [("1e9",), ("0",)]
    failed = simulated(spec, points)[0]
    assert failed.status == "unstable"
    spec = replace(spec, base=replace(spec.base, until=f"time >= {failed.steps * 0.002 - 1e-9}"))
    results = simulated(spec, points)
    assert [(result.status, result.steps) for result in results] == [("ok", failed.steps)] * 2


def test_a_point_that_fails_does_not_cost_its_neighbours(tmp_path: Path) -> None:
    spec = spec_of(tmp_path, ("qvel/ball/vx", "geom/ball.size[0]"))
    results = simulated(spec, [("0", "0.1"), ("1e9", "0.1"), ("0", "-1"), ("x", "0.1"), ("0", "0.2")])
    assert [result.status for result in results] == ["ok", "unstable", "failed", "failed", "ok"]
    assert [result.exit_code for result in results] == [0, UnstableError.exit_code, 3, 2, 0]
    assert all(math.isnan(value) for value in results[1].metrics)
    assert "unstable at step" in results[1].message
    assert results[1].steps < 300
    np.testing.assert_array_equal(results[0].metrics, bare())
    np.testing.assert_array_equal(results[4].metrics, bare(size=0.2))


def test_what_no_batch_can_hold_runs_alone(tmp_path: Path) -> None:
    path = tmp_path / "pendulum.xml"
    path.write_text(PENDULUM)
    metrics = (("swing", "max(abs(qpos/hinge))"), ("deep", "max(penetration/deepest)"))  # no field holds the second
    spec = StudySpec(Simulation(str(path), steps=50), ("ctrl/motor", "model"), metrics)
    results = simulated(spec, [("1", str(path)), ("2", str(path)), ("1", str(tmp_path / "none.xml"))])
    assert [result.status for result in results] == ["ok", "ok", "failed"]
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    for result, torque in zip(results, (1, 2), strict=False):
        data = mujoco.MjData(model)
        data.ctrl[0] = torque
        angles = [0.0]
        for _ in range(50):
            mujoco.mj_step(model, data)
            angles.append(data.qpos[0])
        assert result.metrics == (max(map(abs, angles)), 0)


def test_a_metric_that_a_model_does_not_have_fails_this_point(tmp_path: Path) -> None:
    other = tmp_path / "other.xml"
    other.write_text(PENDULUM)
    results = simulated(spec_of(tmp_path, ("model",)), [(str(tmp_path / "ball.xml"),), (str(other),)])
    assert [result.status for result in results] == ["ok", "failed"]
    assert "qpos/ball/z" in results[1].message


@pytest.mark.warp
def test_warp_simulates_the_same_in_single_precision(tmp_path: Path) -> None:
    names = ("qpos/ball/z", "qvel/ball/vx", "geom/ball.size[0]", "ctrl_noise")
    spec = spec_of(tmp_path, names, every=10, steps=60)
    points = [("0.3", "0", "0.1", "0"), ("0.5", "1", "0.1", "0"), ("0.5", "1", "0.2", "0"), ("0.3", "0", "0.1", "0.1")]
    exact, warped = simulated(spec, points), simulated(replace(spec, engine="warp"), points)
    assert [result.status for result in warped] == ["ok", "ok", "ok", "failed"]
    assert "engine warp: policies, controllers, replays, tables of controls, noise" in warped[3].message
    for one, other in zip(exact[:3], warped[:3], strict=True):
        np.testing.assert_allclose(other.metrics, one.metrics, rtol=1e-4, atol=1e-4)
        assert other.metrics != one.metrics


@pytest.mark.warp
def test_warp_simulates_points_whose_models_differ_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mujoco_warp")
    counts: list[int] = []
    real = WarpEngine.rollout

    def counted(self: WarpEngine, models: Sequence[mujoco.MjModel], *how: object) -> Iterator[RolloutBlock]:
        counts.append(len(models))
        return real(self, models, *how)  # type: ignore[arg-type]

    monkeypatch.setattr(WarpEngine, "rollout", counted)
    spec = spec_of(tmp_path, ("geom/ball.size[0]", "geom/ball.friction[0]"), every=10, steps=60)
    points = [("0.1", "1"), ("0.12", "0.5"), ("0.15", "0.2")]
    exact, warped = simulated(spec, points), simulated(replace(spec, engine="warp"), points)
    assert counts == [3]
    for one, other in zip(exact, warped, strict=True):
        np.testing.assert_allclose(other.metrics, one.metrics, rtol=1e-4, atol=1e-4)
    assert len({result.metrics for result in warped}) == 3


@pytest.mark.warp
def test_points_that_do_not_fit_on_a_gpu_together_run_in_smaller_groups(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mujoco_warp")
    counts: list[int] = []
    real = WarpEngine.rollout

    def limited(self: WarpEngine, models: Sequence[mujoco.MjModel], *how: object) -> Iterator[RolloutBlock]:
        counts.append(len(models))
        if len(models) > 2:
            raise DeviceMemoryError("too little memory")
        return real(self, models, *how)  # type: ignore[arg-type]

    spec = replace(spec_of(tmp_path, ("qpos/ball/z",), every=10, steps=60), engine="warp")
    points = [("0.3",), ("0.4",), ("0.5",), ("0.6",), ("0.7",)]
    together = simulated(spec, points)
    monkeypatch.setattr(WarpEngine, "rollout", limited)
    separate = simulated(spec, points)
    assert counts == [5, 2, 3, 1, 2]
    assert [result.metrics for result in separate] == [result.metrics for result in together]
    monkeypatch.setattr(WarpEngine, "rollout", lambda *_: (_ for _ in ()).throw(DeviceMemoryError("too little memory")))
    assert {result.message for result in simulated(spec, points)} == {"too little memory"}


def test_a_replay_is_measured_as_it_was_recorded(tmp_path: Path) -> None:
    path = tmp_path / "ball.xml"
    path.write_text(BALL)
    recorded = Simulation(str(path), steps=50, qpos={"ball/z": 0.7})
    Recording(recorded, str(tmp_path / "r.npz")).run()
    spec = StudySpec(Simulation(str(path), replay=str(tmp_path / "r.npz")), ("steps",), METRICS)
    for result, steps in zip(simulated(spec, [("50",), ("20",)]), (50, 20), strict=True):
        np.testing.assert_array_equal(result.metrics, bare(0.7, steps=steps))


def test_controls_may_be_late_or_noisy(tmp_path: Path) -> None:
    path = tmp_path / "pendulum.xml"
    path.write_text(PENDULUM)
    metrics = (("acts", "first(time, abs(actuator_force/motor) > 0)"), ("noise", "std(ctrl/motor)"))
    names = ("actuator/motor.delay", "ctrl_noise", "seed")
    points = [("0.03", "0", "1"), ("0", "0", "1"), ("0.05", "0", "1"), ("0.03", "0", "2"), ("0", "0.5", "1")]
    results = simulated(StudySpec(Simulation(str(path), ctrl={"motor": 1}, steps=400), names, metrics), points)
    assert [result.metrics[0] for result in results[:4]] == [0.03, 0, 0.05, 0.03]
    assert [result.metrics[1] for result in results[:4]] == [0, 0, 0, 0]
    assert results[4].metrics[1] == pytest.approx(0.5, rel=0.2)


def test_a_point_that_an_exception_of_the_users_ends_names_its_line() -> None:
    """Also of an exception without a message, and of one that a library raised for the user's code."""
    code = "import json\ndef bare():\n    raise IndexError\ndef library():\n    json.loads('{')\n"
    users: dict[str, Any] = {"__name__": "users"}
    exec(compile(code, "/home/user/users.py", "exec"), users)
    for name, text in (("bare", r"IndexError \(users.py:3\)"), ("library", r"JSONDecodeError: .+ \(users.py:5\)")):
        with pytest.raises((IndexError, ValueError)) as caught:
            users[name]()
        caught.value.__traceback__ = caught.tb.tb_next
        assert re.fullmatch(text, PointResult.failed(0, caught.value, 1, None).message)


@pytest.mark.parametrize("noise", ["0", "1e-9"])  # side by side, and alone
def test_points_without_enough_memory_fail_one_by_one(tmp_path: Path, noise: str) -> None:
    memory = ("1M", "3K", "1K", "800T", "2M")
    for size in memory:
        (tmp_path / f"{size}.xml").write_text(BALL_WITH_MEMORY.replace("MEMORY", size))
    spec = replace(
        spec_of(tmp_path, ("model",)), base=Simulation(str(tmp_path / "1M.xml"), steps=300, ctrl_noise=float(noise))
    )
    results = simulated(spec, [(str(tmp_path / f"{size}.xml"),) for size in memory])
    assert [result.status for result in results] == ["ok", "failed", "failed", "failed", "ok"]
    assert "out of memory, stack overflow" in results[1].message
    assert "left out contacts or constraints at step" in results[2].message
    assert "Could not allocate memory" in results[3].message
    for result in (results[0], results[4]):
        np.testing.assert_array_equal(result.metrics, bare())


def test_a_metric_of_the_momentum_has_the_masses_of_each_point(tmp_path: Path) -> None:
    spec = replace(spec_of(tmp_path, ("geom/ball.mass",), steps=20), metrics=(("p", "last(momentum/pz)"),))
    results = simulated(spec, [("1",), ("2",), ("4",), ("8",)])
    first = results[0].metrics[0]
    assert first < 0
    for result, mass in zip(results, (1, 2, 4, 8), strict=True):
        np.testing.assert_allclose(result.metrics, (mass * first,), rtol=1e-12)


def test_the_energy_of_an_episode_is_measured_although_its_model_leaves_energy_out(tmp_path: Path) -> None:
    task = cart_task(tmp_path)
    metrics = (("energy", "max(energy/kinetic)"), ("speed", "max(abs(qvel/slider))"))
    spec = StudySpec(Simulation(task, policy="random"), ("seed",), metrics)
    mass = mujoco.MjModel.from_xml_path(str(tmp_path / "cart.xml")).body("cart").mass[0]
    for result in simulated(spec, [("3",), ("4",)]):
        energy, speed = result.metrics
        assert speed > 0
        assert energy == pytest.approx(mass * speed**2 / 2, rel=1e-12)
