"""The value of an expression, against an independent reading of it, and its unit."""

import math
import random
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mjrun.probe.assertion import parse
from mjrun.probe.expression import expression_unit
from mjrun.probe.metric import MetricEvaluator, parse_metric
from mjrun.probe.parser import LONGEST
from mjrun.probe.row_expression import parse_row_expression
from tests.cases import cases
from tests.probe.expression_oracle import COLUMNS, TABLES, TRUTHS, judged, truth, written


@given(TRUTHS, TABLES, st.randoms(use_true_random=False))
@settings(max_examples=30, deadline=None)
@pytest.mark.slow
def test_an_assertion_passes_where_an_oracle_finds_it_true_on_every_row(
    tree: Any, rows: list[Any], dice: random.Random
) -> None:
    text, table = written(tree, 0, dice), np.array(rows)
    assume(len(text) < LONGEST)
    with np.errstate(all="ignore"):
        expected = bool(truth(tree, table).all())
    verdict = judged(text, COLUMNS, table, list(range(len(rows))))
    assert (verdict.text, verdict.passed) == (text, expected), verdict.message


def test_the_oracles_own_precedence_is_pythons() -> None:
    dice = random.Random(1)
    leaf = [("number", 2.0), ("number", 7.0), ("number", 0.1)]
    for _ in range(300):
        tree: Any = dice.choice(leaf)
        for _ in range(4):
            pair = [tree, dice.choice(leaf)]
            dice.shuffle(pair)
            tree = dice.choice([("neg", tree), (dice.choice("+-*"), *pair), ("^", tree, ("number", 2.0))])
        text = written(tree, 0, dice)
        python = eval(text.replace("^", "**"), {"__builtins__": {}})
        assert judged(f"x == {text}", ["x"], [python]).passed


WIDE = np.random.default_rng(5).normal(size=(600, 9))
WIDE_NAMES = ["time", *(f"force/{i}" for i in range(8))]
FORCE = WIDE[:, 1:]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("norm('force/*')", np.sqrt((FORCE * FORCE).sum(axis=1))),
        ('sum(clip("force/*", -1, 1)^2)', np.sum(np.square(np.clip(FORCE, -1, 1)), axis=1)),
        ("max(abs('force/*'), 1)", np.maximum(np.abs(FORCE).max(axis=1), 1)),
        ("min(time, sum(force/0, force/1))", np.minimum(WIDE[:, 0], FORCE[:, 0] + FORCE[:, 1])),
        ("norm(time * 'force/*' - first(time))", np.linalg.norm(WIDE[:, :1] * FORCE - WIDE[0, 0], axis=1)),
        ("sum(where(time < 0, 'force/*', time))", np.where(WIDE[:, 0] < 0, FORCE.sum(axis=1), 8 * WIDE[:, 0])),
        ("clip(time, force/0, force/1)", np.clip(WIDE[:, 0], FORCE[:, 0], FORCE[:, 1])),
        ("tanh(time)", np.tanh(WIDE[:, 0])),
    ],
)
def test_functions_of_vectors_and_choices_are_numpys(text: str, expected: np.ndarray) -> None:
    values = parse_row_expression(text, WIDE_NAMES, "y").values(dict(zip(WIDE_NAMES, WIDE.T, strict=True)))
    np.testing.assert_allclose(values, expected, rtol=1e-15, atol=1e-15)
    total = MetricEvaluator([parse_metric(f"sum({text})", WIDE_NAMES, "metric")], WIDE_NAMES)
    total.feed(WIDE)
    assert total.values() == (math.fsum(values),)


def test_an_assertion_that_all_is_finite() -> None:
    assert judged("isfinite('force/*') and isfinite(max(time))", WIDE_NAMES, WIDE).passed
    spoiled = WIDE.copy()
    spoiled[7, 3] = math.nan
    assert "row 7" in judged("isfinite('force/*')", WIDE_NAMES, spoiled).message
    assert judged("not isfinite(force/2)", WIDE_NAMES, spoiled[7:8]).passed
    assert parse("sum('force/[12]?', 'f*/0') < 1", [*WIDE_NAMES, "force/10"]).columns == ("force/0", "force/10")


UNITS = {"time": "s", "a": "m", "b": "m", "v": "m/s", "n": ""}


@cases("text, unit")
def test_units_follow_from_columns(text: str, unit: str) -> None:
    assert expression_unit(parse_metric(text, list(UNITS), "metric").root, UNITS) == unit
