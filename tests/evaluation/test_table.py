"""Tables of episodes and points, read back, and requirements on them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from mjrun.errors import UnknownNameError, UsageError
from mjrun.evaluation.episode import EpisodeRecord, PlayedEpisodes
from mjrun.evaluation.summaries import (
    FILES,
    PassCriteria,
    PointSummary,
    compared,
    episode_table,
    point_table,
    summary_of,
)
from mjrun.experiment.design import Design
from mjrun.experiment.results_table import ResultsTable
from mjrun.experiment.statistics import mean_interval, wilson_interval
from mjrun.options.evaluation import EvaluationOptions
from tests.evaluation.episodes import ENDINGS, episodes, played

ALONE = Design((), [()])


def test_a_row_is_an_episode_with_integers_as_integers(tmp_path: Path) -> None:
    some = episodes(20, np.random.default_rng(1), seed=7)
    table = episode_table([PlayedEpisodes("p", 0, some)], ALONE, ["near", "cost"], ["m"], {"m": "N"}, compared=False)
    table.write(tmp_path, {}, FILES)

    csv, parquet = (
        pd.read_csv(tmp_path / FILES[1], converters=dict.fromkeys(["return", "reward/cost", "m"], float)),
        pq.read_table(tmp_path / FILES[0]),
    )
    names = ["episode", "seed", "return", "length", "steps", "ending", "outcome", "reward/near", "reward/cost", "m"]
    names += ["status", "message"]
    assert [*csv.columns] == parquet.column_names == names
    for name in ("episode", "seed", "steps"):
        assert str(csv[name].dtype) == str(parquet.schema.field(name).type) == "int64"
    assert csv["seed"].tolist() == list(range(7, 27))
    assert csv["return"].tolist() == [each.total for each in some]
    assert csv["reward/cost"].tolist() == [each.rewards["cost"] for each in some]
    assert csv["ending"].tolist() == parquet["ending"].to_pylist() == [each.ending for each in some]
    assert csv["outcome"].tolist() == [each.outcome for each in some]
    assert csv["m"].tolist() == [each.metrics[0] for each in some]
    assert parquet.schema.field("m").metadata[b"unit"] == b"N"


def test_policies_and_points_tell_rows_apart() -> None:
    generator = np.random.default_rng(1)
    points = Design(("geom/floor.friction[0]", "model"), [("0.5", "a.xml"), ("1", "b.xml")])
    groups = [PlayedEpisodes(name, point, episodes(3, generator)) for name in ("mine", "other") for point in range(2)]
    made = episode_table(groups, points, [], [], compared=True)
    table = made.numbers
    assert [column.name for column in made.columns[:4]] == ["policy", "point", "geom/floor.friction[0]", "model"]
    assert made.columns[0].labels == ("mine", "other")
    assert table["point"].tolist() == [0, 0, 0, 1, 1, 1] * 2
    assert table["geom/floor.friction[0]"].tolist() == [0.5] * 3 + [1.0] * 3 + [0.5] * 3 + [1.0] * 3
    assert table["episode"].tolist() == [0, 1, 2] * 4


def test_a_term_that_an_episode_lacks_is_no_number() -> None:
    some = episodes(2, np.random.default_rng(1))
    table = episode_table([PlayedEpisodes("p", 0, some)], ALONE, ["near", "other"], [], compared=False).numbers
    assert np.isnan(table["reward/other"]).all()
    assert table["reward/near"] == pytest.approx([each.rewards["near"] for each in some])


def test_points_make_the_table_of_a_study_with_intervals_last() -> None:
    ours = [played(1, -2, 3), played(5, 6, 7, point=1)]
    theirs = [played(1, -1, 1, policy="q"), played(5, 5, 5, point=1, policy="q")]
    points = [
        PointSummary(
            point,
            {},
            [summary_of(each.policy, each.episodes, [], [], 0.95, can_succeed=True) for each in pair],
            compared([pair[0]], [pair[1]], 0.95, can_succeed=True),
        )
        for point, pair in enumerate(zip(ours, theirs, strict=True))
    ]
    made, metrics = point_table(Design(("mass",), [("1",), ("2",)]), points)
    table, names = made.numbers, [column.name for column in made.columns]
    assert names[: names.index("status")] == ["point", "mass", *metrics]
    differences = ["return_difference", "success_difference", "return_iqm_difference"]
    assert [*metrics] == ["success", "return", "return_iqm", "length", *differences]
    assert table["return_iqm"].tolist() == table["return"].tolist()  # three episodes have no quarter to leave out
    assert table["success"] == pytest.approx([2 / 3, 1])
    assert table["return_difference"] == pytest.approx([1 / 3, 1])
    expected = mean_interval(np.array([5.0, 6, 7]))
    assert (table["return_low"][1], table["return_high"][1]) == (expected.low, expected.high)
    assert table["success_low"][0] == wilson_interval(2, 3).low


NUMBERS = ["seed", "return", "length", "steps", "reward/near", "reward/cost", "m"]
SOME = episodes(40, np.random.default_rng(4))
NAMES = [name for name, _ in ENDINGS]


def criteria(*, can_succeed: bool = True, **options: Any) -> PassCriteria:
    made = EvaluationOptions(None, "out", metric={"m": "mean(time)"}, **options)
    return PassCriteria(made, NUMBERS, NAMES, can_succeed=can_succeed)


def table_of(some: Sequence[EpisodeRecord]) -> tuple[ResultsTable, int]:
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
    some = criteria(compare="zero", fail_below={"return_difference": 0.8, "success_difference_low": 0.5})
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
        ({"fail_below": {"success": 90}}, "'success=90' is not a share, such as 90% or 0.9"),
        ({"fail_below": {"success": 0.5}, "can_succeed": False}, "no termination of the task is a success"),
    ],
)
def test_what_names_nothing_is_reported_before_anything_is_played(options: dict[str, object], match: str) -> None:
    with pytest.raises(UsageError, match=match):
        criteria(**options)  # type: ignore[arg-type]
