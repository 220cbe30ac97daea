"""Rows by the cells of some columns, in any order; beside a join by a dictionary."""

import random
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mjrun.diff.keyed_rows import KeyedRows, pairs_by_columns

keys = st.lists(st.tuples(st.sampled_from([0.0, 0.5, 3.0]), st.sampled_from(["a", "b", ""])), max_size=8)


class TextRows:
    path, names, units = Path("rows.csv"), ["mass", "x", "name"], {}

    def __init__(self, rows: list[tuple[float, str]]) -> None:
        self._rows = rows

    def blocks(self) -> Iterator[np.ndarray]:
        for index, (mass, name) in enumerate(self._rows):
            yield np.array([[mass, float(index), name]], object)


@given(keys, st.randoms(use_true_random=False))
def test_rows_in_another_order_belong_together_by_their_keys(
    rows: list[tuple[float, str]], dice: random.Random
) -> None:
    order = sorted(range(len(rows)), key=lambda _: dice.random())
    shuffled = [rows[index] for index in order]
    a, b = (KeyedRows(TextRows(each), ["x"], ["mass", "name"]) for each in (rows, [*shuffled, (9.0, "c")]))
    for pairs in pairs_by_columns(a, b):
        assert [rows[i] for i in pairs.rows_a] == [shuffled[j] for j in pairs.rows_b]
        assert sorted(pairs.rows_a) == sorted(pairs.rows_b) == [*range(len(rows))]
        assert pairs.a[:, 0].tolist() == pairs.rows_a.tolist()
    assert a.unmatched.count == 0
    assert (b.unmatched.count, b.unmatched.first, b.unmatched.key) == (1, len(rows), "mass = 9, name = c")


def test_a_number_is_the_same_key_however_it_is_written() -> None:
    one, other = TextRows([(3.0, "1.0"), (-0.0, "x")]), TextRows([(0.0, "x"), (3.0, "1")])
    (pairs,) = pairs_by_columns(KeyedRows(one, ["x"], ["mass", "name"]), KeyedRows(other, ["x"], ["mass", "name"]))
    assert (pairs.rows_a.tolist(), pairs.rows_b.tolist()) == ([0, 1], [1, 0])
