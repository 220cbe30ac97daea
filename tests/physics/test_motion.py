"""States of a motion against a bare loop and scipy, and replayed."""

import tracemalloc
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from mjrun.model import state
from mjrun.physics.motion import Motion
from mjrun.physics.motion_samples import Interpolation, MotionSamples
from mjrun.physics.replay import ReplayStepper
from tests.physics.tumbler import model, tumble

TENTH = slice(0, 501, 10)
FIELDS = state.fields(state.sizes(model()))


def motion(samples: MotionSamples, interpolation: Interpolation | None = None) -> Motion:
    return Motion(model(), mujoco.MjData(model()), samples, interpolation)


def test_at_its_samples_a_state_is_the_sample_to_the_last_bit() -> None:
    run = tumble()
    found = motion(run.sampled(TENTH))
    assert found.steps == range(501)
    assert found.size == state.size(model())
    for step in range(0, 501, 10):
        numbers = found.state(step)
        for name in ("qpos", "qvel", "act", "ctrl", "mocap_pos", "mocap_quat"):
            assert numbers[FIELDS[name]].tobytes() == getattr(run, name)[step].tobytes(), (step, name)
        assert numbers[0] == step / 500


def test_between_samples_positions_go_straight_and_rotations_along_the_arc() -> None:
    run = tumble()
    found = motion(run.sampled(TENTH))
    steps = [3, 17, 255, 499]
    for step in steps:
        row = step // 10
        ends, share = [10 * row, 10 * row + 10], step % 10 / 10
        numbers = found.state(step)
        qpos = numbers[FIELDS["qpos"]]
        for index in (0, 1, 2, 7, 12):
            assert qpos[index] == pytest.approx(np.interp(share, [0, 1], run.qpos[ends, index]), abs=1e-14)
        parts = [(qpos[3:7], run.qpos[ends, 3:7]), (qpos[8:12], run.qpos[ends, 8:12])]
        parts.append((numbers[FIELDS["mocap_quat"]], run.mocap_quat[ends]))
        for quaternion, between in parts:
            arc = Slerp([0, 1], Rotation.from_quat(between, scalar_first=True))(share)
            assert np.allclose(
                Rotation.from_quat(quaternion, scalar_first=True).as_matrix(), arc.as_matrix(), atol=1e-12
            )
        line = run.qvel[ends[0]] + share * (run.qvel[ends[1]] - run.qvel[ends[0]])
        assert np.allclose(numbers[FIELDS["qvel"]], line)
        assert (numbers[FIELDS["ctrl"]] == run.ctrl[ends[0]]).all()
        assert np.allclose(numbers[FIELDS["act"]], (1 - share) * run.act[ends[0]] + share * run.act[ends[1]])
    assert abs(found.state(255)[FIELDS["qpos"]] - run.qpos[255]).max() < 3e-3


def test_it_can_hold_and_controls_can_go_on_in_a_straight_line() -> None:
    run = tumble()
    held = motion(run.sampled(TENTH), Interpolation(hold=True, hold_controls=False)).state(37)
    for name in ("qpos", "qvel", "act", "mocap_pos", "mocap_quat"):
        assert held[FIELDS[name]].tobytes() == getattr(run, name)[30].tobytes()
    assert np.allclose(held[FIELDS["ctrl"]], 0.3 * run.ctrl[30] + 0.7 * run.ctrl[40])


def test_samples_need_not_fall_on_steps_nor_be_even() -> None:
    run, rng = tumble(), np.random.default_rng(3)
    time = np.sort(np.r_[0, rng.uniform(0, 0.9999, 60)])
    qpos = {i: np.interp(time, run.time, run.qpos[:, i]) for i in (0, 1, 2, 7, 12)}
    found = motion(MotionSamples("t.csv", time, run.sampled(TENTH).columns, {"qpos": qpos}))
    assert found.steps[-1] == int(time[-1] / 0.002)
    for step in range(0, len(found.steps), 7):
        numbers = found.state(step)[FIELDS["qpos"]]
        for index, values in qpos.items():
            assert numbers[index] == pytest.approx(np.interp(step * 0.002, time, values), abs=1e-12)


def test_times_that_are_sums_of_floats_find_their_steps() -> None:
    run = tumble()
    samples = replace(run.sampled(TENTH), time=np.cumsum(np.r_[1e9, np.full(50, 0.02)]))
    found = motion(samples, Interpolation(hold=True))
    assert found.steps == range(501)
    assert [found.state(step)[1] for step in (10, 490, 500)] == [run.qpos[step, 0] for step in (10, 490, 500)]


def test_before_the_beginning_is_the_first_state_and_after_the_end_the_last() -> None:
    run = tumble()
    found = motion(run.sampled(TENTH))
    assert found.state_at(-3)[FIELDS["qpos"]].tobytes() == run.qpos[0].tobytes()
    assert found.state_at(99)[FIELDS["qpos"]].tobytes() == run.qpos[500].tobytes()
    with pytest.raises(IndexError):
        found.state(501)


def test_a_replay_goes_through_it() -> None:
    run = tumble()
    replay = ReplayStepper(model(), motion(run.sampled(TENTH)), simulated=False)
    bare = mujoco.MjData(model())
    for step in (0, 10, 250, 500):
        replay.advance(step)
        bare.qpos[:], bare.qvel[:] = run.qpos[step], run.qvel[step]
        mujoco.mj_kinematics(model(), bare)
        assert np.array_equal(replay.instant().xpos[1:5], bare.xpos[1:5])


def test_memory_holds_the_samples_whatever_the_number_of_steps() -> None:
    samples = replace(tumble().sampled(slice(0, 3)), time=np.array([0.0, 1e5, 2e5]))
    tracemalloc.start()
    found = motion(samples)
    assert len(found.steps) == 100_000_001
    for step in (0, 50_000_000, 100_000_000):
        found.state(step)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2**20
