"""The values of expressions on rows: a tree becomes a function once, which is called on each block of rows.

Aggregates may also be combined without rows: their values are Python's numbers. Columns that are adjacent in a matrix
have vectors that are parts of it; equal sums, norms and extremes of the columns of a matrix are computed once.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, lru_cache
from typing import Any

import numpy as np

from mjrun.probe import expression as tree

REMEMBERED = 1024  # expressions
OF_OTHER_ROWS = (tree.AggregateCall, tree.PreviousValue, tree.TextMatch)  # whose values are known beforehand


class ColumnLayout:
    """The places of columns in a matrix.

    Attributes:
      places: indices of the columns, by name.
      run: returns the slice of adjacent columns, given their names; None if they are not adjacent.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.places = {name: place for place, name in enumerate(names)}
        self.run = cache(self._run)

    def _run(self, names: tuple[str, ...]) -> slice | None:
        places = [self.places.get(name, -1) for name in names]
        run = slice(places[0], places[0] + len(names))
        return run if places == list(range(run.start, run.stop)) and run.start >= 0 else None


class ColumnMatrix(Mapping[str, Any]):
    """Columns of n rows, each `(n,)`, contiguous; and vectors of them.

    Args:
      layout: places of the columns in the matrix.
      matrix: `(n, columns)`.
      others: columns outside the matrix.

    Attributes:
      reduced: the values of reductions that have been computed, by their identity.
    """

    def __init__(self, layout: ColumnLayout, matrix: np.ndarray, others: Mapping[str, Any]) -> None:
        self._layout = layout
        self._matrix = matrix
        self._others = others
        self._columns = dict[str, Any](others)
        self.reduced = dict[object, Any]()

    def __getitem__(self, name: str) -> Any:
        column = self._columns.get(name)
        if column is None:
            column = self._columns[name] = np.ascontiguousarray(self._matrix[:, self._layout.places[name]])
        return column

    def __iter__(self) -> Iterator[str]:
        yield from self._layout.places
        yield from self._others

    def __len__(self) -> int:
        return len(self._layout.places) + len(self._others)

    def vector(self, names: tuple[str, ...]) -> np.ndarray:
        """Returns the columns `names` side by side, `(n, len(names))`; of adjacent columns a view of the matrix."""
        run = self._layout.run(names)
        if run is None:
            return np.stack([self[name] for name in names], axis=-1)
        return self._matrix[:, run]


Columns = Mapping[str, np.ndarray]
KnownValues = dict[tree.NumericExpression, Any]  # values of aggregates, previous values and matches, by node
Evaluation = Callable[[Columns, KnownValues], Any]


def evaluate(value: tree.NumericExpression, columns: Columns, known: KnownValues) -> Any:
    """Returns the value on each row of `columns`, or one for all; `known` has the values that other rows determine.

    Returns:
      A number, or one for each of n rows, `(n,)`; of a vector `(n, width)` in C order.
    """
    return evaluation(value)(columns, known)


def evaluate_truth(truth: tree.BooleanExpression, columns: Columns, known: KnownValues) -> Any:
    """Returns whether `truth` holds, row by row if it has rows."""
    return truth_evaluation(truth)(columns, known)


@lru_cache(REMEMBERED)
def evaluation(value: tree.NumericExpression) -> Evaluation:
    """Returns `evaluate` of one expression."""
    match value:
        case tree.NumberLiteral(value=number):
            return lambda columns, known: number
        case tree.ColumnReference(name=name):
            return lambda columns, known: columns[name]
        case tree.ColumnVector(names=names):
            return lambda columns, known: _vector(columns, names)
        case tree.AggregateCall() | tree.PreviousValue() | tree.TextMatch():
            return lambda columns, known: known[value]
        case tree.FunctionCall():
            return _call(value)
        case tree.RowwiseReduction():
            return _reduction(value)
        case tree.ConditionalValue(condition=condition, operands=operands):
            return _choice(truth_evaluation(condition), *_aligned(operands), is_vector=value.width > 0)
    raise TypeError(value)


@lru_cache(REMEMBERED)
def truth_evaluation(truth: tree.BooleanExpression) -> Evaluation:
    """Returns `evaluate_truth` of one condition."""
    match truth:
        case tree.Comparison(operator=operator, sides=sides):
            compare = tree.COMPARE[operator]
            left, right = map(evaluation, sides)
            return lambda columns, known: compare(left(columns, known), right(columns, known))
        case tree.BooleanOperation(every=every, parts=parts):
            first, *rest = map(truth_evaluation, parts)

            def operation(columns: Columns, known: KnownValues) -> Any:
                result = first(columns, known)
                for part in rest:
                    other = part(columns, known)
                    result = result & other if every else result | other
                return result

            return operation
    raise TypeError(truth)


@lru_cache(REMEMBERED)
def _identity(meaning: tuple[Any, ...]) -> object:
    """Returns an object for all expressions with a meaning, whose hash takes no time."""
    return object()


def _reduction(value: tree.RowwiseReduction) -> Evaluation:
    """Evaluates a reduction; that of a matrix once, however many expressions contain it."""
    function, numbers = tree.REDUCED[value.name], _side_by_side(value.operands)
    depends_on_known = any(isinstance(node, OF_OTHER_ROWS) for node in tree.walk(value))
    identity = None if depends_on_known else _identity(tree.meaning(value))

    def reduced(columns: Columns, known: KnownValues) -> Any:
        if identity is None or not isinstance(columns, ColumnMatrix):
            return function(numbers(columns, known), axis=-1)
        values = columns.reduced.get(identity)
        if values is None:
            values = columns.reduced[identity] = function(numbers(columns, known), axis=-1)
        return values

    return reduced


def _choice(holds: Evaluation, first: Evaluation, second: Evaluation, is_vector: bool) -> Evaluation:
    condition = _beside_vector(holds) if is_vector else holds
    return lambda columns, known: np.where(condition(columns, known), first(columns, known), second(columns, known))


def _call(call: tree.FunctionCall) -> Evaluation:
    first, *rest = _aligned(call.operands)
    if not rest:
        (function,) = call.functions
        return lambda columns, known: function(first(columns, known))
    steps = list(zip(call.functions, rest, strict=True))

    def folded(columns: Columns, known: KnownValues) -> Any:
        result = first(columns, known)
        for function, operand in steps:
            result = function(result, operand(columns, known))
        return result

    return folded


def _vector(columns: Columns, names: tuple[str, ...]) -> np.ndarray:
    if isinstance(columns, ColumnMatrix):
        return columns.vector(names)
    return np.stack([columns[name] for name in names], axis=-1)


def _aligned(operands: Sequence[tree.NumericExpression]) -> list[Evaluation]:
    """Returns the evaluations of `operands`; if one is a vector, numpy combines all of them row by row."""
    if not any(operand.width for operand in operands):
        return list(map(evaluation, operands))
    return [evaluation(each) if each.width else _beside_vector(evaluation(each)) for each in operands]


def _beside_vector(values_of: Evaluation) -> Evaluation:
    """Turns one value per row into a vector of one."""

    def beside(columns: Columns, known: KnownValues) -> Any:
        values = values_of(columns, known)
        return values[..., None] if isinstance(values, np.ndarray) and values.ndim else values

    return beside


def _side_by_side(operands: Sequence[tree.NumericExpression]) -> Evaluation:
    """Returns all numbers of `operands` on each row: `(n, k)` in C order, so that sums do not depend on n."""
    evaluations = list(map(evaluation, operands))
    if len(operands) == 1 and operands[0].width:
        (only,) = evaluations
        return lambda columns, known: np.ascontiguousarray(only(columns, known))
    widths = [operand.width for operand in operands]
    ends = np.cumsum([max(width, 1) for width in widths]).tolist()
    places = [end - 1 if not width else slice(end - width, end) for end, width in zip(ends, widths, strict=True)]

    several = [width > 0 for width in widths]

    def side_by_side(columns: Columns, known: KnownValues) -> np.ndarray:
        values = [each(columns, known) for each in evaluations]
        rows = ()
        for value, is_vector in zip(values, several, strict=True):
            if isinstance(value, np.ndarray) and value.ndim > is_vector:
                rows = value.shape[:1]
                break
        numbers = np.empty((*rows, ends[-1]))
        for place, value in zip(places, values, strict=True):
            numbers[..., place] = value
        return numbers

    return side_by_side
