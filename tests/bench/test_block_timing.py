"""Rollouts against a bare loop, and the phases of a step."""

import time
from collections.abc import Iterator

import mujoco
import numpy as np
import pytest

from mjrun.bench.bench import noisy_controls
from mjrun.bench.block_timing import (
    MJCF,
    SHARE,
    STEPS,
    BatchRolloutTimer,
    PythonLoopRolloutTimer,
    ReferenceWorkloadTimer,
    RolloutInputs,
    RolloutTimer,
    WarnedRolloutError,
    phases,
    profile,
)
from mjrun.errors import UnstableError
from tests.bench.bench_clocks import BlockClock, FakeClock

MODEL = """
<mujoco>
  <option integrator="{integrator}"><flag sleep="{sleep}"/></option>
  <worldbody>
    <geom type="plane" size="5 5 1"/>
    <body pos="0 0 .09"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
    <body pos="1 0 1"><joint name="h" axis="0 1 0"/><geom size=".05" pos=".3 0 0"/></body>
  </worldbody>
  <actuator><motor name="m" joint="h"/></actuator>
</mujoco>
"""
# A pyramid of contacts that the arena has no room for.
CROWDED = """
<mujoco>
  <size memory="12K"/>
  <worldbody>
    <geom type="plane" size="5 5 1"/>
    <replicate count="6" offset=".15 0 0"><body pos="0 0 .04"><freejoint/><geom size=".05"/></body></replicate>
  </worldbody>
</mujoco>
"""


def run_of(noise: bool = True, integrator: str = "Euler", sleep: str = "disable") -> RolloutInputs:
    model = mujoco.MjModel.from_xml_string(MODEL.format(integrator=integrator, sleep=sleep))
    return RolloutInputs.of(model, mujoco.MjData(model), noisy_controls(model, 400, 0.5) if noise else None)


def bare(run: RolloutInputs, steps: int) -> mujoco.MjData:
    data = run.data()
    for step in range(steps):
        if run.controls is not None:
            data.ctrl[:] = run.controls[step]
        mujoco.mj_step(run.model, data)
    return data


@pytest.mark.parametrize("kind", [BatchRolloutTimer, PythonLoopRolloutTimer])
def test_every_block_is_timed_by_two_looks_at_the_clock_and_the_last_is_shorter(kind: type[RolloutTimer]) -> None:
    clock = BlockClock(1.0, 2.0, 4.0)
    assert kind(run_of()).seconds(250, 100, clock).tolist() == [1.0, 2.0, 4.0]  # type: ignore[call-arg]
    assert clock.readings == 6


@pytest.mark.parametrize("sleep", ["disable", "enable"])
@pytest.mark.parametrize("noise", [True, False])
@pytest.mark.parametrize("copies", [1, 2])
def test_every_rollout_of_every_copy_is_bit_for_bit_the_motion_of_a_bare_loop(
    copies: int, noise: bool, sleep: str
) -> None:
    run = run_of(noise, sleep=sleep)
    roller = BatchRolloutTimer(run, copies)
    expected = bare(run, 250)
    for _ in range(2):
        roller.seconds(250, 100, lambda: 0.0)
        for state in roller._batch.bind("qpos"):
            assert state.tolist() == expected.qpos.tolist()


@pytest.mark.parametrize("noise", [True, False])
def test_the_loop_in_python_makes_the_same_motion_each_time(noise: bool) -> None:
    run = run_of(noise)
    roller, expected = PythonLoopRolloutTimer(run), bare(run, 250)
    for _ in range(2):
        roller.seconds(250, 100, lambda: 0.0)
        assert roller._data.qpos.tolist() == expected.qpos.tolist()


def test_states_on_the_way_are_those_of_a_bare_loop() -> None:
    run = run_of()
    data = run.data()
    for step, result in zip((0, 70), run.states([0, 70]), strict=True):
        mujoco.mj_setState(run.model, data, result, int(mujoco.mjtState.mjSTATE_INTEGRATION))
        assert data.qpos.tolist() == bare(run, step).qpos.tolist()


def test_counts_are_the_means_of_a_bare_loop() -> None:
    run, data, seen = run_of(), run_of().data(), []
    assert run.controls is not None
    for row in run.controls[:120]:
        data.ctrl[:] = row
        mujoco.mj_step(run.model, data)
        islands = min(max(data.nisland, 1), mujoco.mjNISLAND)
        seen.append((data.ncon, data.nefc, sum(data.solver_niter[:islands]) / islands))
    result = profile(run, 120)
    assert (result.contacts, result.constraints, result.iterations) == pytest.approx(np.mean(seen, axis=0))
    assert result.contacts > 1
    assert (result.arena, result.arena_size) == (data.maxuse_arena, data.narena)
    assert not result.warned


def test_an_unstable_run_names_its_step_and_joint() -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><option timestep='.1'/><worldbody><body><joint name='hinge' stiffness='1e6'/>"
        "<geom size='.1' pos='.1 0 0'/></body></worldbody><actuator><motor joint='hinge'/></actuator></mujoco>"
    )
    data = mujoco.MjData(model)
    data.qpos[0] = 1
    for noise in (None, noisy_controls(model, 500)):
        run = RolloutInputs.of(model, data, noise)
        with pytest.raises(UnstableError, match="joint 'hinge'") as caught:
            profile(run, 500)
        assert 0 < caught.value.step < 500


@pytest.mark.filterwarnings("ignore")
def test_a_batch_says_that_mujocos_warnings_stopped_it_and_a_loop_continues() -> None:
    model = mujoco.MjModel.from_xml_string(CROWDED)
    run = RolloutInputs.of(model, mujoco.MjData(model))
    assert profile(run, 20).warned
    with pytest.raises(WarnedRolloutError):
        BatchRolloutTimer(run).seconds(20, 5, lambda: 0.0)
    roller = PythonLoopRolloutTimer(run)
    roller.seconds(20, 5, lambda: 0.0)
    assert roller._data.time == pytest.approx(20 * model.opt.timestep)


@pytest.fixture
def ticking() -> Iterator[None]:
    """Installs a clock for MuJoCo's timers that advances by one at every reading."""
    count = iter(range(10**9))
    mujoco.set_mjcb_time(lambda: float(next(count)))
    yield
    mujoco.set_mjcb_time(None)


@pytest.mark.usefixtures("ticking")
@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicitfast"])
def test_phases_are_mujocos_timers_per_step_and_the_parts_make_up_the_whole(integrator: str) -> None:
    run = run_of(integrator=integrator)
    data = bare(run, 25)
    result, timer = phases(data), {name: data.timer[int(i)] for name, i in mujoco.mjtTimer.__members__.items()
                                  if name != "mjNTIMER"}  # fmt: skip
    assert result is not None
    assert result.seconds == timer["mjTIMER_STEP"].duration / 25
    tops = {part.name: part for part in result.parts}
    assert list(tops) == ["position", "velocity", "actuation", "constraint", "advance", "other"]
    for name in ("position", "velocity", "actuation", "constraint", "advance"):
        assert tops[name].seconds == timer[f"mjTIMER_{name.upper()}"].duration / 25
    for whole in (result, tops["position"]):
        assert sum(part.seconds for part in whole.parts) == pytest.approx(whole.seconds)
        assert sum(part.share for part in whole.parts) == pytest.approx(whole.share)
    position = {part.name: part for part in tops["position"].parts}
    assert list(position) == ["kinematics", "inertia", "collision", "make", "project", "other"]
    assert [part.name for part in position["collision"].parts] == ["broad", "narrow", "other"]
    assert position["collision"].seconds == timer["mjTIMER_POS_COLLISION"].duration / 25


def test_without_a_step_there_are_no_phases() -> None:
    assert phases(run_of().data()) is None


def test_the_model_stays_stable_in_contact_and_makes_mujoco_warn_of_nothing() -> None:
    model = mujoco.MjModel.from_xml_string(MJCF)
    data = mujoco.MjData(model)
    contacts = []
    for _ in range(STEPS):
        mujoco.mj_step(model, data)
        contacts.append(data.ncon)
    assert min(contacts) > 0
    assert all(warning.number == 0 for warning in data.warning)
    assert np.abs(data.qvel).max() < 10


@pytest.mark.parametrize("copies", [1, 2])
def test_every_repetition_is_the_same_motion(copies: int) -> None:
    workload = ReferenceWorkloadTimer(time.perf_counter, copies)
    model = mujoco.MjModel.from_xml_string(MJCF)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=STEPS)
    for _ in range(2):
        workload.time()
        batch = workload._roller._batch
        for copy in range(copies):
            state = batch.state[copy]
            end = mujoco.MjData(model)
            mujoco.mj_setState(model, end, state, mujoco.mjtState.mjSTATE_INTEGRATION)
            assert end.qpos.tolist() == data.qpos.tolist()


@pytest.mark.parametrize("copies", [1, 3])
@pytest.mark.parametrize(("seconds", "repetitions"), [(0.0, 1), (40.0, 10), (42.0, 10), (1e9, 10_000)])
def test_a_sample_takes_a_share_of_what_it_is_timed_with_and_is_a_wall_time_per_step(
    copies: int, seconds: float, repetitions: int
) -> None:
    clock = FakeClock()
    workload = ReferenceWorkloadTimer(clock, copies)
    workload.fit(seconds)
    if repetitions > 10:
        assert workload._repetitions == repetitions
        return
    before = clock.now
    workload.time()
    # A repetition is timed by two looks at the clock, a second apart.
    assert clock.now - before == 2 * repetitions
    assert workload.samples == [pytest.approx(1 / (STEPS * copies))]
    assert workload.step.median == workload.samples[0]
    assert repetitions == max(1, round(SHARE * seconds))
