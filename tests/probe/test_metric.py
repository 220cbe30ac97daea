"""Metrics are the aggregates of assertions, to the last bit."""

import math

import numpy as np
import pytest

from mjrun.errors import UnknownNameError, UsageError
from mjrun.probe.metric import BatchMetricEvaluator, MetricEvaluator, parse_metric

RNG = np.random.default_rng(4)
X, Y = RNG.normal(size=1500), RNG.normal(size=1500)


def value(text: str, sizes: tuple[int, ...] = (1500,)) -> float:
    evaluation = MetricEvaluator([parse_metric(text, ["x", "y"], "metric")], ["y", "x"])
    start = 0
    for size in sizes:
        evaluation.feed(np.stack([Y, X], axis=1)[start : start + size])
        start += size
    return evaluation.values()[0]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("max(abs(x - y))", np.abs(X - Y).max()),
        ("last(x) / first(x)", X[-1] / X[0]),
        ("mean(x)", math.fsum(X) / len(X)),
        ("sqrt(2) * rms(x*y)", math.sqrt(2) * math.sqrt(math.fsum((X * Y) ** 2) / len(X))),
        ("max(max(x), max(y))", max(X.max(), Y.max())),
        ("first(x)", X[0]),
    ],
)
def test_the_value_is_that_of_numpy(text: str, expected: float) -> None:
    assert value(text) == pytest.approx(expected, rel=1e-15)


def test_the_value_does_not_depend_on_the_blocks() -> None:
    text = "std(x) + quantile(y, .3) + mean(x, y > 0)"
    assert value(text) == value(text, (1, 511, 700, 288))


SIDE_BY_SIDE = (
    *("min(x)", "max(x)", "first(x)", "last(x)", "share(x > 0)", "count(x > 0)", "count(y > 100)"),
    *("min(x, y > 1)", "max(x, y > 1)", "first(x, y > 1)", "last(x, y > 1)", "first(x, y > 100)", "max(x, y > 100)"),
    *("max(abs(x - y)) - min(y)^2", "mean(x)", "max(x - first(x))"),
)


@pytest.mark.parametrize("sizes", [(1300,), (1, 511, 700, 88), (600, 700)])
def test_tables_side_by_side_have_the_values_of_each_alone(sizes: tuple[int, ...]) -> None:
    tables = np.random.default_rng(5).normal(size=(5, 1300, 2))
    tables[1, 5, 0] = tables[3, 700, 0] = math.nan
    tables[2, :, 0], tables[4, 3, 0], tables[4, :, 1] = math.inf, -math.inf, 5
    metrics = [parse_metric(text, ["x", "y"], "metric") for text in SIDE_BY_SIDE]
    batch = BatchMetricEvaluator(metrics, ["x", "y"], 5)
    alone = [MetricEvaluator(metrics, ["x", "y"]) for _ in tables]
    start = 0
    for size in sizes:
        batch.feed(tables[:, start : start + size], np.full(5, size))
        for evaluation, table in zip(alone, tables, strict=True):
            evaluation.feed(table[start : start + size])
        start += size
    np.testing.assert_array_equal(batch.values(), [each.values() for each in alone])


def test_without_rows_there_is_no_value() -> None:
    assert math.isnan(value("count(x > 0)", ()))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x", "found values per row, expected one number, such as max"),
        ("max(x) > 3", "found a comparison, expected a number"),
        ("3", "expected a column in it"),
    ],
)
def test_what_is_not_one_number_is_refused(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        value(text)


def test_an_unknown_column_is_named() -> None:
    with pytest.raises(UnknownNameError, match="metric"):
        parse_metric("max(metrc)", ["metric"], "metric")


@pytest.mark.parametrize("text", ["share(x > 0)", "count(x > 0)", "max(x)", "mean(x)"])
def test_a_table_without_rows_beside_others_has_no_number(text: str) -> None:
    columns = ["time", "x"]
    batch = BatchMetricEvaluator([parse_metric(text, columns, "metric")], columns, 2)
    batch.feed(np.ones((2, 3, 2)), np.array([0, 3]))
    (absent,), (present,) = batch.values()
    assert np.isnan(absent)
    assert present == (3 if "count" in text else 1)
