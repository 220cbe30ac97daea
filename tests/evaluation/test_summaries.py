"""Summaries of episodes by policy and point, against numpy and scipy."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import scipy

from mjrun.evaluation.episode import EpisodePlayer
from mjrun.evaluation.summaries import compared, doubts, summaries, summary_of
from mjrun.experiment.design import Design
from mjrun.experiment.statistics import iqm_difference_interval, paired_share_interval
from tests.evaluation.episodes import episodes, played, totals

POINTS = Design(("mass",), [("1",), ("2",)])


def player(*, can_succeed: bool = True) -> EpisodePlayer:
    return cast("EpisodePlayer", SimpleNamespace(rewards=[], endings=[], can_succeed=can_succeed))


def test_a_policy_is_summed_up_over_all_points_and_at_each() -> None:
    groups = [played(1, -2, 3), played(5, 6, 7, point=1)]
    result = summaries(POINTS, player(), [], [groups], 0.95)
    assert result.policies[0].returns.mean == pytest.approx(np.mean(totals(groups)))
    assert [point.policies[0].returns.mean for point in result.points] == pytest.approx([2 / 3, 6])
    assert [point.values for point in result.points] == [{"mass": "1"}, {"mass": "2"}]
    assert result.comparison is None


def test_a_success_makes_a_rate_even_if_nobody_said_that_there_may_be_one() -> None:
    one = [played(1, 2)]
    assert summaries(Design((), [()]), player(can_succeed=False), [], [one], 0.95).policies[0].success
    none = [played(-1, -2)]
    assert summaries(Design((), [()]), player(can_succeed=False), [], [none], 0.95).policies[0].success is None


def test_returns_terms_and_metrics_are_those_of_the_episodes() -> None:
    some = episodes(50, np.random.default_rng(1), metrics=2)
    result = summary_of("p", some, ["near", "cost"], ["m", "n"], 0.95, can_succeed=True)
    returns = [each.total for each in some]
    assert (result.policy, result.episodes) == ("p", 50)
    assert result.returns.mean == pytest.approx(np.mean(returns))
    assert result.returns.median == np.median(returns)
    assert result.rewards["cost"].mean == pytest.approx(np.mean([each.rewards["cost"] for each in some]))
    assert result.metrics["n"].max == max(each.metrics[1] for each in some)
    assert result.lengths.min == min(each.length for each in some)


def test_endings_are_counted_the_most_frequent_first() -> None:
    some = episodes(60, np.random.default_rng(2))
    result = summary_of("p", some, [], [], 0.9, can_succeed=True)
    counts = [ending.share.count for ending in result.endings]
    assert counts == sorted(counts, reverse=True)
    assert sum(counts) == 60
    arrived = next(each for each in result.endings if each.ending == "arrived")
    assert arrived.outcome == "success"
    assert result.success == arrived.share
    expected = scipy.stats.binomtest(arrived.share.count, 60).proportion_ci(0.9, method="wilson")
    assert arrived.share.interval.low == pytest.approx(expected.low)


def test_without_a_termination_that_is_a_success_there_is_no_rate() -> None:
    some = episodes(5, np.random.default_rng(2))
    assert summary_of("p", some, [], [], 0.95, can_succeed=False).success is None


def test_the_difference_of_returns_has_the_interval_of_the_paired_t_test() -> None:
    generator = np.random.default_rng(3)
    theirs = generator.normal(0, 5, 40)
    ours = theirs + generator.normal(0.6, 1, 40)
    result = compared([played(*ours, policy="a")], [played(*theirs, policy="b")], 0.9, can_succeed=True)
    test = scipy.stats.ttest_rel(ours, theirs)
    interval = test.confidence_interval(0.9)
    assert result.returns.difference == pytest.approx(np.mean(ours - theirs))
    assert (result.returns.interval.low, result.returns.interval.high) == pytest.approx((interval.low, interval.high))
    assert result.returns.better == "a"
    assert test.pvalue < 0.1
    assert result.returns.first_wins == np.sum(ours > theirs)
    assert result.returns.second_wins == np.sum(ours < theirs)
    means = [scipy.stats.trim_mean(each, 0.25) for each in (ours, theirs)]
    assert result.returns.iqm == pytest.approx(means[0] - means[1])
    assert result.returns.iqm_interval == iqm_difference_interval(ours, theirs, 0.9, np.arange(40))


def test_the_difference_of_few_pairs_is_questioned() -> None:
    ours, theirs = played(*range(10), policy="a"), played(*np.linspace(3, 0, 10), policy="b")
    result = compared([ours], [theirs], 0.95, can_succeed=False)
    assert doubts([], result, 0.95, 10)[-1].startswith(
        "the 95 % interval of the mean difference may be too narrow: 35 % of"
    )
    at_points = compared([ours] * 4, [theirs] * 4, 0.95, can_succeed=False)
    many = at_points.returns
    assert (many.doubt, many.iqm) == ("few", result.returns.iqm)  # the same seeds at four points
    assert "35 % of samples of 10 seeds" in doubts([], at_points, 0.95, 10)[-1]
    shifted = compared([ours], [replace(ours, policy="b")], 0.95, can_succeed=False)
    assert doubts([], shifted, 0.95, 10) == [""]


def test_the_difference_of_successes_is_that_of_paired_shares() -> None:
    ours, theirs = [1, 1, 1, 1, -1, 1], [1, -1, -1, 1, -1, -1]
    result = compared([played(*ours, policy="a")], [played(*theirs, policy="b")], 0.95, can_succeed=True).success
    assert result
    assert result.difference == pytest.approx(3 / 6)
    assert (result.first_wins, result.second_wins, result.ties) == (3, 0, 3)
    assert result.interval == paired_share_interval(np.array(ours) > 0, np.array(theirs) > 0)


def test_points_are_paired_with_their_own() -> None:
    ours = [played(1, 2, policy="a"), played(5, 6, policy="a", point=1)]
    theirs = [played(0, 1, policy="b"), played(4, 5, policy="b", point=1)]
    result = compared(ours, theirs, 0.95, can_succeed=False)
    assert result.success is None
    assert result.pairs == 4
    assert result.returns.difference == 1


def test_the_same_episodes_cannot_be_told_apart() -> None:
    one = played(1, 2, -3, policy="a")
    result = compared([one], [one], 0.95, can_succeed=True)
    assert result.returns.better is None
    assert result.success
    assert result.success.better is None
    assert result.returns.ties == 3


def test_a_policy_that_is_worse_is_reported_as_the_other_being_better() -> None:
    result = compared([played(1, 2, 3, policy="a")], [played(5, 6.1, 7, policy="b")], 0.95, can_succeed=False)
    assert result.returns.better == "b"


def test_pairs_of_one_seed_at_several_points_are_no_independent_ones() -> None:
    ours, theirs = np.random.default_rng(2).normal(0.3, 1, (2, 9, 40))  # points, seeds
    common = np.random.default_rng(3).normal(0, 2, 40)
    first = [played(*row, policy="a", point=point) for point, row in enumerate(ours + common)]
    second = [played(*row, policy="b", point=point) for point, row in enumerate(theirs - common)]
    result = compared(first, second, 0.9, can_succeed=True)
    means = (ours + common - theirs + common).mean(axis=0)  # of each seed
    interval = scipy.stats.ttest_1samp(means, 0).confidence_interval(0.9)
    assert result.pairs == 360
    assert (result.returns.interval.low, result.returns.interval.high) == pytest.approx((interval.low, interval.high))

    lone = compared(first[:1], second[:1], 0.9, can_succeed=True)
    same = compared(first[:1] * 5, second[:1] * 5, 0.9, can_succeed=True)
    assert same.success
    assert lone.success
    for several, one in ((same.returns, lone.returns), (same.success, lone.success)):
        assert (several.interval.low, several.interval.high) == pytest.approx((one.interval.low, one.interval.high))
