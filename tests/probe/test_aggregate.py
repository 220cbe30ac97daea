"""Aggregates are exact, however large or small the values."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.errors import UsageError
from mjrun.probe.expression import AGGREGATES
from mjrun.probe.metric import (
    CHUNK,
    ChunkBuffer,
    MetricEvaluator,
    RowChunk,
    ShareAccumulator,
    accumulator,
    parse_metric,
    shown,
)
from tests.cases import cases
from tests.probe.expression_oracle import ODD, VALUES, aggregate, judged

OF_VALUES = [name for name in AGGREGATES if name not in ("share", "quantile")]  # take a value and nothing else


@given(st.lists(VALUES | ODD | st.floats(allow_nan=False), min_size=1, max_size=30), st.sampled_from(OF_VALUES))
@settings(max_examples=125, deadline=None)
def test_every_aggregate_is_the_true_value_rounded_once(values: list[float], name: str) -> None:
    with np.errstate(all="ignore"):
        expected = aggregate(name, np.array(values))
    message = judged(f"{name}(x) < 0", ["x"], values).message.split(": it is ")[1]
    found = float(message.partition(",")[0].partition(" ")[0])
    assert found == expected or (math.isnan(found) and math.isnan(expected))


def test_sums_neither_cancel_nor_drift() -> None:
    assert judged("sum(x) == 2", ["x"], [1e308, 1, 1e308, 1, -1e308, -1e308]).passed
    assert judged("sum(x) == 1000 * .1 and mean(x) == .1", ["x"], [0.1] * 1000).passed
    tiny = 1e9 + np.tile([-0.001953125, 0.001953125], 3000)
    assert judged("std(x) == 0.001953125", ["x"], tiny).passed
    assert judged("rms(x) == 1e200 and std(x) == 0", ["x"], [1e200] * 3).passed
    assert judged("rms(x) == 5e-324", ["x"], [5e-324] * 3).passed
    assert judged("sum(x) == inf and mean(x) == 1e308", ["x"], [1e308] * 3).passed
    assert judged("sum(x) == -inf and mean(x) == -1e308", ["x"], [-1e308] * 3).passed


@given(st.floats())
def test_a_number_is_shown_so_that_it_reads_back(value: float) -> None:
    assert float(shown(value)) == value or math.isnan(value)


@pytest.mark.parametrize("name", OF_VALUES)
def test_an_accumulator_does_not_depend_on_how_the_rows_are_split(name: str) -> None:
    values = np.random.default_rng(5).standard_normal(3 * CHUNK)
    results = []
    for size in (1, 7, CHUNK):
        accumulated = accumulator(name)
        assert not isinstance(accumulated, ShareAccumulator)
        for first in range(0, len(values), size):
            part = values[first : first + size]
            accumulated.add(part, RowChunk({"time": part}, np.arange(first, first + len(part))))
        results.append((accumulated.value, accumulated.place))
    assert len(set(results)) == 1
    assert results[0][0] == aggregate(name, values)


ROWS = 2 * CHUNK + 100
RNG = np.random.default_rng(11)
TABLE = {"time": np.arange(ROWS) * 0.002, "x": RNG.normal(size=ROWS), "y": RNG.normal(size=ROWS)}


@given(st.lists(st.integers(0, 700), max_size=12))
@settings(deadline=None)
def test_the_chunks_do_not_depend_on_the_blocks(sizes: list[int]) -> None:
    buffer = ChunkBuffer(["a", "b"], ["b"])
    chunks, first = [], 0
    for size in sizes:
        rows = np.arange(first, first + size)
        chunks += [(c.rows.tolist(), c.columns["b"].tolist()) for c in buffer.feed(np.stack([-rows, rows], 1), first)]
        first += size
    chunks += [(c.rows.tolist(), c.columns["b"].tolist()) for c in buffer.rest()]

    every = list(range(sum(sizes)))
    expected = [every[start : start + CHUNK] for start in range(0, len(every), CHUNK)]
    assert chunks == [(rows, rows) for rows in expected]


def value(text: str) -> float:
    evaluation = MetricEvaluator([parse_metric(text, list(TABLE), "metric")], list(TABLE))
    evaluation.feed(np.stack(list(TABLE.values()), axis=1))
    return evaluation.values()[0]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("first(time, x > 2)", TABLE["time"][TABLE["x"] > 2][0]),
        ("last(time, x > 2)", TABLE["time"][TABLE["x"] > 2][-1]),
        ("max(y, x > 1 and time < 1)", TABLE["y"][(TABLE["x"] > 1) & (TABLE["time"] < 1)].max()),
        ("count(x > y)", np.count_nonzero(TABLE["x"] > TABLE["y"])),
        ("share(not x > y)", np.mean(TABLE["x"] <= TABLE["y"])),
        ("median(x)", np.median(TABLE["x"])),
        ("quantile(abs(x), 0.95)", np.quantile(np.abs(TABLE["x"]), 0.95)),
        ("quantile(x, .1, y > 0)", np.quantile(TABLE["x"][TABLE["y"] > 0], 0.1)),
        ("max(x, x - first(x) < 0)", TABLE["x"][TABLE["x"] < TABLE["x"][0]].max()),
        ("first(time, x > 100)", np.nan),
        ("mean(x, x > 100)", np.nan),
        ("count(x > 100)", 0.0),
        ("sum(x, x > 100)", 0.0),
        ("share(x > 100)", 0.0),
        ("median(x, x > 100)", np.nan),
    ],
)
def test_aggregates_over_the_rows_on_which_a_condition_holds(text: str, expected: float) -> None:
    assert value(text) == pytest.approx(expected, rel=1e-15, abs=0, nan_ok=True)


@cases("text, message")
def test_what_is_no_aggregate_is_reported(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        value(text)
