"""Checks that all readers of tables share."""

import re
from pathlib import Path

import pytest

from mjrun.errors import FileError
from mjrun.formats.table_read_stream import require_equal_lengths, require_vector, select, select_parts, shown

PATH = Path("t.npz")


def test_wanted_names_have_their_index_and_are_unique() -> None:
    assert select(PATH, ["a", "b", "a", "c"], "bc".__contains__) == {"b": 1, "c": 3}
    with pytest.raises(FileError, match=r"t.npz: two columns are called 'a'"):
        select(PATH, ["a", "b", "a"], "ab".__contains__)


def test_columns_are_of_one_length() -> None:
    require_equal_lengths(PATH, {})
    require_equal_lengths(PATH, {"a": 2, "b": 2})
    with pytest.raises(FileError, match=r"t.npz: columns differ in rows: 'a' 2 and 'b' 1"):
        require_equal_lengths(PATH, {"a": 2, "b": 1})


def test_what_a_file_says_is_cleaned_and_cut() -> None:
    assert shown("\x1b[31m") == r"'\x1b[31m'"
    assert len(shown("x" * 1000)) < 100


def test_an_array_with_two_dimensions_is_several_columns_unless_it_is_no_table() -> None:
    shapes = [(9, 3), (), (9,), (9, 1), (9, 0), (9, 10**6), (9, 2, 2)]
    arrays = [(f"a{index}", shape, index) for index, shape in enumerate(shapes)]
    parts = select_parts(PATH, arrays, lambda name: True)
    assert parts == {**{f"a0/{i}": (0, i) for i in range(3)}, **{f"a{i}": (i, 0) for i in range(1, 7)}}
    for shape in ((9, 3), (9,), (9, 1)):
        require_vector(PATH, "a", shape)
    require_vector(PATH, "a", (1, 10**6), row_vectors=True)
    for shape in ((), (9, 0), (1, 10**6), (9, 2, 2)):
        with pytest.raises(FileError, match=rf"column 'a' has the shape {re.escape(str(shape))}, not \(n,\)"):
            require_vector(PATH, "a", shape)
