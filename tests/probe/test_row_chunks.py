"""Chunks of rows, and aggregates over the rows on which a condition holds, against numpy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.errors import UsageError
from mjrun.probe.aggregate import CHUNK
from mjrun.probe.metric import MetricEvaluation, parse_metric
from mjrun.probe.row_chunks import ChunkBuffer

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
    evaluation = MetricEvaluation([parse_metric(text, list(TABLE), "metric")], list(TABLE))
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


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("share(x)", "found a number, expected a comparison"),
        ("mean(x, 3)", "found a number, expected a comparison"),
        ("mean(x, max(y) > 2)", "found an aggregate as the condition of mean, expected values per row"),
        ("mean(x, y > 0, 3)", "found one value more"),
        ("quantile(x)", "quantile of one value"),
        ("quantile(x, 2)", "a number from 0 to 1"),
        ("quantile(x, y)", "a number from 0 to 1"),
        ("abs(x > 1)", "expected"),
    ],
)
def test_what_is_no_aggregate_is_told(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        value(text)
