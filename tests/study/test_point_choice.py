"""Which points are kept, against pandas."""

from typing import Any

import numpy as np
import pandas as pd
import pytest

from mjrun.errors import BadValueError, UnknownNameError, UsageError
from mjrun.options.keep import KeepOptions
from mjrun.study.point_choice import PointChoice

RNG = np.random.default_rng(2)
COLUMNS = {"geom/box.mass": RNG.random(40), "drift": RNG.permutation(40).astype(float)}
COLUMNS["drift"][:3] = np.nan
STATUS = ["unstable"] * 3 + ["ok"] * 37
ABLE = np.arange(40) != 1
FRAME: Any = pd.DataFrame(COLUMNS).assign(status=STATUS)[ABLE]


def points(**options: object) -> list[int]:
    kept = KeepOptions(keep=("trace",), **options)  # type: ignore[arg-type]
    return PointChoice(kept, ["geom/box.mass", "model"], ["drift"]).points(COLUMNS, STATUS, ABLE)


def test_points_are_chosen_by_conditions_that_all_hold() -> None:
    assert points() == FRAME.index.tolist()
    assert points(keep_where=("unstable",)) == [0, 2]
    chosen = FRAME[(FRAME["drift"] > 10) & (FRAME["geom/box.mass"] < 0.5)].index.tolist()
    assert points(keep_where=("drift > 10", "mass < 0.5")) == chosen
    assert points(keep_where=("unstable or drift > 37",)) == [0, 2, *FRAME[FRAME["drift"] > 37].index]


def test_points_are_chosen_by_the_ends_of_a_metric_within_the_conditions() -> None:
    light = FRAME[FRAME["geom/box.mass"] < 0.5]
    ends = {*light["drift"].nsmallest(3).index, *light["drift"].nlargest(2).index}
    assert points(keep_where=("mass < 0.5",), keep_lowest=("3:drift",), keep_highest=("2:drift",)) == sorted(ends)
    assert points(keep_lowest=("1000:drift",)) == FRAME["drift"].dropna().index.tolist()


def test_what_is_wrong_is_told_before_the_study() -> None:
    with pytest.raises(UnknownNameError, match="drft"):
        points(keep_where=("drft > 1",))
    with pytest.raises(UnknownNameError, match="metric"):
        points(keep_lowest=("3:mass",))
    with pytest.raises(BadValueError, match="4:drift"):
        points(keep_highest=("drift",))
    with pytest.raises(UsageError, match="not numbers"):
        points(keep_where=("model > 1",))
    with pytest.raises(UsageError, match="nothing is kept"):
        PointChoice(KeepOptions(keep_where=("unstable",)), [], [])
