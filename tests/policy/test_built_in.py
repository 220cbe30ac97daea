"""Random actions and zeros."""

import numpy as np
from scipy import stats

from mjrun.policy.built_in import RandomPolicy, ZeroPolicy
from mjrun.policy.policy import ActionSpace

CLIPPED = ActionSpace(["a", "b", "c"], np.array([-2.0, -np.inf, 3.0]), np.array([5.0, np.inf, np.inf]))


def drawn(seed: int, count: int = 500) -> np.ndarray:
    actor = RandomPolicy().episode(seed, CLIPPED)
    return np.array([actor.act(np.zeros(1)) for _ in range(count)])


def test_random_actions_are_uniform_within_the_clip_or_one() -> None:
    actions = drawn(7)
    for column, (low, high) in zip(actions.T, [(-2, 5), (-1, 1), (3, 5)], strict=True):
        assert stats.kstest(column, stats.uniform(low, high - low).cdf).pvalue > 1e-3


def test_they_depend_on_the_seed_alone() -> None:
    assert np.array_equal(drawn(7), drawn(7))
    assert not np.array_equal(drawn(7), drawn(8))
    # and not on numbers that a task draws from the same seed
    assert not np.isin(drawn(7), np.random.default_rng(7).uniform(CLIPPED.low[0], CLIPPED.high[0], 500)).any()


def test_zeros_are_zeros() -> None:
    assert ZeroPolicy().episode(3, CLIPPED).act(np.ones(9)).tolist() == [0, 0, 0]
