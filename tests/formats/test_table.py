"""Tables in memory."""

import numpy as np
import pytest

import mjrun
from mjrun.errors import UnknownNameError

TABLE = mjrun.Table({"time": np.arange(3.0), "qpos/knee": np.ones(3)}, {"qpos/knee": "rad", "other": "m"})


def test_columns_are_found_by_name_in_their_order() -> None:
    assert TABLE["time"].tolist() == [0, 1, 2]
    assert TABLE.names == list(TABLE) == ["time", "qpos/knee"]
    assert len(TABLE) == 2
    assert "time" in TABLE
    assert "other" not in TABLE


def test_every_column_has_a_unit_and_nothing_else_has() -> None:
    assert TABLE.units == {"time": "", "qpos/knee": "rad"}


def test_a_column_that_is_missing_is_told_with_those_there_are() -> None:
    with pytest.raises(UnknownNameError, match=r"no column 'qpos/kne' \(did you mean 'qpos/knee'\?\)\ncolumns: time, "):
        _ = TABLE["qpos/kne"]
