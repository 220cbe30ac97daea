"""What episodes come to, by policies and points, against numpy and scipy."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import scipy.stats

from mjrun.evaluation.prepared import PreparedEvaluation
from mjrun.evaluation.statistics import paired_share_interval
from mjrun.evaluation.summaries import compared, summaries, summary_of
from mjrun.experiment.design import Design
from tests.evaluation.episodes import episodes, played, totals

POINTS = Design(("mass",), [("1",), ("2",)])


def prepared(points: Design, *, can_succeed: bool = True) -> PreparedEvaluation:
    player = SimpleNamespace(rewards=[], endings=[], can_succeed=can_succeed)
    fake = SimpleNamespace(
        player=player,
        metrics=[],
        points=points,
        values=lambda point: dict(zip(points.names, points.points[point], strict=True)),
    )
    return cast("PreparedEvaluation", fake)


def test_a_policy_is_summed_up_over_all_points_and_at_each() -> None:
    groups = [played(1, -2, 3), played(5, 6, 7, point=1)]
    found = summaries(prepared(POINTS), [groups], 0.95)
    assert found.policies[0].returns.mean == pytest.approx(np.mean(totals(groups)))
    assert [point.policies[0].returns.mean for point in found.points] == pytest.approx([2 / 3, 6])
    assert [point.values for point in found.points] == [{"mass": "1"}, {"mass": "2"}]
    assert found.comparison is None


def test_a_success_makes_a_rate_even_if_nobody_said_that_there_may_be_one() -> None:
    one = [played(1, 2)]
    assert summaries(prepared(Design((), [()]), can_succeed=False), [one], 0.95).policies[0].success
    none = [played(-1, -2)]
    assert summaries(prepared(Design((), [()]), can_succeed=False), [none], 0.95).policies[0].success is None


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


def test_the_difference_of_returns_has_the_interval_of_the_paired_t_test() -> None:
    generator = np.random.default_rng(3)
    theirs = generator.normal(0, 5, 40)
    ours = theirs + generator.normal(0.6, 1, 40)
    found = compared([played(*ours, policy="a")], [played(*theirs, policy="b")], 0.9, can_succeed=True)
    test = scipy.stats.ttest_rel(ours, theirs)
    interval = test.confidence_interval(0.9)
    assert found.returns.difference == pytest.approx(np.mean(ours - theirs))
    assert (found.returns.interval.low, found.returns.interval.high) == pytest.approx((interval.low, interval.high))
    assert found.returns.better == "a"
    assert test.pvalue < 0.1
    assert found.returns.first_wins == np.sum(ours > theirs)
    assert found.returns.second_wins == np.sum(ours < theirs)


def test_the_difference_of_successes_is_that_of_paired_shares() -> None:
    ours, theirs = [1, 1, 1, 1, -1, 1], [1, -1, -1, 1, -1, -1]
    found = compared([played(*ours, policy="a")], [played(*theirs, policy="b")], 0.95, can_succeed=True).success
    assert found
    assert found.difference == pytest.approx(3 / 6)
    assert (found.first_wins, found.second_wins, found.ties) == (3, 0, 3)
    assert found.interval == paired_share_interval(np.array(ours) > 0, np.array(theirs) > 0)


def test_points_are_paired_with_their_own() -> None:
    ours = [played(1, 2, policy="a"), played(5, 6, policy="a", point=1)]
    theirs = [played(0, 1, policy="b"), played(4, 5, policy="b", point=1)]
    found = compared(ours, theirs, 0.95, can_succeed=False)
    assert found.success is None
    assert found.pairs == 4
    assert found.returns.difference == 1


def test_the_same_episodes_cannot_be_told_apart() -> None:
    one = played(1, 2, -3, policy="a")
    found = compared([one], [one], 0.95, can_succeed=True)
    assert found.returns.better is None
    assert found.success
    assert found.success.better is None
    assert found.returns.ties == 3


def test_a_policy_that_is_worse_is_told_as_the_other_being_better() -> None:
    found = compared([played(1, 2, 3, policy="a")], [played(5, 6.1, 7, policy="b")], 0.95, can_succeed=False)
    assert found.returns.better == "b"


def test_pairs_of_one_seed_at_several_points_are_no_independent_ones() -> None:
    ours, theirs = np.random.default_rng(2).normal(0.3, 1, (2, 9, 40))  # points, seeds
    common = np.random.default_rng(3).normal(0, 2, 40)
    first = [played(*row, policy="a", point=point) for point, row in enumerate(ours + common)]
    second = [played(*row, policy="b", point=point) for point, row in enumerate(theirs - common)]
    found = compared(first, second, 0.9, can_succeed=True)
    means = (ours + common - theirs + common).mean(axis=0)  # of each seed
    interval = scipy.stats.ttest_1samp(means, 0).confidence_interval(0.9)
    assert found.pairs == 360
    assert (found.returns.interval.low, found.returns.interval.high) == pytest.approx((interval.low, interval.high))

    lone = compared(first[:1], second[:1], 0.9, can_succeed=True)
    same = compared(first[:1] * 5, second[:1] * 5, 0.9, can_succeed=True)
    assert same.success
    assert lone.success
    for several, one in ((same.returns, lone.returns), (same.success, lone.success)):
        assert (several.interval.low, several.interval.high) == pytest.approx((one.interval.low, one.interval.high))
