"""Theorems about assertions: what they say of a table, however it is split."""

import ast
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.errors import clean
from mjrun.probe import assertion
from mjrun.probe.assertion import Verdict, parse
from mjrun.probe.metric import CHUNK
from tests.cases import cases
from tests.probe.expression_oracle import COLUMNS, INF, NAN, judged

# --- what an assertion says ------------------------------------------------------------------------

TIMED = ["time", "x", "y"]
ROWS = [[0, 1, 4], [0.5, 3, -2], [1, 3, 0], [1.5, -2, 4]]


@cases("text, passed, told")
def test_a_verdict_says_whether_with_which_values_and_where(text: str, passed: bool, told: str | None) -> None:
    verdict = judged(text, TIMED, ROWS)
    assert (verdict.text, verdict.passed) == (text, passed)
    assert told is None or verdict.message == f"{clean(text)}: {told}"


@given(st.lists(st.integers(0, 3 * CHUNK), max_size=5), st.sampled_from([2.0, 5.0]))
@settings(deadline=None)
def test_a_verdict_counts_the_rows_that_each_alternative_decides_alone(cuts: list[int], end: float) -> None:
    time = np.linspace(0, end, 3 * CHUNK + 1)
    x, y = np.sin(3 * time), np.cos(5 * time)
    text = (
        "(time < 4 or x < 0.5 or not y < 0.9) and (x < 0.5 or y < 2) and sum(x, time >= 4) > -inf and share(x > 0) > 0"
    )
    verdict = judged(text, TIMED, np.stack([time, x, y], axis=1), cuts)
    early, low, high = time < 4, x < 0.5, y >= 0.9
    assert verdict.rows == len(time)
    assert [(each.part, each.rows) for each in verdict.decided] == [
        ("time < 4", np.sum(~low & ~high)),
        ("x < 0.5", np.sum(~early & ~high)),
        ("y < 0.9", np.sum(~early & ~low)),
        ("x < 0.5", np.sum(y >= 2)),
        ("y < 2", np.sum(~low)),
        ("sum(x, time >= 4)", np.sum(~early)),
    ]


def test_without_a_time_column_the_row_alone_is_reported_and_rows_count_from_the_first_that_was_fed() -> None:
    assert judged("max(x) < 2", ["x"], [1, 3]).message == "max(x) < 2: it is 3, at row 1"
    assert judged("max(x) < 2", ["x"], [1, 3], [1], first=10).message == "max(x) < 2: it is 3, at row 11"
    assert judged("x < 2", ["x"], [1]).message == "x < 2: it holds on the only row"


@pytest.mark.parametrize("text", ["x < 1", "count(x) == 0", "not max(x) < 1"])
def test_no_rows_at_all_is_a_failure(text: str) -> None:
    assert judged(text, ["x"], []) == Verdict(text, False, f"{text}: there are no rows", 0, [])
    checker = parse(text, ["x"]).checker()
    checker.feed(np.empty((0, 1)), 0)
    assert not checker.verdict().passed


def test_a_checker_is_fresh_and_a_verdict_may_be_asked_twice() -> None:
    parsed = parse("max(x) < 2", ["x"])
    first, second = parsed.checker(), parsed.checker()
    first.feed(np.array([[3.0]]), 0)
    second.feed(np.array([[1.0]]), 0)
    assert [first.verdict().passed, second.verdict().passed] == [False, True]
    assert first.verdict() == first.verdict()


def test_the_columns_of_an_assertion_are_those_it_reads_in_the_order_of_the_table() -> None:
    assert parse("max(c) < first(a) and c > 1", ["a", "b", "c", "time"]).columns == ("a", "c")


@pytest.mark.parametrize(("shape", "row"), [((2, 2), 3), ((2,), 3), ((2, 1), 2), ((2, 1), 4)])
def test_a_block_of_other_columns_or_out_of_order_is_a_bug_of_the_caller(shape: tuple[int, ...], row: int) -> None:
    checker = parse("x < 1", ["x"]).checker()
    checker.feed(np.zeros((3, 1)), 0)
    with pytest.raises(ValueError, match="block"):
        checker.feed(np.zeros(shape), row)


# --- any split of the table ------------------------------------------------------------------------

LONG = (
    np.random.default_rng(7).standard_normal((3 * CHUNK + 17, len(COLUMNS)))
    * np.logspace(-9, 9, 3 * CHUNK + 17)[:, None]
)
SPLIT = [
    "sum(x) < 0 and mean(x) < 0 and rms(x) < 0",
    "std(x) < 0 or sum(exp(x)) < 0 or sum(x^3) == 0 or mean(sin(time)) == 0",
    "max(x) < min(a/b) and last(x) < first(time)",
    "tan(x) * exp(-abs(x)) < .5",
    "abs(x - first(x)) < 1e9",
    "log(x) < 1 or x < -1e7",
]


@given(st.sampled_from(SPLIT), st.lists(st.integers(0, len(LONG)), max_size=12))
@settings(max_examples=50, deadline=None)
def test_a_verdict_does_not_depend_on_how_the_rows_are_split(text: str, cuts: list[int]) -> None:
    assert judged(text, COLUMNS, LONG, cuts) == judged(text, COLUMNS, LONG)


@pytest.mark.parametrize("text", SPLIT)
def test_rows_one_at_a_time_give_the_same_verdict_to_the_last_bit(text: str) -> None:
    assert judged(text, COLUMNS, LONG, list(range(len(LONG)))) == judged(text, COLUMNS, LONG)


@pytest.mark.parametrize("row", [0, CHUNK - 1, CHUNK, CHUNK + 1, 2 * CHUNK, 3 * CHUNK + 16])
def test_a_single_bad_row_is_found_wherever_it_is(row: int) -> None:
    for bad, shows in ((9.0, "9"), (NAN, "nan (no comparison with nan holds)"), (INF, "inf")):
        table = np.zeros(3 * CHUNK + 17)
        table[row] = bad
        for text in ("x < 1", "max(x) < 1"):
            assert judged(text, ["x"], table).message == f"{text}: it is {shows}, at row {row}"


def test_what_a_checker_keeps_does_not_grow() -> None:
    def size() -> int:
        accumulators = checker._aggregates._accumulators.values()
        state = [vars(g) for g in accumulators] + [vars(w) for w in checker._row_checks.values()]
        return checker._rows._buffer.nbytes + sum(len(str(value)) for kept in state for value in kept.values())

    checker, block = parse(f"{' and '.join(SPLIT[:1])} and x < 1", COLUMNS).checker(), np.ones((100 * CHUNK, 4))
    checker.feed(block, 0)
    before = size()
    checker.feed(block, len(block))
    assert size() <= before + 20


# --- trust -----------------------------------------------------------------------------------------


MODULES = (
    "assertion",
    "verdict",
    "metric",
    "row_expression",
    "expression",
    "parser",
    "scanner",
)


@pytest.mark.parametrize("module", MODULES)
def test_an_expression_never_reaches_pythons_own_evaluation(module: str) -> None:
    tree = ast.parse(Path(assertion.__file__).with_name(f"{module}.py").read_text("utf-8"))
    called = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    assert called.isdisjoint({"eval", "exec", "compile", "getattr", "setattr", "globals", "__import__", "open"})
    assert called.isdisjoint({"attrgetter", "methodcaller", "itemgetter"})
    imported = {a.name for node in ast.walk(tree) if isinstance(node, ast.Import) for a in node.names}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            modules = [f"{node.module}.{alias.name}" for alias in node.names]
            imported |= {*modules} if node.module == "mjrun.probe" else {str(node.module)}
    ours = {"mjrun.errors", "mjrun.dataclass"} | {f"mjrun.probe.{name}" for name in MODULES}
    assert (
        imported
        <= {
            "math",
            "re",
            "fnmatch",
            "functools",
            "numpy",
            "operator",
            "collections.abc",
            "mjrun.dataclass",
            "dataclasses",
            "fractions",
        }
        | {"typing"}
        | ours
    )
