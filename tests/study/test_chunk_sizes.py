"""Chunks take seconds, whatever points cost, and leave no worker without one."""

from collections import deque
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.study.chunk_sizes import GROWTH, MOST, SECONDS, ChunkSizes


def division(sizes: ChunkSizes, costs: Sequence[float], ahead: int, steps: np.ndarray | None = None) -> list[int]:
    """The points of each chunk where `ahead` are in flight, and points cost so many seconds, in their order."""
    counts, flying, start = list[int](), deque[tuple[int, int, float]](), 0
    steps = np.full(len(costs), 10) if steps is None else steps
    while start < len(costs):
        if len(flying) == ahead:
            sizes.add(*flying.popleft())
        count = sizes.next(steps[start:])
        part = slice(start, start + count)
        flying.append((count, int(steps[part].sum()), sum(costs[part])))
        counts.append(count)
        start += count
    return counts


@given(st.integers(1, 5000), st.integers(1, 60), st.sampled_from([0.0, 1e-5, 1e-3, 0.05, 1.0, 100.0]))
@settings(deadline=None, max_examples=30)
def test_every_point_is_in_a_chunk_that_takes_seconds(count: int, ahead: int, cost: float) -> None:
    counts = division(ChunkSizes(None, ahead), [cost] * count, ahead)
    assert sum(counts) == count
    assert min(counts) >= 1
    assert max(counts) <= MOST
    assert len(counts) >= min(ahead, count)  # each worker has as many as it takes ahead
    assert all(size == 1 or size * cost <= SECONDS * 1.001 for size in counts)
    largest = 1
    for size in counts:
        assert size <= GROWTH * largest
        largest = max(largest, size)


def test_chunks_grow_to_seconds_and_shrink_towards_the_end() -> None:
    counts = division(ChunkSizes(None, 6), [0.01] * 10_000, 6)
    assert counts[:6] == [1] * 6
    assert max(counts) == 300
    assert counts[-2] <= 20
    assert len(counts) < 80


@pytest.mark.parametrize("order", [1, -1])
def test_chunks_take_seconds_where_points_take_ever_more_or_fewer_steps(order: int) -> None:
    steps = np.geomspace(10, 1e5, 6000).astype(int)[::order]
    costs = 2e-5 * steps
    ends = np.cumsum([0, *division(ChunkSizes(None, 6), costs.tolist(), 6, steps)])
    assert max(costs[start:end].sum() for start, end in pairwise(ends)) < 1.1 * SECONDS


def test_chunks_take_seconds_where_points_with_few_steps_are_compiled() -> None:
    steps = np.tile([10, 100_000], 500)
    costs = 0.1 + 1e-6 * steps
    counts = division(ChunkSizes(None, 6), costs.tolist(), 6, steps)
    assert max(counts) * costs.mean() < 1.1 * SECONDS
    assert sum(counts) / len(counts) > 4


def test_a_size_that_is_chosen_stays() -> None:
    assert division(ChunkSizes(40, 6), [9.0] * 100, 6) == [40, 40, 20]


@pytest.mark.parametrize(("left", "size"), [(10_000, 25), (60, 10), (1, 1)])
def test_a_first_guess_is_no_more_than_a_share(left: int, size: int) -> None:
    assert ChunkSizes(None, 6, first=25).next(np.ones(left)) == size
