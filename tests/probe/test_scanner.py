"""Names in an expression: which one is read, and how a name is spelled."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.errors import UsageError
from mjrun.probe.assertion import parse
from mjrun.probe.scanner import is_bare, spelled
from tests.probe.expression_oracle import judged

NAMES = ["a", "b", "a/b", "a-b", "qpos/hip", "qpos/hip/x", "joint:3", "left foot/x", "v1.2", "a[0]", "it's", "x`y", "1"]
NAMES += ["max", "pi", "not", "or else", "é/ß", "e1"]


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        ("a/b < 1", ("a/b",)),
        ("a / b < 1", ("a", "b")),
        ("(a)/b < 1", ("a", "b")),
        ("a/'b' < 1", ("a", "b")),
        ("a-b < 1", ("a-b",)),
        ("a -b < 1", ("a", "b")),
        ("b/a < 1", ("a", "b")),
        ("b-1 < 1", ("b",)),
        ("qpos/hip/x < 1", ("qpos/hip/x",)),
        ("qpos/hip/a < 1", ("a", "qpos/hip")),
        ("qpos/hip/2 < 1", ("qpos/hip",)),
        ("joint:3 < 1", ("joint:3",)),
        ("left foot/x < 1", ("left foot/x",)),
        ("v1.2<1", ("v1.2",)),
        ("'a[0]' < 1", ("a[0]",)),
        ("'it''s' < 1", ("it's",)),
        ("`it's` < 1", ("it's",)),
        ("`x``y` < 1", ("x`y",)),
        ("'1' < 1", ("1",)),
        ("max < 1", ("max",)),
        ("max(max) < max (a, 1)", None),
        ("max(max) < 1", ("max",)),
        ("pi < 1", ("pi",)),
        ("not 'not' < 1", ("not",)),
        ("'or else' < 1 or b < 1", ("b", "or else")),
        ("é/ß < 1", ("é/ß",)),
        ("2*e1 < 2e1", ("e1",)),
    ],
)
def test_the_longest_known_name_is_read_and_division_otherwise(text: str, columns: tuple[str, ...] | None) -> None:
    if columns is None:
        with pytest.raises(UsageError, match="an aggregate next to values per row"):
            parse(text, NAMES)
    else:
        assert parse(text, NAMES).columns == columns


@given(st.lists(st.text(min_size=1, max_size=8), min_size=1, max_size=5, unique=True))
@settings(max_examples=100, deadline=None)
def test_every_name_can_be_spelled_whatever_its_neighbours(columns: list[str]) -> None:
    for index, name in enumerate(columns):
        row = np.zeros((1, len(columns)))
        row[0, index] = 3
        assert judged(f"{spelled(name)} == 3", columns, row).passed
        assert not is_bare(name) or spelled(name) == name
