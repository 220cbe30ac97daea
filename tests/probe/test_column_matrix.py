"""Columns of a matrix are what a dict of them is, alone and side by side."""

import numpy as np
import pytest

from mjrun.probe.column_matrix import ColumnLayout, ColumnMatrix

MATRIX = np.random.default_rng(0).normal(size=(5, 6))[:, :4]
COLUMNS = {**dict(zip("abcd", MATRIX.T, strict=True)), "time": np.arange(5.0)}
MADE = ColumnMatrix(ColumnLayout("abcd"), MATRIX, {"time": COLUMNS["time"]})


def test_it_is_a_mapping_of_contiguous_columns() -> None:
    assert list(MADE) == list(COLUMNS)
    assert len(MADE) == 5
    for name, values in COLUMNS.items():
        np.testing.assert_array_equal(MADE[name], values)
        assert MADE[name].flags.c_contiguous
    with pytest.raises(KeyError):
        MADE["e"]


@pytest.mark.parametrize("names", [("b", "c"), ("a", "b", "c", "d"), ("c", "b"), ("a", "c"), ("d", "time"), ("time",)])
def test_vectors_have_their_columns_in_order(names: tuple[str, ...]) -> None:
    vector = MADE.vector(names)
    np.testing.assert_array_equal(vector, np.stack([COLUMNS[name] for name in names], axis=-1))
    assert vector.flags.c_contiguous
