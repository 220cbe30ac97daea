"""What all readers of tables check."""

from pathlib import Path

import pytest

from mjrun.errors import FileError
from mjrun.formats.column_checks import column_names, require_equal_lengths, select, shown, unreadable

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
    assert unreadable(Path("A.NPZ")) == "cannot be read as .npz"


def test_an_array_with_two_dimensions_is_several_columns_unless_it_is_no_table() -> None:
    assert column_names("qpos", (9, 3)) == ["qpos/0", "qpos/1", "qpos/2"]
    for shape in ((), (9,), (9, 1), (9, 0), (9, 10**6), (9, 2, 2)):
        assert column_names("qpos", shape) == ["qpos"]
