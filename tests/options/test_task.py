"""The options of tasks take what documents and Python write, and refuse what cannot be."""

from fractions import Fraction

import pytest

from mjrun.options.kinds import AnyKind
from mjrun.options.schema_validation import InvalidValueError
from mjrun.options.task import Limits, RandomValue, Schedule, VectorOrKey


@pytest.mark.parametrize(
    ("kind", "value", "made", "plain"),
    [
        (Limits(), [-1, 1], ((-1.0,), (1.0,)), [-1.0, 1.0]),
        (Limits(), [[-1, -2], 3], ((-1.0, -2.0), (3.0,)), [[-1.0, -2.0], 3.0]),
        (VectorOrKey(), "home", "home", "home"),
        (VectorOrKey(), [1, 2], (1.0, 2.0), [1.0, 2.0]),
        (RandomValue(), {"uniform": [-1, 1]}, "uniform(-1, 1)", "uniform(-1, 1)"),
        (RandomValue(), 0.5, "0.5", "0.5"),
        (Schedule(), [[0, [1, 0]], [0.1, [0, 1]]], ((0, (1.0, 0.0)), (Fraction(1, 10), (0.0, 1.0))), None),
    ],
)
def test_a_kind_takes_what_documents_write(kind: AnyKind, value: object, made: object, plain: object) -> None:
    assert kind(value) == made
    assert kind(kind.plain(made)) == made
    assert plain is None or kind.plain(made) == plain


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        (Limits(), [1, -1]),
        (Limits(), [1]),
        (Limits(), "ab"),
        (Limits(), [[1, 2], [3, 4, 5]]),
        (VectorOrKey(), ""),
        (VectorOrKey(), [float("nan")]),
        (RandomValue(), {"from": 0, "to": 1}),
        (RandomValue(), [1, 2]),
        (Schedule(), []),
        (Schedule(), [[1, [0]]]),
        (Schedule(), [[0, [1]], [1, [1, 2]]]),
        (Schedule(), [[0, [1]], [0, [2]]]),
        (Schedule(), [3]),
    ],
)
def test_a_kind_refuses_what_cannot_be(kind: AnyKind, value: object) -> None:
    with pytest.raises(InvalidValueError):
        kind(value)
