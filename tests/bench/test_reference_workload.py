"""The reference workload: the same stable motion every time, timed per step, with a length to fit."""

import time

import mujoco
import numpy as np
import pytest

from mjrun.bench.reference_workload import MJCF, SHARE, STEPS, ReferenceWorkloadTimer
from tests.bench.bench_clocks import FakeClock


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
