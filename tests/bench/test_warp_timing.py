"""Benchmarks of many worlds, with a fake engine and a fake clock; options of only one engine."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from mjrun.bench.bench import Bench, noisy_controls
from mjrun.bench.block_timing import Clock, RolloutInputs, StepProfile, blocks_of
from mjrun.bench.step_timing import WarpRolloutTimer, WarpSettings
from mjrun.cli.commands.bench import csv_table, markdown, text
from mjrun.errors import MjrunWarning, SimulationError, UsageError, spelled
from tests.bench.bench_clocks import BlockClock, FakeClock
from tests.cases import cases, mjcf

MODEL = """
<mujoco>
  <option timestep=".01"/>
  <worldbody><body><joint name="x" type="slide"/><geom size=".1"/></body></worldbody>
  <actuator><motor name="m" joint="x"/></actuator>
</mujoco>
"""
OVERFLOW = "the constraints do not fit: raise njmax"


class FakeWorlds:
    """Reads the clock where worlds do, and does nothing else."""

    sentences: Sequence[str] = ()

    def __init__(self, run: RolloutInputs, copies: int) -> None:
        self.run, self.copies = run, copies

    def first(self, clock: Clock) -> float:
        return -clock() + clock()

    def seconds(self, steps: int, block: int, clock: Clock) -> np.ndarray:
        return np.array([-clock() + clock() for _ in blocks_of(steps, block)])

    def profile(self, steps: int) -> StepProfile:
        if self.run.model.opt.timestep > 1:
            raise SimulationError(steps, 0.0, "the simulation became unstable in 1 of 4 worlds")
        return StepProfile(3.0, 12.0, 2.5, None, None, None, warned=False)

    def overflows(self) -> Sequence[str]:
        return self.sentences


class FakeEngine:
    """A GPU."""

    opened: list[FakeWorlds]

    def __init__(self, device: str | None, worlds: int | None, nconmax: int | None, njmax: int | None) -> None:
        self.device, self.device_name, self.version = device or "cuda:0", "a GPU", "mujoco_warp 4, warp 1"
        self.worlds, self.nconmax, self.njmax = worlds or 4, nconmax, njmax

    def open(self, run: RolloutInputs) -> FakeWorlds:
        self.opened.append(FakeWorlds(run, self.worlds))
        return self.opened[-1]


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr("mjrun.bench.bench.WarpSettings", FakeEngine)
    monkeypatch.setattr(FakeEngine, "opened", [], raising=False)
    path = tmp_path / "model.xml"
    path.write_text(MODEL)
    return path


def bench(model: Path, **changed: Any) -> Bench:
    return Bench(model, **{"engine": "warp", "steps": 20, "repeats": 8, **changed})


def test_a_step_is_that_of_one_world_and_figures_are_exactly_those_of_the_clock(path: Path) -> None:
    result = bench(path, njmax=64).run(clock=FakeClock())
    (row,) = result.rows
    assert row.step is not None
    # A second for every block, which is a step of four worlds.
    assert (row.block, row.steps) == (1, 20)
    assert row.step.samples == [0.25] * 8
    assert (row.step.p5, row.step.p95) == (0.25, 0.25)
    assert (row.steps_per_second, row.realtime_factor, row.first_step) == (4.0, 0.04, 1.0)
    assert row.counts is not None
    assert (row.counts.contacts, row.counts.constraints, row.counts.iterations) == (3.0, 12.0, 2.5)
    assert (row.counts.arena, row.phases, row.threads, row.overflows) == (None, None, [], [])
    facts = result.engine
    assert (facts.name, facts.device, facts.device_name, facts.worlds) == ("warp", "cuda:0", "a GPU", 4)
    assert (facts.version, facts.nconmax, facts.njmax) == ("mujoco_warp 4, warp 1", None, 64)
    assert any("no phases and no arena" in note for note in result.notes)


def test_the_worlds_have_the_stimulus_of_one_and_more_steps_of_it(path: Path) -> None:
    bench(path).run(clock=FakeClock())
    (worlds,) = FakeEngine.opened
    assert worlds.run.controls is not None
    assert worlds.run.controls.tolist() == noisy_controls(mujoco.MjModel.from_xml_path(str(path)), 24).tolist()


def test_with_mujoco_itself_there_is_one_world_and_nothing_is_compiled(path: Path) -> None:
    result = bench(path, engine="c", worlds=1, threads=[1]).run(clock=FakeClock())
    facts = result.engine
    assert (facts.name, facts.version, facts.device, facts.worlds) == ("c", None, "cpu", 1)
    assert facts.device_name == result.machine.cpu
    assert result.rows[0].first_step is None
    assert FakeEngine.opened == []


def test_a_base_of_another_engine_device_or_number_of_worlds_is_refused(path: Path) -> None:
    base = str(path.with_name("base.json"))
    bench(path, save=base).run(clock=FakeClock())
    same = bench(path, compare=base, fail_above=0.1).run(clock=FakeClock()).comparison
    assert same is not None
    assert [(ratio.name, ratio.ratio) for ratio in same.ratios] == [("step", 1.0)]
    assert same.verdict == "not slower"
    for changed, expected in (
        ({"worlds": 8}, "worlds: 4 there, 8 here"),
        ({"device": "cpu"}, "device: cuda:0 there, cpu here"),
        ({"nconmax": 9}, "nconmax: null there, 9 here"),
        ({"engine": "c"}, "engine: warp there, c here"),
    ):
        with pytest.raises(UsageError, match=f"is not a baseline for this benchmark(.|\n)*{expected}"):
            bench(path, compare=base, **changed).run(clock=FakeClock())
    forced = bench(path, compare=base, worlds=8, force=True).run(clock=FakeClock()).comparison
    assert forced is not None
    assert forced.ratios[0].ratio == 0.5


def test_what_does_not_fit_is_a_warning_and_stays_in_the_document(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FakeWorlds, "sentences", (OVERFLOW,))
    with pytest.warns(MjrunWarning) as heard:
        result = bench(path, scan={"timestep": [".01", ".02"]}).run(clock=FakeClock())
    assert [str(warning.message) for warning in heard] == [OVERFLOW]  # once for both points
    assert [row["overflows"] for row in json.loads(json.dumps(asdict(result)))["rows"]] == [[OVERFLOW]] * 2
    assert f"- timestep=.02: {OVERFLOW}" in markdown(result)


def test_worlds_that_are_unstable_are_a_result_of_a_grid(path: Path) -> None:
    good, bad = bench(path, scan={"timestep": [".01", "2"]}).run(clock=FakeClock()).rows
    assert (good.failure, bad.step, bad.first_step) == (None, None, None)
    assert bad.failure == "the simulation became unstable in 1 of 4 worlds"
    with pytest.raises(SimulationError, match="1 of 4 worlds"):
        bench(path, scan={"timestep": ["2"]}).run(clock=FakeClock())


def test_the_report_tells_of_worlds_and_of_compiling_in_80_columns(path: Path) -> None:
    result = bench(path).run(clock=FakeClock())
    lines = text(result).splitlines()
    assert lines[1] == "4 worlds on cuda:0, a GPU; mujoco_warp 4; noise 0.01"
    assert "all worlds 1.000 s for a step of each of them" in lines
    assert "first step 1.000 s; it compiles what is not cached" in lines
    assert not any("arena" in line for line in lines if not line.startswith("note: "))
    assert max(map(len, lines)) <= 80
    header, row = csv_table(result).splitlines()
    known = dict(zip(header.split(","), row.split(","), strict=True))
    names = ("engine", "device", "worlds", "first_step", "steps_per_second", "arena")
    assert [known[name] for name in names] == ["warp", "cuda:0", "4", "1.0", "4.0", ""]
    grid = text(bench(path, scan={"timestep": [".01", ".02"]}).run(clock=FakeClock()))
    assert "a step, of rollouts of 20 steps of 4 worlds" in grid.splitlines()


@cases("changed, expected")
def test_what_an_engine_cannot_do_is_refused_at_once(path: Path, changed: dict[str, Any], expected: str) -> None:
    with pytest.raises(UsageError, match=expected):
        bench(path, **changed)


# --- rollouts of real worlds, on Warp's CPU device ------------------------------------------------------------------

# A ball that falls, and stays where it has fallen; and a slider that is pushed.
BALL = mjcf("ball_and_slide")
FALLING, FALLEN = 25, 45  # steps; the ball meets the plane in between: it falls 0.4 m in 0.29 s
WORLDS = 2


def run_of(speed: float = 0.0) -> RolloutInputs:
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    data.qvel[2] = speed
    return RolloutInputs.of(model, data, noisy_controls(model, FALLEN + WORLDS, 20))


def bare(run: RolloutInputs, steps: int, ahead: int = 0) -> np.ndarray:
    """Returns the end of a bare loop that plays the controls `ahead` of their time."""
    data = run.data()
    for step in range(steps):
        if run.controls is not None:
            data.ctrl[:] = run.controls[step + ahead]
        mujoco.mj_step(run.model, data)
    return data.qpos


@pytest.fixture(scope="module")
def warp() -> WarpSettings:
    pytest.importorskip("mujoco_warp")
    return WarpSettings("cpu", WORLDS)


@pytest.fixture(scope="module")
def pushed(warp: WarpSettings) -> tuple[RolloutInputs, WarpRolloutTimer]:
    """Returns worlds that have taken their first step, since compiling takes most of the time."""
    run = run_of()
    roller = warp.open(run)
    assert roller.first(BlockClock(4.0)) == 4.0
    return run, roller


@pytest.mark.parametrize("steps", [FALLEN, FALLING])
@pytest.mark.slow
@pytest.mark.warp
def test_every_rollout_of_every_world_moves_as_a_bare_loop_does(
    pushed: tuple[RolloutInputs, WarpRolloutTimer], steps: int
) -> None:
    run, worlds = pushed
    worlds.seconds(steps, 10, BlockClock(*[1.0] * 5))
    result = worlds._worlds.read("qpos")
    assert result.shape == (WORLDS, run.model.nq)
    for world in range(WORLDS):
        np.testing.assert_allclose(result[world], bare(run, steps, world), atol=2e-5)
    assert abs(bare(run, steps)[7] - bare(run, steps, 1)[7]) > 1e-3  # the worlds are told apart by that


@pytest.mark.warp
def test_every_block_is_timed_by_two_looks_at_the_clock_and_the_last_is_shorter(
    pushed: tuple[RolloutInputs, WarpRolloutTimer],
) -> None:
    clock = BlockClock(1.0, 2.0, 4.0)
    assert pushed[1].seconds(5, 2, clock).tolist() == [1.0, 2.0, 4.0]
    assert clock.readings == 6


@pytest.mark.warp
def test_a_profile_counts_what_a_bare_loop_counts(pushed: tuple[RolloutInputs, WarpRolloutTimer]) -> None:
    run, worlds = pushed
    data, contacts, constraints = run.data(), 0, 0
    for _ in range(FALLEN):
        mujoco.mj_step(run.model, data)
        contacts, constraints = contacts + data.ncon, constraints + data.nefc
    result = worlds.profile(FALLEN)
    assert contacts > 0
    assert (result.contacts, result.constraints) == (contacts / FALLEN, constraints / FALLEN)
    assert result.iterations > 0
    assert (result.arena, result.phases, result.warned) == (None, None, False)
    assert list(worlds.overflows()) == []


@pytest.mark.warp
def test_what_does_not_fit_is_reported_with_what_was_needed(warp: WarpSettings) -> None:
    narrow = WarpSettings("cpu", WORLDS, njmax=2).open(run_of())
    narrow.profile(FALLEN)
    (message,) = narrow.overflows()
    assert spelled(message).endswith(": raise njmax to 4")  # a pyramid of 4 sides


@pytest.mark.warp
def test_worlds_that_leave_all_bounds_are_unstable(warp: WarpSettings) -> None:
    with pytest.raises(SimulationError, match=r"unstable in 2 of 2 worlds within 2 steps, 0\.02 s"):
        warp.open(run_of(speed=1e12)).profile(2)


@pytest.mark.warp
def test_on_a_cpu_there_are_eight_worlds_if_nobody_says_how_many(warp: WarpSettings) -> None:
    assert (warp.device, warp.worlds, WarpSettings("cpu").worlds) == ("cpu", WORLDS, 8)
