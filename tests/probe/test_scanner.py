"""Names in an expression: which one is read, and how a name is spelled."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.errors import UsageError
from mjrun.probe.assertion import parse
from mjrun.probe.scanner import is_bare, spelled
from tests.cases import cases
from tests.probe.expression_oracle import judged

NAMES = ["a", "b", "a/b", "a-b", "qpos/hip", "qpos/hip/x", "joint:3", "left foot/x", "v1.2", "a[0]", "it's", "x`y", "1"]
NAMES += ["max", "pi", "not", "or else", "é/ß", "e1"]


@cases("text, columns")
def test_the_longest_known_name_is_read_and_division_otherwise(text: str, columns: tuple[str, ...] | None) -> None:
    if columns is None:
        with pytest.raises(UsageError, match="an aggregate next to values per row"):
            parse(text, NAMES)
    else:
        assert [*parse(text, NAMES).columns] == columns


@given(st.lists(st.text(min_size=1, max_size=8), min_size=1, max_size=5, unique=True))
@settings(max_examples=100, deadline=None)
def test_every_name_can_be_spelled_whatever_its_neighbours(columns: list[str]) -> None:
    for index, name in enumerate(columns):
        row = np.zeros((1, len(columns)))
        row[0, index] = 3
        assert judged(f"{spelled(name)} == 3", columns, row).passed
        assert not is_bare(name) or spelled(name) == name
