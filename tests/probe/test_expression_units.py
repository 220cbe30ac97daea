"""The unit of an expression follows from those of its columns, and is left out where it does not."""

import pytest

from mjrun.probe.expression import expression_unit
from mjrun.probe.metric import parse_metric

UNITS = {"time": "s", "a": "m", "b": "m", "v": "m/s", "n": ""}


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("last(a)", "m"),
        ("max(abs(a - b))", "m"),
        ("abs(last(a) - first(b)) + 0.5", "m"),
        ("first(time, a > 0.3)", "s"),
        ("quantile(v, 0.9)", "m/s"),
        ("rms(norm(a, b))", "m"),
        ("max(clip(a, 0, b))", "m"),
        ("mean(where(v > 1, a, 0))", "m"),
        ("count(a > 0)", ""),
        ("share(a > 0)", ""),
        ("max(a * 1000)", ""),  # which may be millimetres
        ("max(a / b)", ""),
        ("last(a) + last(v)", ""),
        ("max(sqrt(a))", ""),
        ("max(n)", ""),
    ],
)
def test_units_follow_from_columns(text: str, unit: str) -> None:
    assert expression_unit(parse_metric(text, list(UNITS), "metric").root, UNITS) == unit
