"""Aggregates are exact, however large or small the values."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.probe.aggregate import CHUNK, RowChunk, accumulator, shown
from mjrun.probe.expression import AGGREGATES
from tests.probe.expression_oracle import ODD, VALUES, aggregate, judged

OF_VALUES = [name for name in AGGREGATES if name not in ("share", "quantile")]  # take a value and nothing else


@given(st.lists(VALUES | ODD | st.floats(allow_nan=False), min_size=1, max_size=30), st.sampled_from(OF_VALUES))
@settings(max_examples=400, deadline=None)
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
        for first in range(0, len(values), size):
            part = values[first : first + size]
            accumulated.add(part, RowChunk({"time": part}, np.arange(first, first + len(part))))
        results.append((accumulated.value, accumulated.place))
    assert len(set(results)) == 1
    assert results[0][0] == aggregate(name, values)
