"""Grids of settings: values, points, overrides."""

import pytest

from mjrun.errors import UsageError
from mjrun.sim.parameter_grid import points, scan_values, settings


@pytest.mark.parametrize(
    ("text", "expected"),
    [("a,b", ["a", "b"]), (" 1 , 2 ", ["1", "2"]), ("0,0,1;0,0,2", ["0,0,1", "0,0,2"]), ("a", ["a"])],
)
def test_values_of_a_scan_are_separated_by_commas_or_semicolons(text: str, expected: list[str]) -> None:
    assert scan_values("opt.x", text) == expected


@pytest.mark.parametrize("text", ["", "a,,b", "a,a", ";"])
def test_a_scan_without_values_or_with_one_twice_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="scan opt"):
        scan_values("opt.x", text)


def test_without_a_scan_there_is_one_point() -> None:
    assert list(points({})) == [{}]
    assert [setting.path for setting in settings({"timestep": "1", "opt.cone": "x"})] == ["opt.timestep", "opt.cone"]
