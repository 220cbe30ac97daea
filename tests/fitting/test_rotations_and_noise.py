"""Rotations against MuJoCo and scipy, and estimates of known noise."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mjrun.errors import UsageError
from mjrun.fitting.measurements import align, first_noise, normalize, resolution, rotations, shared, spread_of
from tests.fitting.logs import NOISE
from tests.fitting.problems import segments

NAMES = ["qpos/torso/qw", "qpos/torso/qx", "qpos/torso/qy", "qpos/torso/qz"]


def quaternions(count: int = 30, seed: int = 0) -> np.ndarray:
    """A smooth tumble, `(count, 4)`, real part first."""
    turns = np.cumsum(np.random.default_rng(seed).normal(0, 0.1, (count, 3)) + 0.2, axis=0)
    return Rotation.from_rotvec(turns).as_quat(scalar_first=True)


def test_rotations_are_found_in_any_order_and_only_as_a_whole() -> None:
    mixed = ["qpos/torso/qz", "qpos/knee", *NAMES[:3]]
    assert rotations(mixed, [*NAMES, "qpos/knee"]) == [[2, 3, 4, 0]]
    assert rotations(["qpos/qw"], ["qpos/qw"]) == []  # a hinge of this name
    with pytest.raises(UsageError, match="qpos/torso/qz of the rotation qpos/torso must be measured too"):
        rotations(NAMES[:3], NAMES)


def test_signs_and_lengths_do_not_count() -> None:
    true = quaternions()
    generator = np.random.default_rng(1)
    logged = true * generator.choice([-1, 1], len(true))[:, None] * generator.uniform(0.9, 1.1, len(true))[:, None]
    logged[7, 2] = np.nan
    normalize(logged, [[0, 1, 2, 3]], "log.csv")
    assert np.isnan(logged[7]).all()
    known = np.arange(len(true)) != 7
    np.testing.assert_allclose(np.abs(np.sum(logged[known] * true[known], axis=1)), 1, rtol=1e-12)
    rows = logged[known]
    assert (np.sum(rows[1:] * rows[:-1], axis=1) > 0).all()
    with pytest.raises(UsageError, match=r"log\.csv, row 0: a quaternion of length 0 is not a rotation"):
        normalize(np.zeros((2, 4)), [[0, 1, 2, 3]], "log.csv")


def test_what_is_left_is_a_chord_of_the_angle_between_them() -> None:
    """2·sin(θ/4), where MuJoCo itself says what θ is."""
    measured, predicted = quaternions(), -1.02 * quaternions(seed=3)
    align(predicted, measured, [[0, 1, 2, 3]])
    turn = np.empty(3)
    for one, other in zip(predicted, measured, strict=True):
        mujoco.mju_subQuat(turn, one, other)
        angle = min(np.linalg.norm(turn), 2 * np.pi - np.linalg.norm(turn))
        assert np.linalg.norm(one - other) == pytest.approx(2 * np.sin(angle / 4), rel=1e-9)


def test_the_numbers_of_a_rotation_share_their_noise() -> None:
    assert shared(np.array([5.0, 1.0, 1.0, 1.0, 7.0]), [[1, 2, 3, 4]]).tolist() == [5, *[np.sqrt(13)] * 4]


def test_noise_shows_in_third_differences() -> None:
    assert first_noise([each.values for each in segments()])[0] == pytest.approx(NOISE, rel=0.2)


def test_the_spread_under_a_robust_loss_is_that_of_the_middle_half() -> None:
    values = np.random.default_rng(1).normal(3, 2, (4000, 1))
    values[::10] = 100
    assert spread_of(values, "huber")[0] == pytest.approx(2, rel=0.25)
    assert spread_of(values)[0] == pytest.approx(np.std(values))


def test_rounding_is_noise_even_where_a_signal_rests() -> None:
    """A signal with three decimals that rests most of the time; one without digits has no resolution."""
    moving = np.sin(np.linspace(0, 1, 40))
    smooth = np.concatenate([moving, np.full(100, moving[-1])])
    values = np.column_stack([np.round(smooth, 3), np.radians(np.round(smooth, 2)), smooth]).astype(np.float64)
    assert resolution(values) == pytest.approx([1e-3, np.radians(1e-2), 0], rel=1e-6, abs=2e-7)
    assert first_noise([values])[0] == pytest.approx(1e-3 / np.sqrt(12))
