"""Times of rows."""

import numpy as np
import pytest

from mjrun.errors import UsageError
from mjrun.physics.table_times import require_times


@pytest.mark.parametrize(
    ("time", "message"),
    [
        ([], r"^t\.csv has no rows$"),
        ([0, np.nan], r"^t\.csv, row 1: time is nan, and must be finite$"),
        ([-np.inf, 1], r"^t\.csv, row 0: time is -inf, and must be finite$"),
        ([0, 0.1, 0.1], r"^t\.csv, row 2: time 0\.1 follows 0\.1, and must grow$"),
        ([3, 2], r"^t\.csv, row 1: time 2 follows 3, and must grow$"),
    ],
)
def test_times_that_are_none_are_refused_at_the_first_bad_row(time: list[float], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        require_times(np.array(time), "t.csv")


def test_times_ascend_from_anywhere() -> None:
    require_times(np.array([5.0]), "t.csv")
    require_times(np.array([-1, -0.5, np.nextafter(-0.5, 1)]), "t.csv")
