"""Conditions on the rows of a table."""

import numpy as np
import pytest

from mjrun.errors import UnknownNameError, UsageError
from mjrun.probe.row_condition import parse_row_condition

ROWS = {
    "time": np.array([0.0, 1, 2]),
    "contact/ball/floor": np.array([0.0, 2, np.nan]),
    "xpos/top/z": np.array([3.0, 2, 1]),
}


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("time > 0.5", [False, True, True]),
        ("contact(ball, floor)", [False, True, False]),
        ("not contact(ball, floor)", [True, False, False]),
        ("xpos(top).z < 3 and time < 2", [False, True, False]),
        ("contact/ball/floor > 0 or time == 2", [False, True, True]),
    ],
)
def test_a_condition_holds_row_by_row(text: str, holds: list[bool]) -> None:
    assert parse_row_condition(text, list(ROWS), "when").holds(ROWS).tolist() == holds


def test_a_condition_knows_what_it_reads() -> None:
    assert parse_row_condition("xpos(top).z < time", list(ROWS), "when").columns == ("xpos/top/z", "time")


@pytest.mark.parametrize(
    ("text", "kind", "message"),
    [
        ("contact(ball, wall)", UnknownNameError, "no column 'contact/ball/wall'"),
        ("time", UsageError, "found a number, expected a comparison"),
        ("max(time) > 3", UsageError, "over all instants"),
        ("1 < 2", UsageError, "numbers only"),
    ],
)
def test_what_is_no_condition_is_refused(text: str, kind: type, message: str) -> None:
    with pytest.raises(kind, match=message):
        parse_row_condition(text, list(ROWS), "when")
