"""The unit of an expression follows from those of its columns, and is left out where it does not."""

from mjrun.probe.expression import expression_unit
from mjrun.probe.metric import parse_metric
from tests.cases import cases

UNITS = {"time": "s", "a": "m", "b": "m", "v": "m/s", "n": ""}


@cases("text, unit")
def test_units_follow_from_columns(text: str, unit: str) -> None:
    assert expression_unit(parse_metric(text, list(UNITS), "metric").root, UNITS) == unit
