"""Expressions with a value per row, against numpy."""

import numpy as np
import pytest

from mjrun.errors import UnknownNameError, UsageError
from mjrun.probe.row_expression import parse_row_expression

RNG = np.random.default_rng(3)
TABLE = {"t": np.linspace(0.0, 1.0, 50), "knee_deg": RNG.normal(size=50), "qpos/root/x": RNG.normal(size=50)}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("t", TABLE["t"]),
        ("knee_deg*pi/180", TABLE["knee_deg"] * np.pi / 180),
        ("-qpos/root/x ^ 2 + 1", -(TABLE["qpos/root/x"] ** 2) + 1),
        ("max(t, knee_deg, 0)", np.maximum(np.maximum(TABLE["t"], TABLE["knee_deg"]), 0)),
        ("knee_deg - first(knee_deg)", TABLE["knee_deg"] - TABLE["knee_deg"][0]),
        ("3", np.full(50, 3.0)),
    ],
)
def test_the_values_are_numpys(text: str, expected: np.ndarray) -> None:
    expression = parse_row_expression(text, list(TABLE), "map")
    np.testing.assert_array_equal(expression.values(TABLE), expected)


@pytest.mark.parametrize("sizes", [(50,), (1, 49), (0, 7, 43)])
def test_values_do_not_depend_on_the_blocks(sizes: tuple[int, ...]) -> None:
    expression = parse_row_expression("knee_deg / t - first(qpos/root/x)", list(TABLE), "map")
    evaluator, values, start = expression.evaluator(), [], 0
    for size in sizes:
        values.append(evaluator.feed({name: column[start : start + size] for name, column in TABLE.items()}))
        start += size
    with np.errstate(divide="ignore"):
        expected = TABLE["knee_deg"] / TABLE["t"] - TABLE["qpos/root/x"][0]
    np.testing.assert_array_equal(np.concatenate(values), expected)


def test_the_columns_are_those_that_are_read_in_the_order_of_the_text() -> None:
    assert parse_row_expression("knee_deg + t*knee_deg", list(TABLE), "map").columns == ("knee_deg", "t")
    assert parse_row_expression("1", list(TABLE), "map").columns == ()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("max(t)", "map, character 1: found max over all rows, expected values per row, or first"),
        ("t < 1", "map, character 1: found a comparison, expected a number"),
        ("t 1", "map, character 3: found '1', expected an operator or the end"),
        ("", "map, character 1: found the end"),
    ],
)
def test_what_has_no_value_per_row_is_refused(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        parse_row_expression(text, list(TABLE), "map")


def test_an_unknown_column_is_named_with_those_there_are() -> None:
    with pytest.raises(UnknownNameError, match="knee_deg"):
        parse_row_expression("knee_dg", list(TABLE), "map")
