"""States of a motion against a bare loop and scipy, and replayed."""

import tracemalloc
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from mjrun.errors import UsageError
from mjrun.model import state
from mjrun.model.names import BALL, FREE
from mjrun.physics.kinematic_samples import (
    GaplessSamples,
    Interpolation,
    KinematicMotion,
    KinematicSamples,
    finite_differences,
    hinges,
    quaternions,
    slerp,
)
from mjrun.physics.replay_stepper import ReplayStepper
from tests.physics.tumbler import model, tumble

TENTH = slice(0, 501, 10)
FIELDS = state.fields(state.sizes(model()))


def motion(samples: KinematicSamples, interpolation: Interpolation | None = None) -> KinematicMotion:
    return KinematicMotion(model(), mujoco.MjData(model()), samples, interpolation)


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
    found = motion(KinematicSamples("t.csv", time, run.sampled(TENTH).columns, {"qpos": qpos}))
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


LINEAR, HOLD = Interpolation(), Interpolation(hold=True)
EVERY_TENTH = slice(0, 501, 10)


def completed(samples: KinematicSamples, interpolation: Interpolation = LINEAR) -> GaplessSamples:
    return GaplessSamples(model(), mujoco.MjData(model()), samples, interpolation)


def remarks(found: GaplessSamples) -> list[str]:
    return [*found.other_remarks, *found.position_remarks]


def with_values(samples: KinematicSamples, name: str, changed: dict[int, np.ndarray]) -> KinematicSamples:
    return replace(samples, values={**samples.values, name: {**samples.values[name], **changed}})


def without_rows(samples: KinematicSamples, name: str, rows: slice, indices: range) -> KinematicSamples:
    changed = {index: samples.values[name][index].copy() for index in indices}
    for values in changed.values():
        values[rows] = np.nan
    return with_values(samples, name, changed)


def scipy_rotation(quaternion: np.ndarray) -> Rotation:
    return Rotation.from_quat(quaternion, scalar_first=True)


def test_whole_samples_stay_as_they_are_to_the_last_bit() -> None:
    run = tumble()
    found = completed(run.sampled(EVERY_TENTH))
    for name in ("qpos", "qvel", "act", "ctrl", "mocap_pos", "mocap_quat"):
        assert found.fields[name].tobytes() == np.ascontiguousarray(getattr(run, name)[EVERY_TENTH]).tobytes(), name
    assert remarks(found) == []


def test_where_quaternions_and_hinges_are() -> None:
    assert quaternions(model(), "qpos") == [3, 8]
    assert quaternions(model(), "mocap_quat") == [0]
    assert quaternions(model(), "ctrl") == []
    assert hinges(model()) == {7}
    assert {FREE, BALL} <= set(model().jnt_type.tolist())


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.999])
def test_slerp_is_that_of_scipy(share: float) -> None:
    for seed in range(40):
        first, last = Rotation.random(2, rng=np.random.default_rng(seed))
        expected = Slerp([0, 1], Rotation.concatenate([first, last]))(share)
        ends = [rotation.as_quat(scalar_first=True) * sign for rotation, sign in ((first, 1), (last, (-1) ** seed))]
        found = scipy_rotation(slerp(ends[0], ends[1], share))
        assert (found.inv() * expected).magnitude() < 1e-7  # arccos loses half of the digits
        assert np.allclose(found.as_matrix(), expected.as_matrix(), atol=1e-12)


def test_gaps_in_numbers_are_bridged_in_a_straight_line_and_in_quaternions_along_the_arc() -> None:
    run, gap = tumble(), slice(20, 29)
    samples = without_rows(run.sampled(EVERY_TENTH, "qpos"), "qpos", gap, range(13))
    found = completed(samples)
    ends, times = [19, 29], found.time[gap]
    truth = run.qpos[EVERY_TENTH]
    for index in (0, 1, 2, 7, 12):
        assert np.allclose(found.fields["qpos"][gap, index], np.interp(times, found.time[ends], truth[ends, index]))
    for start in (3, 8):
        part = slice(start, start + 4)
        arc = Slerp(found.time[ends], scipy_rotation(truth[ends, part]))(times)
        assert np.allclose(scipy_rotation(found.fields["qpos"][gap, part]).as_matrix(), arc.as_matrix(), atol=1e-12)
    outside = np.r_[0:20, 29:51]
    assert found.fields["qpos"][outside].tobytes() == truth[outside].tobytes()
    assert remarks(found)[-1] == "t.csv: a gap in qpos/root of 0.2 s from 0.38 s on; interpolated"


def test_gaps_can_be_held() -> None:
    run, gap = tumble(), slice(20, 29)
    samples = without_rows(run.sampled(EVERY_TENTH, "qpos"), "qpos", gap, range(13))
    found = completed(samples, HOLD)
    assert (found.fields["qpos"][gap] == found.fields["qpos"][19]).all()
    assert remarks(found)[-1].endswith("; held")


def test_what_ends_before_the_table_does_is_held_and_told() -> None:
    samples = without_rows(tumble().sampled(EVERY_TENTH, "qpos", "qvel"), "qpos", slice(40, None), range(7, 8))
    found = completed(samples)
    assert (found.fields["qpos"][40:, 7] == found.fields["qpos"][39, 7]).all()
    assert "t.csv: qpos/hip end up to 0.22 s before the table does; held" in remarks(found)


def test_controls_hold_over_gaps_unless_they_shall_not() -> None:
    samples = without_rows(tumble().sampled(EVERY_TENTH), "ctrl", slice(5, 8), range(2))
    truth = tumble().ctrl[EVERY_TENTH]
    assert (completed(samples).fields["ctrl"][4:8] == truth[4]).all()
    line = completed(samples, Interpolation(hold_controls=False)).fields["ctrl"]
    assert np.allclose(line[6], (truth[4] + truth[8]) / 2)


def test_quaternions_of_any_length_and_sign_become_unit_ones_that_do_not_jump() -> None:
    run = tumble()
    truth = run.qpos[EVERY_TENTH]
    rng = np.random.default_rng(1)
    scale = rng.uniform(0.2, 3, 51) * np.where(rng.random(51) < 0.5, -1, 1)
    scale[0] = 2
    changed = {index: truth[:, index] * scale for index in range(3, 7)}
    found = completed(with_values(run.sampled(EVERY_TENTH, "qpos"), "qpos", changed))
    assert np.allclose(found.fields["qpos"], truth, atol=1e-15)
    (told,) = [text for text in remarks(found) if "lengths" in text]
    assert told.startswith("t.csv: quaternions of qpos/root have lengths such as 2.9")


def test_velocities_are_those_of_constant_accelerations() -> None:
    time = np.cumsum(np.r_[0, np.random.default_rng(2).uniform(0.01, 0.05, 30)])
    positions = np.zeros((31, model().nq))
    positions[:, [3, 8]] = 1
    positions[:, 0], positions[:, 7], positions[:, 12] = 3 * time**2 - time, 5 * time**2, 2 - time
    found = finite_differences(model(), time, positions)
    middle = time[1:-1]
    expected = {0: 6 * middle - 1, 6: 10 * middle, 10: np.full(29, -1.0)}
    for index, velocity in expected.items():
        assert np.allclose(found[1:-1, index], velocity)
    assert np.allclose(found[[0, -1], 10], -1)


def test_angular_velocities_are_those_of_scipys_rotation_vectors_in_the_frame_of_the_body() -> None:
    run = tumble()
    time, positions = run.time[EVERY_TENTH], run.qpos[EVERY_TENTH]
    found = finite_differences(model(), time, positions)
    rotations = scipy_rotation(positions[:, 3:7])
    ways = (rotations[:-1].inv() * rotations[1:]).as_rotvec() / np.diff(time)[:, None]
    assert np.allclose(found[1:-1, 3:6], (ways[:-1] + ways[1:]) / 2, atol=1e-9)
    assert np.allclose(found[[0, -1], 3:6], ways[[0, -1]], atol=1e-9)
    assert abs(found[1:-1, :6] - run.qvel[EVERY_TENTH][1:-1, :6]).max() < 0.05


def test_velocities_in_the_table_are_used_and_the_rest_is_derived() -> None:
    run = tumble()
    samples = run.sampled(EVERY_TENTH, "qpos")
    samples = replace(samples, values={**samples.values, "qvel": {6: np.full(51, 7.0)}})
    found = completed(samples)
    assert (found.fields["qvel"][:, 6] == 7).all()
    others = np.delete(np.arange(11), 6)
    derived = finite_differences(model(), found.time, found.fields["qpos"])
    assert (found.fields["qvel"][:, others] == derived[:, others]).all()
    (told,) = [text for text in remarks(found) if "finite differences" in text]
    assert "qvel/root/vx" in told
    assert "qvel/hip" not in told


def test_one_row_has_no_velocity() -> None:
    assert not completed(tumble().sampled(slice(100, 101), "qpos")).fields["qvel"].any()


def test_what_the_table_lacks_is_as_at_the_start_and_told() -> None:
    samples = tumble().sampled(EVERY_TENTH, "qpos")
    samples = replace(samples, time=samples.time + 5, values={"qpos": {7: samples.values["qpos"][7]}})
    start = mujoco.MjData(model())
    mujoco.mj_resetDataKeyframe(model(), start, 0)
    found = GaplessSamples(model(), start, samples, LINEAR)
    assert (np.delete(found.fields["qpos"], 7, axis=1) == np.delete(start.qpos, 7)).all()
    assert set(found.fields) == {"qpos", "qvel"}
    assert [*found.position_remarks, *found.other_remarks] == [
        "t.csv: its time 5 s is time 0 here",
        "t.csv lacks qpos/root/x, qpos/root/y, qpos/root/z, qpos/root/qw, qpos/root/qx, qpos/root/qy, qpos/root/qz, "
        "qpos/neck/qw, qpos/neck/qx, qpos/neck/qy, qpos/neck/qz, qpos/lift: as in the initial state",
        "t.csv lacks mocap: as in the initial state",
    ]
    assert found.note == "t.csv: velocities are finite differences of the positions; act, ctrl as in the initial state"


def test_a_hinge_that_is_wrapped_goes_on_turning_if_asked() -> None:
    samples = tumble().sampled(EVERY_TENTH, "qpos")
    angle = 20 * samples.time
    wrapped = with_values(samples, "qpos", {7: np.angle(np.exp(1j * angle)), 12: 10 * np.sign(np.sin(angle))})
    assert (completed(wrapped).fields["qpos"][:, 7] == wrapped.values["qpos"][7]).all()
    turning = completed(wrapped, Interpolation(unwrap=True)).fields["qpos"]
    assert np.allclose(turning[:, 7], angle)
    assert (turning[:, 12] == wrapped.values["qpos"][12]).all()  # a slide


def test_missing_rows_are_gaps_and_the_longest_is_told() -> None:
    rows = np.setdiff1d(np.arange(0, 501, 10), [*range(100, 150, 10), 300, *range(400, 420, 10)])
    assert remarks(completed(tumble().sampled(rows))) == [
        "t.csv: 3 gaps, the longest of 0.12 s from 0.18 s on; interpolated"
    ]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {7: [np.nan, 1, 1]},
            r"^t\.csv, row 0: qpos/hip is missing \(empty or nan\), but a motion must begin with all",
        ),
        ({7: [np.nan] * 3}, r"^t\.csv has no value of qpos/hip in any row\nleave the column out, or map another$"),
        ({4: [np.nan, 1, 1]}, r"^t\.csv, row 0: qpos/root is missing"),
        ({7: [0, 1, np.inf]}, r"^t\.csv, row 2: qpos/hip is infinite$"),
        ({5: [0, -np.inf, 0]}, r"^t\.csv, row 1: qpos/root is infinite$"),
        ({i: [1, 0, 1] for i in range(3, 7)}, r"^t\.csv, row 1: the quaternion qpos/root is zero"),
    ],
)
def test_samples_that_no_motion_has_are_refused(change: dict[int, list[float]], message: str) -> None:
    changed = {index: np.array(values, float) for index, values in change.items()}
    with pytest.raises(UsageError, match=message):
        completed(with_values(tumble().sampled(slice(0, 3)), "qpos", changed))


def test_a_quaternion_has_four_numbers() -> None:
    samples = tumble().sampled(slice(0, 3), "qpos")
    del samples.values["qpos"][6]  # type: ignore[attr-defined]
    with pytest.raises(
        UsageError, match=r"^t\.csv has qpos/root/qw, .* lacks qpos/root/qz: a quaternion has four numbers"
    ):
        completed(samples)
