"""Rows by time: which times and numbers are refused, and how gaps are filled."""

import numpy as np
import pytest

from mjrun.errors import FileError, UsageError
from mjrun.physics.timed_rows import TimedRows, require_times, without_gaps


@pytest.mark.parametrize(
    ("time", "message"),
    [
        ([], r"^t\.csv: has no rows$"),
        ([0, np.nan], r"^t\.csv, row 1: time is nan; it must be finite$"),
        ([-np.inf, 1], r"^t\.csv, row 0: time is -inf; it must be finite$"),
        (
            [0, 0.1, 0.1],
            r"^t\.csv, row 2: time 0\.1 follows 0\.1; times must ascend\nremove rows until .* the first row is row 0$",
        ),
        ([3, 2], r"^t\.csv, row 1: time 2 follows 3; times must ascend\n"),
        ([3, 2, 1, 0, 4], r"times must ascend \(also in 2 other rows\)\n"),
        ([1.7e9, 1.7e9 + 0.02, 1.7e9 + 0.01], r"row 2: time 1700000000\.01 follows 1700000000\.02; times"),
    ],
)
def test_times_that_are_none_are_refused_at_the_first_bad_row(time: list[float], message: str) -> None:
    with pytest.raises(UsageError if time else FileError, match=message):
        require_times(np.array(time), "t.csv")


def test_times_ascend_from_anywhere() -> None:
    require_times(np.array([5.0]), "t.csv")
    require_times(np.array([-1, -0.5, np.nextafter(-0.5, 1)]), "t.csv")


@pytest.mark.parametrize(
    ("time", "values", "message"),
    [
        ([1.0, 0], [0, 0], "row 1: time 0 follows 1; times must ascend"),
        ([0.5, 1], [0, 0], "begins at 0.5 s"),
        ([0, 1], [0, np.inf], "row 1: ctrl/g is inf"),
    ],
)
def test_rows_that_do_not_determine_every_step_are_refused(
    time: list[float], values: list[float], message: str
) -> None:
    with pytest.raises(UsageError, match=message):
        TimedRows(np.array(time), {"ctrl/m": np.zeros(2), "ctrl/g": np.array(values)}, "t.csv")


def test_gaps_are_filled_from_the_rows_around_them() -> None:
    time = np.array([0.0, 1, 3, 4, 6])
    values = np.array([np.nan, 2, np.nan, 8, np.nan])
    rows = np.array([1, 3])
    assert without_gaps(time, values, rows, linear=False).tolist() == [2, 2, 2, 8, 8]
    assert without_gaps(time, values, rows, linear=True).tolist() == [2, 2, 6, 8, 8]
    assert without_gaps(time, time, np.arange(5), linear=True) is time
