"""Grids of settings: values, points, overrides."""

import pytest

from mjrun.errors import UsageError
from mjrun.physics.parameter_grid import points, scan_values, settings


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


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0.1..1:10", ["0.1", "0.2", "0.3", "0.4", "0.5", "0.6", "0.7", "0.8", "0.9", "1"]),
        ("-1..1:3", ["-1", "0", "1"]),
        (".1...5:3", ["0.1", "0.3", "0.5"]),
        ("1..40:40", [str(seed) for seed in range(1, 41)]),
        ("0..1:3,7", ["0", "0.5", "1", "7"]),
        ("log:1e-4..1e-1:4", ["0.0001", "0.001", "0.01", "0.1"]),
        ("log:1..2:3", ["1", repr(2**0.5), "2"]),
        ("..", [".."]),
    ],
)
def test_a_span_is_spelled_out(text: str, expected: list[str]) -> None:
    assert scan_values("opt.x", text) == expected


@pytest.mark.parametrize("text", ["a..b:3", "0..1:1", "1..1:3", "0..1:x", "log:0..1:3", "0..1:2000000", "0..1:3,1"])
def test_a_span_that_has_no_values_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="vary opt"):
        scan_values("opt.x", text, "vary")


def test_without_a_scan_there_is_one_point() -> None:
    assert list(points({})) == [{}]
    assert [setting.path for setting in settings({"timestep": "1", "opt.cone": "x"})] == ["opt.timestep", "opt.cone"]
