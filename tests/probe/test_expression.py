"""The value of an expression, against an independent reading of it."""

import random
from typing import Any

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mjrun.probe.parser import LONGEST
from tests.probe.expression_oracle import COLUMNS, TABLES, TRUTHS, judged, truth, written


@given(TRUTHS, TABLES, st.randoms(use_true_random=False))
@settings(max_examples=600, deadline=None)
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
