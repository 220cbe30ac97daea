"""Benchmarks with a fake clock: exact figures, a planted slowdown, and what the document holds."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch

from mjrun.bench.accuracy import distance, simulate_to
from mjrun.bench.bench import Bench
from mjrun.bench.control_noise import controls
from mjrun.bench.machine_info import MachineInfo, machine_info
from mjrun.bench.results import BenchResult
from mjrun.bench.rollout_timing import Run
from mjrun.bench.step_timing import StepTimer, TimingBudget, rounded_down
from mjrun.camera.argument import script
from mjrun.camera.motion import CameraMotion
from mjrun.errors import BadValueError, FileError, ModelNotFoundError, UnstableError, UsageError
from mjrun.job.view import Drawing
from mjrun.model.sources.file import FileSource
from mjrun.rendering.backend import Backend
from mjrun.rendering.classic import ClassicRenderer
from mjrun.rendering.segmentation import Segmentation
from mjrun.rendering.timed_renderers import Stopwatch, TimedClassicRenderer
from mjrun.rendering.visual import Visual
from mjrun.sim.parameter_grid import points, scan_values, settings

MODEL = """
<mujoco>
  <option timestep=".01"/>
  <visual><global offwidth="64" offheight="48"/></visual>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="1 1 .1"/>
    <body pos="0 0 .2"><joint name="x" type="slide" axis="1 0 0" stiffness="100"/><geom size=".1" mass="1"/></body>
  </worldbody>
  <actuator><motor name="m" joint="x"/></actuator>
  <keyframe><key name="test" qpos=".3" ctrl=".5"/><key name="rest"/></keyframe>
</mujoco>
"""


class FakeClock:
    """Goes on by `tick` [s] at every look, give or take `noise` of it."""

    def __init__(self, tick: float = 1.0, noise: float = 0.0, seed: int = 0) -> None:
        self.now, self._tick, self._noise = 0.0, tick, noise
        self._random = np.random.default_rng(seed)

    def __call__(self) -> float:
        self.now += self._tick * (1 + self._noise * self._random.random())
        return self.now


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "model.xml"
    path.write_text(MODEL)
    return path


def bench(model: Path | FileSource | mujoco.MjModel, **changed: Any) -> Bench:
    return Bench(model, **{"steps": 20, "repeats": 8, "threads": (1, 2), **changed})


def test_figures_are_exactly_those_of_the_clock(path: Path) -> None:
    found = bench(path).run(clock=FakeClock())
    (row,) = found.rows
    assert row.step is not None
    # A look at the clock costs a second, so every block is a single step of a second.
    assert (row.block, row.steps) == (1, 20)
    assert row.step.samples == [1.0] * 8
    assert (row.step.median, row.step.low, row.step.high, row.step.min) == (1.0, 1.0, 1.0, 1.0)
    assert (row.step.p5, row.step.p95, row.step.confidence) == (1.0, 1.0, 1 - 2 / 2**8)
    assert (row.steps_per_second, row.realtime_factor) == (1.0, 0.01)
    one, two = row.threads
    assert (one.threads, one.step, one.scaling) == (1, row.step, 1.0)
    # On two threads ten steps of both are timed by two looks: 20 steps a second.
    assert (two.threads, two.steps_per_second, two.scaling) == (2, pytest.approx(20), pytest.approx(20))
    assert two.realtime_factor == pytest.approx(0.2)
    assert found.load is not None
    assert found.load.first == 1.0
    assert found.load.parse is not None
    assert found.load.parse.samples == [1.0] * 3
    assert found.wall > 8 * 20


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


@pytest.mark.parametrize(
    ("given", "key", "center"), [(None, "test", 0.5), ("rest", "rest", 0.0), (1, "1", 0.0), (0, "0", 0.5)]
)
def test_it_starts_from_the_keyframe_called_test_with_noise_about_its_controls(
    path: Path, given: str | int | None, key: str, center: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs: list[Run] = []
    begun = StepTimer.warm_up
    monkeypatch.setattr(StepTimer, "warm_up", lambda self: (begun(self), runs.append(self.run))[0])
    found = bench(path, key=given).run(clock=FakeClock())
    assert found.options.key == key
    model = mujoco.MjModel.from_xml_string(MODEL)
    assert runs[0].data().qpos[0] == (0.3 if center else 0)
    assert runs[0].controls is not None
    assert runs[0].controls.tolist() == controls(model, 20, center=np.array([center])).tolist()


def test_without_noise_the_controls_stay_those_of_the_start(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs: list[Run] = []
    begun = StepTimer.warm_up
    monkeypatch.setattr(StepTimer, "warm_up", lambda self: (begun(self), runs.append(self.run))[0])
    bench(path, noise_std=0).run(clock=FakeClock())
    assert runs[0].controls is None
    assert runs[0].data().ctrl.tolist() == [0.5]


def compared(path: Path, factor: float, seed: int) -> BenchResult:
    job = bench(path, repeats=20, compare=str(path.with_name("base.json")), fail_above=0.1)
    return job.run(clock=FakeClock(factor, 0.1, seed))


def test_a_planted_slowdown_of_30_percent_is_caught_and_ten_repeats_of_the_same_build_are_not(path: Path) -> None:
    bench(path, repeats=20, save=str(path.with_name("base.json"))).run(clock=FakeClock(1.0, 0.1, 99))
    slow = compared(path, 1.3, 5).comparison
    assert slow is not None
    assert slow.verdict == "slower"
    assert [ratio.name for ratio in slow.ratios] == ["step", "threads 2"]
    assert slow.ratios[0].ratio == pytest.approx(1.3, rel=0.05)
    same = [compared(path, 1.0, seed).comparison for seed in range(10)]
    assert [one.verdict for one in same if one] == ["not slower"] * 10
    fast = compared(path, 0.7, 6).comparison
    assert fast is not None
    assert fast.verdict == "faster"


def test_a_base_is_refused_before_anything_is_timed(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    base = str(path.with_name("base.json"))
    bench(path, save=base).run(clock=FakeClock())
    monkeypatch.setattr(StepTimer, "warm_up", lambda self: pytest.fail("was timed"))
    with pytest.raises(UsageError, match=r"noise_std: 0.01 there, 0.5 here\n--force"):
        bench(path, compare=base, noise_std=0.5).run(clock=FakeClock())
    with pytest.raises(UsageError, match="another model"):
        bench(FileSource(path, settings=settings({"opt.gravity": "0,0,-1"})), compare=base).run(clock=FakeClock())
    with pytest.raises(FileError, match="cannot be read"):
        bench(path, compare="none.json").run(clock=FakeClock())


def test_what_differs_may_be_compared_by_force_and_is_told(path: Path) -> None:
    base = str(path.with_name("base.json"))
    bench(path, save=base).run(clock=FakeClock())
    found = bench(path, compare=base, noise_std=0.5, force=True).run(clock=FakeClock()).comparison
    assert found is not None
    assert found.differences == ["noise_std: 0.01 there, 0.5 here"]


def test_a_benchmark_takes_as_many_steps_as_its_base(path: Path) -> None:
    base = str(path.with_name("base.json"))
    bench(path, save=base, steps=33).run(clock=FakeClock())
    found = bench(path, compare=base, steps=None).run(clock=FakeClock())
    assert found.rows[0].steps == 33
    assert found.comparison is not None


def test_what_is_saved_is_the_document_and_appears_whole(path: Path) -> None:
    base = path.with_name("base.json")
    found = bench(path, save=str(base)).run(clock=FakeClock())
    assert json.loads(base.read_text()) == json.loads(json.dumps(asdict(found)))
    with pytest.raises(FileError, match="no folder"):
        bench(path, save=str(path.parent / "none/base.json")).run(clock=FakeClock())
    before = base.read_text()
    with pytest.raises(ModelNotFoundError):
        bench(path.with_name("none.xml"), save=str(base)).run(clock=FakeClock())
    assert base.read_text() == before


STAT = ["n", "median", "low", "high", "confidence", "min", "p5", "p95", "samples"]
KEYS = {
    "": [
        *("mjrun", "mujoco", "numpy", "python", "command", "machine", "load_after", "engine", "model", "options"),
        *("load", "rows", "frames", "whole", "comparison", "notes", "wall", "schema"),
    ],
    "machine": ["system", "cpu", "cores", "available", "governor", "load"],
    "engine": ["name", "version", "device", "device_name", "worlds", "nconmax", "njmax"],
    "model": ["path", "sha256", "file_sha256", "nq", "nv", "nu", "nbody", "ngeom"],
    "options": ["key", "noise_std", "noise_rate", "steps", "repeats", "budget", "settings", "scan"],
    "load": ["first", "parse", "compile"],
    "load/parse": STAT,
    "load/compile": STAT,
    "rows": [
        *("point", "integrator", "timestep", "steps", "block", "step", "steps_per_second", "realtime_factor"),
        *("first_step", "counts", "phases", "threads", "overflows", "accuracy", "failure"),
    ],
    "rows/step": STAT,
    "rows/counts": ["contacts", "constraints", "solver", "iterations", "arena", "arena_size"],
    "rows/phases": ["name", "seconds", "share", "parts"],
    "rows/threads": ["threads", "step", "steps_per_second", "realtime_factor", "scaling"],
    "rows/threads/step": STAT,
    "rows/accuracy": ["horizon", "energy_drift", "reference", "distance", "failure"],
    "frames": [
        *("view", "size", "renderer", "quality", "device", "software", "first", "update", "draw", "read", "compose"),
        *("total", "encode"),
    ],
    **{f"frames/{part}": STAT for part in ("update", "draw", "read", "compose", "total", "encode")},
    "whole": ["what", "simulated", "count", "unit", "seconds", "simulation", "rest"],
    "comparison": ["base", "limit", "verdict", "ratios", "gone", "differences"],
    "comparison/ratios": ["name", "base", "now", "ratio", "low", "high", "fastest", "verdict"],
    "comparison/gone": ["name", "base", "failure"],
}


def keys_of(value: Any, where: str = "") -> dict[str, list[str]]:
    """The keys of every object in a document, by where it is."""
    if isinstance(value, list):
        return {name: keys for item in value for name, keys in keys_of(item, where).items()}
    if not isinstance(value, dict) or where in ("options/scan", "rows/point"):
        return {}
    found = {where: list(value)}
    for key, item in value.items():
        found |= keys_of(item, f"{where}/{key}".lstrip("/")) if where != "rows/phases" else {}
    return found


@pytest.mark.gl
def test_the_document_has_these_keys(path: Path) -> None:
    base = str(path.with_name("base.json"))
    bench(path, save=base, threads=(1, 2, 3)).run(clock=FakeClock())
    job = bench(path, accuracy=True, drawings=[Drawing(size=(64, 48))], whole=True, compare=base)
    found = json.loads(json.dumps(asdict(job.run(clock=FakeClock()))))
    assert found["schema"] == "mjrun-bench-1"
    assert keys_of(found) == KEYS


def test_a_grid_is_every_combination_and_each_is_that_model(path: Path) -> None:
    scan = {"integrator": ["euler", "rk4"], "timestep": [".01", ".02"], "opt.gravity": ["0,0,0"]}
    found = bench(path, scan=scan, threads=None).run(clock=FakeClock())
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
        assert row.accuracy.distance == distance(model, data, there, Fraction(1, 800))
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
    with pytest.raises(BadValueError, match=rf"--reference: '0{reference}' is not finer than.* finest is 0.01 s"):
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
        bench(FileSource(path, settings=settings({"timestep": "1"}))).run(clock=FakeClock())


def test_a_compiled_model_is_timed_but_not_loaded() -> None:
    found = bench(mujoco.MjModel.from_xml_string(MODEL)).run(clock=FakeClock())
    assert (found.load, found.model.path, found.model.file_sha256) == (None, "", None)
    assert found.model.nv == 1
    with pytest.raises(UsageError, match="give its file"):
        bench(mujoco.MjModel.from_xml_string(MODEL), scan={"timestep": [".1"]})


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"steps": 0}, "--steps: '0' is not a positive whole number"),
        ({"repeats": -1}, "--repeats"),
        ({"noise_std": 1.1}, "--noise-std: '1.1' is not a number from 0 to 1"),
        ({"noise_rate": float("nan")}, "--noise-rate"),
        ({"threads": [0]}, "--threads: '0' is not a number from 1 on, or auto"),
        ({"threads": ["all"]}, "--threads"),
        ({"budget": 0}, "--budget: '0' is not a positive number"),
        ({"horizon": -1}, "--horizon"),
        ({"fail_above": -0.1}, "--fail-above"),
    ],
)
def test_numbers_that_cannot_be_are_refused_at_once(path: Path, changed: dict[str, Any], said: str) -> None:
    with pytest.raises(BadValueError, match=said):
        bench(path, **changed)


class WorkClock:
    """Goes on by `cost` [s] for every step that has been taken since the last look."""

    def __init__(self, cost: float) -> None:
        self._cost, self.steps, self.now = cost, 0, 0.0

    def __call__(self) -> float:
        self.now, self.steps = self.now + self._cost * self.steps, 0
        return self.now


@pytest.mark.parametrize(
    # A budget of 3 s leaves 1.2 s for rollouts, of which there are 7 to 50.
    ("cost", "steps", "block", "repeats"),
    [(2**-20, 10_000, 2000, 50), (2**-15, 5000, 50, 7), (2**-10, 100, 2, 12), (1.0, 1, 1, 7)],
)
def test_the_budget_decides_how_many_steps_are_taken_how_often(
    cost: float, steps: int, block: int, repeats: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = WorkClock(cost)
    rollout = Batch.rollout

    def counted(self: Any, nstep: int, *arguments: Any, **settings: Any) -> Any:
        clock.steps += nstep
        return rollout(self, nstep, *arguments, **settings)

    monkeypatch.setattr(Batch, "rollout", counted)
    model = mujoco.MjModel.from_xml_string(MODEL)
    stepping = StepTimer(lambda count: Run.of(model, mujoco.MjData(model)), TimingBudget(3.0), clock)
    stepping.warm_up()
    stepping.begin(stepping.steps)
    assert (stepping.steps, stepping.block, stepping.repeats) == (steps, block, repeats)
    for _ in range(6):
        stepping.rollout()
    assert stepping.step.samples == pytest.approx([cost] * 6)


@pytest.mark.parametrize(
    ("value", "most", "expected"),
    [(0.3, 10, 1), (1, 10, 1), (4.9, 100, 2), (5, 100, 5), (99, 100, 50), (100, 100, 100), (1e9, 33, 33), (40, 33, 33)],
)
def test_numbers_of_steps_are_round_and_do_not_follow_every_change_of_the_clock(
    value: float, most: int, expected: int
) -> None:
    assert rounded_down(value, most) == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [("a,b", ["a", "b"]), (" 1 , 2 ", ["1", "2"]), ("0,0,1;0,0,2", ["0,0,1", "0,0,2"]), ("a", ["a"])],
)
def test_values_of_a_scan_are_separated_by_commas_or_semicolons(text: str, expected: list[str]) -> None:
    assert scan_values("opt.x", text) == expected


@pytest.mark.parametrize("text", ["", "a,,b", "a,a", ";"])
def test_a_scan_without_values_or_with_one_twice_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--scan opt"):
        scan_values("opt.x", text)


def test_without_a_scan_there_is_one_point() -> None:
    assert list(points({})) == [{}]
    assert [setting.path for setting in settings({"timestep": "1", "opt.cone": "x"})] == ["opt.timestep", "opt.cone"]


@pytest.mark.parametrize(
    ("load", "governor", "said"),
    [
        (0.4, None, []),
        (None, "performance", []),
        (3.0, "powersave", ["load average 3.00 on 4 cores", "governor is powersave"]),
    ],
)
def test_what_spoils_figures_is_told(load: float | None, governor: str | None, said: Sequence[str]) -> None:
    remarks = MachineInfo("Linux", "a CPU", 4, 4, governor, load).remarks
    assert len(remarks) == len(said)
    for remark, part in zip(remarks, said, strict=True):
        assert part in remark


def test_this_machine_is_known() -> None:
    found = machine_info()
    assert found.cpu
    assert 1 <= found.available <= found.cores


@pytest.mark.gl
@pytest.mark.parametrize("view", ["rgb", "depth", "seg"])
@pytest.mark.parametrize("quality", ["model", "high"])
def test_a_frames_parts_make_up_its_time_and_the_clock_is_asked_where_they_change(
    path: Path, backend: Backend, view: str, quality: str
) -> None:
    drawing = Drawing(size=(64, 48), view=view, visual=Visual(quality=quality))
    (found,) = bench(path, drawings=[drawing], repeats=1).run(clock=FakeClock()).frames
    assert (found.view, found.size, found.quality, found.device) == (view, (64, 48), quality, backend.renderer)
    assert found.read is not None
    # Each look at the clock is a second: the state and the scene are two spells of updating, and so on.
    assert found.update.median == 2
    assert found.draw.median == {"rgb": 1, "depth": 3, "seg": 3}[view]
    assert found.read.median == {"rgb": 3, "depth": 5, "seg": 5}[view]
    parts = (found.update, found.draw, found.read, found.compose)
    assert found.total.samples == [sum(spans) for spans in zip(*(part.samples for part in parts), strict=True)]
    # A film of each of the 7 pictures four times, between two looks at the clock.
    assert found.encode.samples == [1 / 28] * 3


@pytest.mark.gl
def test_filament_does_not_tell_drawing_from_reading(path: Path, vulkan: Backend) -> None:
    drawing = Drawing(size=(64, 48), renderer="filament")
    (found,) = bench(path, drawings=[drawing], repeats=1).run(clock=FakeClock()).frames
    assert (found.renderer, found.device, found.read) == ("filament", vulkan.renderer, None)
    # One look at the clock lies between any two parts: composing comes before, between and after the others.
    assert (found.update.median, found.draw.median, found.compose.median, found.total.median) == (1, 1, 3, 5)


@pytest.mark.gl
def test_a_timed_picture_is_the_picture(path: Path, backend: Backend) -> None:
    model = mujoco.MjModel.from_xml_path(str(path))
    state = Run.of(model, mujoco.MjData(model)).start
    pose = CameraMotion(script("free", model), model, (64, 48)).pose(state)
    arguments = (model, (64, 48), backend, Visual(), Segmentation(model))
    seen: list[dict[str, np.ndarray]] = []
    for make in (ClassicRenderer, partial(TimedClassicRenderer, watch=Stopwatch(FakeClock()))):
        with make(*arguments) as renderer:
            renderer.look(state)
            picture = renderer.picture(pose, ("rgb", "depth", "seg"))
            seen.append({name: np.array(getattr(picture, name)) for name in ("rgb", "depth", "ids")})
    for name, expected in seen[0].items():
        np.testing.assert_array_equal(seen[1][name], expected)


@pytest.mark.gl
def test_a_whole_film_and_trace_are_a_second_of_simulation(path: Path) -> None:
    trace, film = bench(path, whole=True, drawings=[Drawing(size=(64, 48))]).run(clock=FakeClock()).whole
    assert (trace.what, trace.count, trace.unit, trace.simulated, trace.seconds) == ("trace", 101, "rows", 1.0, 1.0)
    assert (film.what, film.count, film.unit, film.simulated, film.seconds) == ("video", 30, "frames", 1.0, 1.0)
    assert film.simulation is not None


@pytest.mark.filterwarnings("ignore::mjrun.errors.MjrunWarning")
def test_real_models_are_timed(shared_models: Path) -> None:
    for name in ("humanoid/humanoid.xml", "sleep/dominos.xml", "plugin/sdf/torus.xml", "flex/flag.xml"):
        found = Bench(shared_models / name, steps=5, repeats=2, threads=(1, 2)).run(clock=FakeClock())
        assert found.rows[0].step is not None
        assert found.rows[0].threads[-1].threads == 2
