"""What is required of episodes."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from mjrun.errors import UnknownNameError, UsageError
from mjrun.evaluation.criteria import Criteria
from mjrun.evaluation.episode import Episode, PlayedEpisodes
from mjrun.evaluation.summaries import compared, summary_of
from mjrun.evaluation.table import episode_table
from mjrun.experiment.design import Design
from mjrun.experiment.results_table import ResultsTable
from mjrun.options.evaluation import EvaluationOptions
from tests.evaluation.episodes import ENDINGS, episodes, played

NUMBERS = ["seed", "return", "length", "steps", "reward/near", "reward/cost", "m"]
SOME = episodes(40, np.random.default_rng(4))
NAMES = [name for name, _ in ENDINGS]


def criteria(*, can_succeed: bool = True, is_compared: bool = False, **options: Any) -> Criteria:
    made = EvaluationOptions(None, "out", metric={"m": "mean(time)"}, **options)
    return Criteria(made, NUMBERS, NAMES, can_succeed=can_succeed, compared=is_compared)


def table_of(some: Sequence[Episode]) -> tuple[ResultsTable, int]:
    group = PlayedEpisodes("p", 0, some)
    return episode_table([group], Design((), [()]), ["near", "cost"], ["m"], compared=False), len(some)


def verdicts(**options: Any) -> Sequence[bool]:
    summary = summary_of("p", SOME, ["near", "cost"], ["m"], 0.95, can_succeed=True)
    return [each.passed for each in criteria(**options).verdicts(*table_of(SOME), summary, None)]


def test_a_requirement_is_about_the_table_and_the_endings_in_it() -> None:
    returns = np.array([each.total for each in SOME])
    rate = np.mean([each.outcome == "success" for each in SOME])
    fallen = np.mean([each.ending == "fallen" for each in SOME])
    assert verdicts(require=[f"share(success) > {rate - 0.01}", f"share(success) > {rate + 0.01}"]) == [True, False]
    assert verdicts(require=[f"share(fallen) < {fallen + 0.01}", f"share(failure) < {fallen - 0.01}"]) == [True, False]
    low = np.quantile(returns, 0.05)
    assert verdicts(require=[f"quantile(return, 0.05) > {low - 0.1}", f"min(return) > {low + 0.1}"]) == [True, False]
    assert verdicts(require=["max(m, success) < 100", "steps > 1000", "reward/near < 100"]) == [True, False, True]


@pytest.mark.parametrize("name", ["success", "return", "length", "m"])
def test_a_threshold_is_the_least_that_passes(name: str) -> None:
    summary = summary_of("p", SOME, [], ["m"], 0.95, can_succeed=True)
    numbers = {"return": summary.returns, "length": summary.lengths, "m": summary.metrics["m"]}
    assert summary.success
    value = summary.success.share if name == "success" else numbers[name].mean
    low = summary.success.interval.low if name == "success" else numbers[name].mean_interval.low
    assert value is not None
    assert low is not None
    assert verdicts(fail_below={name: value}) == [True]
    assert verdicts(fail_below={name: value + 1e-9}) == [False]
    assert verdicts(fail_below={f"{name}_low": low}) == [True]
    assert verdicts(fail_below={f"{name}_low": low + 1e-9}) == [False]


def test_a_comparison_has_differences_to_require() -> None:
    ours, theirs = [played(1, 2, 3, policy="a")], [played(0, 1, 2.5, policy="b")]
    comparison = compared(ours, theirs, 0.95, can_succeed=True)
    summary = summary_of("a", ours[0].episodes, [], [], 0.95, can_succeed=True)
    some = criteria(is_compared=True, fail_below={"return_difference": 0.8, "success_difference_low": 0.5})
    assert [each.passed for each in some.verdicts(*table_of(SOME), summary, comparison)] == [True, False]
    with pytest.raises(UnknownNameError, match="return_difference"):
        criteria(fail_below={"return_difference": 0})


def test_a_lone_episode_has_no_interval_to_be_above_anything() -> None:
    one = played(5)
    summary = summary_of("p", one.episodes, [], [], 0.95, can_succeed=True)
    (verdict,) = criteria(fail_below={"return_low": -100}).verdicts(*table_of(SOME[:1]), summary, None)
    assert not verdict.passed
    assert "too few episodes" in verdict.message


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"require": ["share(flown) > 0"]}, "flown"),
        ({"require": ["return >"]}, "return >"),
        ({"fail_below": {"fallen": 1}}, "fallen"),
        ({"fail_below": {"success": 0.5}, "can_succeed": False}, "no termination of the task is a success"),
    ],
)
def test_what_names_nothing_is_told_before_anything_is_played(options: dict[str, object], match: str) -> None:
    with pytest.raises(UsageError, match=match):
        criteria(**options)  # type: ignore[arg-type]
