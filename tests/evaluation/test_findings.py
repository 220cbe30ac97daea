"""What an evaluation comes to, by policies and points."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from mjrun.evaluation.findings import findings, map_columns
from mjrun.evaluation.prepared import PreparedEvaluation
from mjrun.evaluation.statistics import mean_interval, wilson_interval
from mjrun.study.design import Design
from tests.evaluation.episodes import played, totals

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
    found = findings(prepared(POINTS), [groups], 0.95)
    assert found.policies[0].returns.mean == pytest.approx(np.mean(totals(groups)))
    assert [point.policies[0].returns.mean for point in found.points] == pytest.approx([2 / 3, 6])
    assert [point.values for point in found.points] == [{"mass": "1"}, {"mass": "2"}]
    assert found.comparison is None


def test_points_make_the_table_of_a_study_with_intervals_last() -> None:
    ours = [played(1, -2, 3), played(5, 6, 7, point=1)]
    theirs = [played(1, -1, 1, policy="q"), played(5, 5, 5, point=1, policy="q")]
    found = findings(prepared(POINTS), [ours, theirs], 0.95)
    columns, rows, metrics = map_columns(POINTS, found.points)
    table = {column.name: rows[:, i] for i, column in enumerate(columns)}
    names = [column.name for column in columns]
    assert names[: names.index("status")] == ["point", "mass", *metrics]
    assert [*metrics] == ["success", "return", "length", "return_difference", "success_difference"]
    assert table["success"] == pytest.approx([2 / 3, 1])
    assert table["return_difference"] == pytest.approx([1 / 3, 1])
    expected = mean_interval(np.array([5.0, 6, 7]))
    assert (table["return_low"][1], table["return_high"][1]) == (expected.low, expected.high)
    assert table["success_low"][0] == wilson_interval(2, 3).low


def test_a_success_makes_a_rate_even_if_nobody_said_that_there_may_be_one() -> None:
    one = [played(1, 2)]
    assert findings(prepared(Design((), [()]), can_succeed=False), [one], 0.95).policies[0].success
    none = [played(-1, -2)]
    assert findings(prepared(Design((), [()]), can_succeed=False), [none], 0.95).policies[0].success is None
