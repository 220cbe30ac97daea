"""Columns of results are the results that were put into them, one after another."""

import math
from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mjrun.study.results import FINAL, NOT_YET, STATUSES, ResultColumns, ResultRows
from mjrun.study.spec import PointResult, Status

COUNT = 5
RESULT = st.builds(
    PointResult,
    index=st.integers(10, 10 + COUNT - 1),
    status=st.sampled_from(STATUSES[:-1]),
    metrics=st.tuples(st.floats(), st.floats()),
    steps=st.integers(0, 2**40),
    exit_code=st.integers(0, 255),
    message=st.sampled_from(["", "a", "ü\n"]),
    wall=st.floats(0, 9),
)


@given(st.lists(st.lists(RESULT, max_size=4), max_size=4))
def test_columns_are_their_results_and_final_ones_stay(parts: list[list[PointResult]]) -> None:
    columns = ResultColumns(range(10, 10 + COUNT), 2)
    expected = {index: PointResult(index, "missing", (math.nan,) * 2, 0, 0, NOT_YET) for index in range(10, 10 + COUNT)}
    for part in parts:
        columns.put(np.array([each.index - 10 for each in part], int), ResultRows.of(part, 2, "host"))
        for index, before in expected.items():
            new = [each for each in part if each.index == index]
            final = [each for each in new if each.status in FINAL]
            if new and before.status not in FINAL:
                expected[index] = (final or new)[-1]
    assert [*map(str, columns)] == [str(expected[index]) for index in range(10, 10 + COUNT)]
    assert [str(each) for each in columns[1:3]] == [*map(str, columns)][1:3]
    copy = ResultColumns(columns.points, 2)
    copy.put(np.arange(COUNT), columns.rows(np.arange(COUNT)))
    assert [*map(str, copy)] == [*map(str, columns)]

    results = [*expected.values()]
    assert columns.counts == {s: n for s in STATUSES if (n := sum(each.status == s for each in results))}
    codes, texts = columns.messages
    assert [texts[code] for code in codes] == [each.message for each in results]
    assert columns.is_final.tolist() == [each.status in FINAL for each in results]
    assert columns.is_missing.tolist() == [each.status == "missing" for each in results]
    ends = [(each.status, each.message) for each in results]
    kinds = {end: (ends.count(end), ends.index(end)) for end in ends if end[0] != "ok"}
    assert {(status, message): (count, first) for status, message, count, first in columns.endings} == kinds


def test_results_in_order_are_columns() -> None:
    status: Status = "ok"
    results = [PointResult(index, status, (index / 2,), index) for index in range(3)]
    assert list(ResultColumns.of(results, 1)) == [replace(each) for each in results]
