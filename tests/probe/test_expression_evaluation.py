"""Expressions on rows are numpy's own, and one row gets the same bits as many."""

import numpy as np
import pytest

from mjrun.probe.expression import ColumnLayout, ColumnMatrix, evaluate, evaluate_truth, evaluation
from mjrun.probe.parser import Parser
from mjrun.probe.scanner import Vocabulary

NAMES = ["a", "b", "v/0", "v/1", "v/2"]
TABLE = np.random.default_rng(3).normal(size=(40, 5))
COLUMNS = dict(zip(NAMES, np.ascontiguousarray(TABLE.T), strict=True))
A, B, V = COLUMNS["a"], COLUMNS["b"], TABLE[:, 2:]


def parser(text: str) -> Parser:
    return Parser(text, "text", Vocabulary(NAMES))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("2", 2.0),
        ("a - b - 3", A - B - 3),
        ("norm(a)", np.abs(A)),
        ("exp(-norm(a, b, 2))", np.exp(-np.sqrt(A * A + B * B + 4))),
        ("sum('v/*' * a)", (V * A[:, None]).sum(axis=1)),
        ("norm('v/*', a, 1)", np.sqrt((V * V).sum(axis=1) + A * A + 1)),
        ("max(clip('v/*', -b, 1))", np.minimum(np.maximum(V, -B[:, None]), 1).max(axis=1)),
        ("sum(where(a > 0 and b < 1, 'v/*', 0))", np.where(((A > 0) & (B < 1))[:, None], V, 0).sum(axis=1)),
        ("norm(3, 4)", 5.0),
    ],
)
def test_values_are_numpys_whatever_holds_the_columns(text: str, expected: np.ndarray | float) -> None:
    value = parser(text).row_value()
    matrix = ColumnMatrix(ColumnLayout(NAMES), TABLE, {})
    np.testing.assert_allclose(evaluate(value, COLUMNS, {}), expected, rtol=1e-14)
    np.testing.assert_array_equal(evaluate(value, matrix, {}), evaluate(value, COLUMNS, {}))
    ready = evaluation(value)
    whole = np.broadcast_to(ready(COLUMNS, {}), 40)
    for row in (0, 7, 39):
        one = {name: values[row : row + 1] for name, values in COLUMNS.items()}
        np.testing.assert_array_equal(np.broadcast_to(ready(one, {}), 1), whole[row : row + 1])


class CountingMatrix(ColumnMatrix):
    """Columns that count the reads of vectors."""

    reads = 0

    def vector(self, names: tuple[str, ...]) -> np.ndarray:
        self.reads += 1
        return super().vector(names)


def test_equal_reductions_of_a_matrix_are_computed_once() -> None:
    matrix = CountingMatrix(ColumnLayout(NAMES), TABLE, {})
    texts = {
        "where(isfinite('v/*'), 1, 0)": (np.ones(40), 1),
        "max(abs('v/*')) + a": (np.abs(V).max(axis=1) + A, 1),
        "sum('v/*' * 0)": ((V * 0.0).sum(axis=1), 2),
        "max(abs('v/*')) - 1": (np.abs(V).max(axis=1) - 1, 2),
        "max('v/*' * 0)": ((V * 0.0).max(axis=1), 3),
        "max('v/*' * -0)": ((V * -0.0).max(axis=1), 4),
    }
    for text, (expected, reads) in texts.items():
        values = evaluate(parser(text).row_value(), matrix, {})
        assert (values.tobytes(), matrix.reads) == (expected.tobytes(), reads), text


def test_conditions_are_numpys() -> None:
    truth = parser("not (a > 0 or b < 0) and isfinite('v/*')").condition()
    np.testing.assert_array_equal(evaluate_truth(truth, COLUMNS, {}), ~((A > 0) | (B < 0)))


@pytest.mark.parametrize("width", [1, 2, 7, 8, 9, 16, 17, 84, 129, 300])
def test_a_row_alone_gets_the_bits_that_it_gets_among_others(width: int) -> None:
    names = [f"v/{i}" for i in range(width)]
    table = np.random.default_rng(width).normal(size=(20, width)) * 10.0 ** np.arange(-9, 11)[:, None]
    layout = ColumnLayout(names)
    for text in (
        "sum('v/*')",
        "norm('v/*', 2)",
        "sum('v/*'^2) + max('v/*', 0)",
        "sum(where(v/0 > 0, 'v/*' / v/0, -1))",
    ):
        value = Parser(text, "text", Vocabulary(names)).row_value()
        whole = evaluate(value, ColumnMatrix(layout, table, {}), {})
        alone = [evaluate(value, ColumnMatrix(layout, row[None], {}), {}) for row in table]
        np.testing.assert_array_equal(np.concatenate(alone), whole)


MATRIX = np.random.default_rng(0).normal(size=(5, 6))[:, :4]
BY_NAME = {**dict(zip("abcd", MATRIX.T, strict=True)), "time": np.arange(5.0)}
MADE = ColumnMatrix(ColumnLayout("abcd"), MATRIX, {"time": BY_NAME["time"]})


def test_it_is_a_mapping_of_contiguous_columns() -> None:
    assert list(MADE) == list(BY_NAME)
    assert len(MADE) == 5
    for name, values in BY_NAME.items():
        np.testing.assert_array_equal(MADE[name], values)
        assert MADE[name].flags.c_contiguous
    with pytest.raises(KeyError):
        MADE["e"]


@pytest.mark.parametrize("names", [("b", "c"), ("a", "b", "c", "d"), ("c", "b"), ("a", "c"), ("d", "time"), ("time",)])
def test_vectors_have_their_columns_in_order(names: tuple[str, ...]) -> None:
    vector = MADE.vector(names)
    np.testing.assert_array_equal(vector, np.stack([BY_NAME[name] for name in names], axis=-1))
