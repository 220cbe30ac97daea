"""What episodes come to, against numpy and scipy."""

import numpy as np
import pytest
import scipy.stats

from mjrun.evaluation.summary import summary_of
from tests.evaluation.episodes import episodes


def test_returns_terms_and_metrics_are_those_of_the_episodes() -> None:
    some = episodes(50, np.random.default_rng(1), metrics=2)
    found = summary_of("p", some, ["near", "cost"], ["m", "n"], 0.95, can_succeed=True)
    returns = [each.total for each in some]
    assert (found.policy, found.episodes) == ("p", 50)
    assert found.returns.mean == pytest.approx(np.mean(returns))
    assert found.returns.median == np.median(returns)
    assert found.rewards["cost"].mean == pytest.approx(np.mean([each.rewards["cost"] for each in some]))
    assert found.metrics["n"].max == max(each.metrics[1] for each in some)
    assert found.lengths.min == min(each.length for each in some)


def test_endings_are_counted_the_most_frequent_first() -> None:
    some = episodes(60, np.random.default_rng(2))
    found = summary_of("p", some, [], [], 0.9, can_succeed=True)
    counts = [ending.share.count for ending in found.endings]
    assert counts == sorted(counts, reverse=True)
    assert sum(counts) == 60
    arrived = next(each for each in found.endings if each.ending == "arrived")
    assert arrived.outcome == "success"
    assert found.success == arrived.share
    expected = scipy.stats.binomtest(arrived.share.count, 60).proportion_ci(0.9, method="wilson")
    assert arrived.share.interval.low == pytest.approx(expected.low)


def test_without_a_termination_that_is_a_success_there_is_no_rate() -> None:
    some = episodes(5, np.random.default_rng(2))
    assert summary_of("p", some, [], [], 0.95, can_succeed=False).success is None
