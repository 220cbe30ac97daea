"""Worlds in MuJoCo Warp against a bare loop of MuJoCo, on Warp's CPU device; and what is said where it cannot."""

import importlib.util
import re
from collections.abc import Iterator

import mujoco
import numpy as np
import pytest

from mjrun.bench.control_noise import controls
from mjrun.errors import MissingExtraError, SimulationError, UnknownNameError, UsageError
from mjrun.sim.rollout_timing import Run
from mjrun.sim.warp_engine import OVERFLOWS, WarpEngine, WarpWorlds, told

# A ball that falls, and stays where it has fallen; and a slider that is pushed.
MODEL = """
<mujoco>
  <option timestep=".01"/>
  <worldbody>
    <geom type="plane" size="5 5 1"/>
    <body pos="0 0 .5"><freejoint/><geom size=".1"/></body>
    <body pos="2 0 5"><joint name="x" type="slide" axis="1 0 0"/><geom size=".1"/></body>
  </worldbody>
  <actuator><motor name="m" joint="x"/></actuator>
</mujoco>
"""
FALLING, FALLEN = 25, 45  # steps; the ball meets the plane in between: it falls 0.4 m in 0.29 s
WORLDS = 2
KNOWN = {"nconmax": 16, "njmax": 64, "contacts": 17, "constraints": 70, "iterations": 100}


class FakeClock:
    """Goes on by what it is told at every second look."""

    def __init__(self, ticks: Iterator[float]) -> None:
        self.now, self.asked, self._ticks = 0.0, 0, ticks

    def __call__(self) -> float:
        self.asked += 1
        if self.asked % 2 == 0:
            self.now += next(self._ticks)
        return self.now


def run_of(noise: bool = True, speed: float = 0.0) -> Run:
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    data.qvel[2] = speed
    return Run.of(model, data, controls(model, FALLEN + WORLDS, 20) if noise else None)


def bare(run: Run, steps: int, ahead: int = 0) -> np.ndarray:
    """Where a bare loop ends that plays the controls `ahead` of their time."""
    data = run.data()
    for step in range(steps):
        if run.controls is not None:
            data.ctrl[:] = run.controls[step + ahead]
        mujoco.mj_step(run.model, data)
    return data.qpos


@pytest.fixture(scope="module")
def engine() -> WarpEngine:
    pytest.importorskip("mujoco_warp")
    return WarpEngine("cpu", WORLDS)


@pytest.fixture(scope="module")
def pushed(engine: WarpEngine) -> tuple[Run, WarpWorlds]:
    """Worlds that have taken their first step: compiling takes most of the time here."""
    run = run_of()
    worlds = engine.open(run)
    assert worlds.first(FakeClock(iter([4.0]))) == 4.0
    return run, worlds


@pytest.mark.parametrize("steps", [FALLEN, FALLING])
def test_every_rollout_of_every_world_moves_as_a_bare_loop_does(pushed: tuple[Run, WarpWorlds], steps: int) -> None:
    run, worlds = pushed
    worlds.seconds(steps, 10, FakeClock(iter([1.0] * 5)))
    found = worlds.positions()
    assert found.shape == (WORLDS, run.model.nq)
    for world in range(WORLDS):
        np.testing.assert_allclose(found[world], bare(run, steps, world), atol=2e-5)
    assert abs(bare(run, steps)[7] - bare(run, steps, 1)[7]) > 1e-3  # the worlds are told apart by that


def test_without_controls_all_worlds_are_alike_and_fall_as_galilei_has_it(engine: WarpEngine) -> None:
    worlds = engine.open(run_of(noise=False))
    worlds.seconds(FALLING, FALLING, FakeClock(iter([1.0])))
    found = worlds.positions()
    np.testing.assert_array_equal(found[0], found[1])
    # Semi-implicit Euler: h g (1 + 2 + … + n) h below where it was.
    fallen = 9.81 * 0.01**2 * FALLING * (FALLING + 1) / 2
    np.testing.assert_allclose(found[0, 2], 0.5 - fallen, atol=1e-6)


def test_every_block_is_timed_by_two_looks_at_the_clock_and_the_last_is_shorter(
    pushed: tuple[Run, WarpWorlds],
) -> None:
    clock = FakeClock(iter([1.0, 2.0, 4.0]))
    assert pushed[1].seconds(5, 2, clock).tolist() == [1.0, 2.0, 4.0]
    assert clock.asked == 6


def test_a_profile_counts_what_a_bare_loop_counts(pushed: tuple[Run, WarpWorlds]) -> None:
    run, worlds = pushed
    data, contacts, constraints = run.data(), 0, 0
    for _ in range(FALLEN):
        mujoco.mj_step(run.model, data)
        contacts, constraints = contacts + data.ncon, constraints + data.nefc
    found = worlds.profile(FALLEN)
    assert contacts > 0
    assert (found.contacts, found.constraints) == (contacts / FALLEN, constraints / FALLEN)
    assert found.iterations > 0
    assert (found.arena, found.phases, found.warned) == (None, None, False)
    assert list(worlds.overflows()) == []


def test_what_does_not_fit_is_told_with_what_to_raise(engine: WarpEngine) -> None:
    narrow = WarpEngine("cpu", WORLDS, njmax=2).open(run_of())
    narrow.profile(FALLEN)
    (said,) = narrow.overflows()
    assert said.startswith("there is room for 2 constraints in a world; ")
    assert said.endswith(": raise --njmax to 4")  # a pyramid of 4 sides


def test_worlds_that_leave_all_bounds_are_unstable(engine: WarpEngine) -> None:
    with pytest.raises(SimulationError, match=r"unstable in 2 of 2 worlds within 2 steps, 0\.02 s"):
        engine.open(run_of(speed=1e12)).profile(2)


def test_a_feature_that_it_does_not_support_is_named(engine: WarpEngine) -> None:
    model = mujoco.MjModel.from_xml_string(MODEL)
    model.opt.solver = mujoco.mjtSolver.mjSOL_PGS
    with pytest.raises(UsageError, match=r"cannot simulate this model: mjSOL_PGS is unsupported\.\n--engine c can"):
        engine.open(Run.of(model, mujoco.MjData(model)))


def test_a_device_that_is_not_there_is_refused_with_those_that_are(engine: WarpEngine) -> None:
    assert (engine.device, engine.worlds) == ("cpu", WORLDS)
    assert engine.version.startswith("mujoco_warp ")
    assert WarpEngine("cpu").worlds == 8
    with pytest.raises(UnknownNameError, match=r"no device 'cuda:99' in Warp.*\ndevices: cpu"):
        WarpEngine("cuda:99")


def test_without_the_library_its_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"--engine warp needs mujoco-warp.*\npip install 'mjrun\[warp\]'"):
        WarpEngine()


def test_every_overflow_that_the_library_knows_has_a_sentence() -> None:
    known = pytest.importorskip("mujoco_warp").OverflowType
    single = {mark.name for mark in known if mark.value and not mark.value & (mark.value - 1)}
    assert single - set(OVERFLOWS) == {"NVMAX"}  # whose limit is that of the model here


@pytest.mark.parametrize(
    ("mark", "said"),
    [
        ("NEFC", "^there is room for 64 constraints in a world; .*: raise --njmax to 70$"),
        ("BROADPHASE", "^there is room for 16 contacts in a world; .*: raise --nconmax to 17$"),
        ("CCD", "raise --nconmax above 16"),
        ("ITERATIONS", "limit of 100 iterations: raise --set opt.iterations"),
        ("NEW_ONE", "^mujoco_warp has no room: new_one overflow$"),
    ],
)
def test_an_overflow_says_what_is_missing_and_the_remedy(mark: str, said: str) -> None:
    assert re.search(said, told(mark, KNOWN))


def test_every_sentence_can_be_told() -> None:
    assert not any("{" in told(mark, KNOWN) for mark in OVERFLOWS)
