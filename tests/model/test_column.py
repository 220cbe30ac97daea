"""Theorems about columns: plain values that travel."""

import pickle
from dataclasses import FrozenInstanceError

import pytest

from mjrun.model.column import Column


def test_a_column_is_a_value() -> None:
    column = Column("qpos/knee", "rad", "position", "joint", 3)
    assert pickle.loads(pickle.dumps(column)) == column == Column("qpos/knee", "rad", "position", "joint", 3)
    with pytest.raises(FrozenInstanceError):
        column.unit = "m"  # type: ignore[misc]


def test_only_the_name_is_required() -> None:
    time = Column("time")
    assert (time.unit, time.kind, time.id, time.labels) == ("", "", -1, ())
