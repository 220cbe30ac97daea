"""Options of disturbances as plain values; the three ways to write a push mean the same."""

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.errors import UsageError
from mjrun.options.evaluation import EvaluationOptions
from mjrun.options.schema_validation import InvalidValueError
from mjrun.options.simulation import NO_DISTURBANCES, Push, PushKind
from mjrun.simulation.simulation import Simulation
from tests.cases import cases


def test_no_noise_differs_from_noise_that_is_not_specified() -> None:
    assert Simulation("a.xml").disturbances == NO_DISTURBANCES
    assert Simulation("a.xml", ctrl_noise=0).disturbances.ctrl_noise == 0 != None
    (push,) = EvaluationOptions("t.yaml", "out", push="torso=1/2/3@0+1").disturbances.push
    assert (push.target, push.force) == ("torso", (1, 2, 3))


def test_a_negative_deviation_is_refused() -> None:
    with pytest.raises(UsageError, match="at least 0"):
        Simulation("a.xml", ctrl_noise=-1)


KIND = PushKind()
NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
TIMES = st.fractions(0, 10**6, max_denominator=10**6)


@pytest.mark.parametrize(
    ("text", "push"),
    [
        ("torso=0/100/0@1+0.2", Push("torso", (0, 100, 0), Fraction(1), Fraction(1, 5))),
        ("site:hand=-5/.5/1e3@0.5+1e-2", Push("site:hand", (-5, 0.5, 1000), Fraction(1, 2), Fraction(1, 100))),
        ("a=b@c=1/2/3@1e+1+1/3", Push("a=b@c", (1, 2, 3), Fraction(10), Fraction(1, 3))),
        ("körper +=1/2/3@0+1", Push("körper +", (1, 2, 3), Fraction(0), Fraction(1))),
    ],
)
def test_a_text_is_a_target_a_force_a_beginning_and_a_duration(text: str, push: Push) -> None:
    assert KIND(text) == KIND.parse(text) == push


@given(st.text(min_size=1).filter(str.strip).map(str.strip), st.tuples(NUMBERS, NUMBERS, NUMBERS), TIMES, TIMES)
def test_what_prints_is_parsed_as_the_same(
    name: str, force: tuple[float, float, float], at: Fraction, d: Fraction
) -> None:
    push = KIND(Push(name, force, at, d + Fraction(1, 7)))
    assert KIND.parse(str(KIND.plain(push))) == push


def test_a_mapping_says_the_same() -> None:
    facts = {"force": [0, 100, 0], "at": 1.0, "duration": 0.2}
    assert KIND({"body": "torso", **facts}) == KIND("body:torso=0/100/0@1+0.2")
    assert KIND({"site": "hand", **facts}) == KIND("site:hand=0/100/0@1+0.2")


@cases("value, expected")
def test_what_is_no_push_is_refused_with_what_is_missing(value: object, expected: str) -> None:
    with pytest.raises(InvalidValueError, match=expected):
        KIND(value)  # type: ignore[arg-type]
