"""The options of tasks take what documents and Python write, and refuse what cannot be."""

from fractions import Fraction

import pytest

from mjrun.options.kinds import AnyKind
from mjrun.options.schema_validation import InvalidValueError
from mjrun.options.task import LimitsKind, RandomValueKind, ScheduleKind, VectorOrKeyframeKind


@pytest.mark.parametrize(
    ("kind", "value", "made", "plain"),
    [
        (LimitsKind(), [-1, 1], ((-1.0,), (1.0,)), [-1.0, 1.0]),
        (LimitsKind(), [[-1, -2], 3], ((-1.0, -2.0), (3.0,)), [[-1.0, -2.0], 3.0]),
        (VectorOrKeyframeKind(), "home", "home", "home"),
        (VectorOrKeyframeKind(), [1, 2], (1.0, 2.0), [1.0, 2.0]),
        (RandomValueKind(), {"uniform": [-1, 1]}, "uniform(-1, 1)", "uniform(-1, 1)"),
        (RandomValueKind(), 0.5, "0.5", "0.5"),
        (ScheduleKind(), [[0, [1, 0]], [0.1, [0, 1]]], ((0, (1.0, 0.0)), (Fraction(1, 10), (0.0, 1.0))), None),
    ],
)
def test_a_kind_takes_what_documents_write(kind: AnyKind, value: object, made: object, plain: object) -> None:
    assert kind(value) == made
    assert kind(kind.plain(made)) == made
    assert plain is None or kind.plain(made) == plain


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        (LimitsKind(), [1, -1]),
        (LimitsKind(), [1]),
        (LimitsKind(), "ab"),
        (LimitsKind(), [[1, 2], [3, 4, 5]]),
        (VectorOrKeyframeKind(), ""),
        (VectorOrKeyframeKind(), [float("nan")]),
        (RandomValueKind(), {"from": 0, "to": 1}),
        (RandomValueKind(), [1, 2]),
        (ScheduleKind(), []),
        (ScheduleKind(), [[1, [0]]]),
        (ScheduleKind(), [[0, [1]], [1, [1, 2]]]),
        (ScheduleKind(), [[0, [1]], [0, [2]]]),
        (ScheduleKind(), [3]),
    ],
)
def test_a_kind_refuses_what_cannot_be(kind: AnyKind, value: object) -> None:
    with pytest.raises(InvalidValueError):
        kind(value)
