"""Assertions about a table, such as `max(abs(energy/drift)) < 1e-3`: parsed at once, checked on streamed rows.

An assertion must hold on every row. A column has a value on each row; an aggregate has one value for the whole table,
the same on every row. So `abs(x) < 1` and `max(abs(x)) < 1` pass together, and their failures report different things.

Grammar, by precedence, lowest first::

    or                          row by row: `x < 1 or x > 2` holds if each row is on either side
    and
    not                         turns each comparison around: `not x < 1` is `x >= 1`, on every row
    < <= > >= == !=             chains as in mathematics, `0 < x < 1`; exact, `last(time) == 5` means this very float
    + -
    * /
    - +                         signs: `-2^2` is −4, `2^-1` is ½
    ^ **                        from the right: `2^3^2` is 2⁹; `x^2` is exactly `x*x`

Operands are numbers (`1e-3`, `.5`), `pi`, `inf`, columns, calls and parentheses.

    abs sqrt exp log sin cos tan tanh (x)           one value per row from one per row
    min max sum norm (x, y, …)                      of several values, row by row; norm is √(x² + y² + …)
    clip (x, low, high)                             x, but at least low and at most high
    where (condition, x, y)                         x on rows where the condition holds, else y
    isfinite (x)                                    a comparison: x is neither infinite nor NaN
    min max mean rms std sum first last count median (x)     of one value: an aggregate over all rows
    quantile (x, fraction)                          the value below which a fraction of all rows lies
    mean (x, condition), …                          any of them over the rows on which a condition holds
    count share (condition)                         number and share of the rows on which it holds

`std` is the standard deviation of the whole population, `count` the number of rows. `first(x)` is known from the first
row on, and may replace any number: `max(abs(x - first(x))) < 0.1`. Any other aggregate is known after the last row
only: it cannot be mixed with values per row in one comparison, nor be an operand of another aggregate.

A column is referred to by its name. The longest known name at a place is used: `a/b` is the column `a/b` if it exists,
and otherwise `a` divided by `b`; `a / b` is always a division. A name with characters other than letters, digits,
`_ / : . -` and single inner spaces, or that is also a number or a keyword, is quoted, 'so' or `so` or "so"; a quote in
it is doubled. If the model of the table is known, `speed(box)` is the column `speed/box`, as in a condition
(`mjrun.probe.row_expression`).

A quoted name with wildcards, "cfrc_ext/*", is a vector: all matching columns, in the order of the table. Elementwise
operations apply to its numbers one by one, together with single values and with vectors of the same length; `norm`,
`sum`, `min` and `max` reduce it to one value per row: `max(norm("qvel/*"))` is the largest norm on any row.

NaN: no comparison with NaN holds, not even `!=`, nor under `not`; an aggregate of values among which is a NaN is NaN.
`abs(x) < inf` therefore means that x is finite, like `isfinite(x)`; `not isfinite(x)` holds for NaN.

`first(time, x > 1)` is the time at which x exceeds 1 for the first time, NaN if it never does. A quantile is
interpolated linearly, as numpy does it.

Sums are exact: `sum`, `mean`, `rms` and `std` are the true value rounded once. Rows are evaluated in chunks of `CHUNK`
counted from the first, so that a verdict does not depend on how the rows are split into blocks, to the last bit. Only
the values of a quantile are stored. Expressions are evaluated by this package, and never by Python itself.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import field

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import clean, concerning, option
from mjrun.probe import expression as tree
from mjrun.probe.expression import KnownValues, evaluate, evaluate_truth
from mjrun.probe.metric import AggregateEvaluator, ChunkBuffer, RowChunk, evaluate_rows, shown
from mjrun.probe.parser import Parser
from mjrun.probe.scanner import Vocabulary
from mjrun.probe.verdict import PartRowCount, Verdict


class _DecidedRowCounter:
    """A counter of the rows on which each part of an `or` decides, since all other parts fail there."""

    def __init__(self, operation: tree.BooleanOperation) -> None:
        self._operation = operation
        self._decided = [0] * len(operation.parts)

    @property
    def parts(self) -> list[tuple[tree.BooleanExpression, int]]:
        """Each part, and the number of rows that it decides."""
        return list(zip(self._operation.parts, self._decided, strict=True))

    def add(self, chunk: RowChunk, known: KnownValues) -> None:
        """Adds one chunk."""
        truths = [evaluate_truth(part, chunk.columns, known) for part in self._operation.parts]
        holds = np.stack([np.broadcast_to(truth, chunk.count) for truth in truths])
        others = holds.sum(axis=0) - holds
        for index, count in enumerate((others == 0).sum(axis=1).tolist()):
            self._decided[index] += count


class _FailingRowCounter:
    """A counter of the rows on which a truth fails, with the first one and the values compared there."""

    def __init__(self, truth: tree.BooleanExpression) -> None:
        self.truth = truth
        self.failures = 0
        self.place = ""
        self.time: float | None = None
        self.compared: dict[tree.NumericExpression, float] = {}
        self.alternatives = [_DecidedRowCounter(operation) for operation in _alternatives(truth)]

    def add(self, chunk: RowChunk, known: KnownValues) -> None:
        """Adds one chunk."""
        holds = evaluate_truth(self.truth, chunk.columns, known)
        failures = chunk.count - int(np.count_nonzero(holds))
        if failures and not self.failures:
            index = int(np.argmin(holds))
            self.place = chunk.place(index)
            _, self.time = chunk.row(index)
            self.compared = {side: float(evaluate_rows(side, chunk, known)[index]) for side in tree.sides(self.truth)}
        self.failures += failures
        for alternatives in self.alternatives:
            alternatives.add(chunk, known)


@dataclass(frozen=True, eq=False)
class Assertion:
    """A valid assertion.

    Attributes:
      text: text as written.
      columns: names of the columns that it reads, in the order of the table.
      table: names of all columns of the table.
    """

    text: str
    columns: tuple[str, ...]
    table: tuple[str, ...]
    _truth: tree.BooleanExpression = field(repr=False)

    def checker(self) -> "AssertionChecker":
        """Returns a new check, to which no rows were added yet."""
        return AssertionChecker(self)


def parse(text: str, columns: Sequence[str] | Vocabulary, name: str = "assert") -> Assertion:
    """Parses an assertion about a table of `columns`, or of those that a vocabulary names.

    Args:
      name: name of the option that it comes from.

    Raises:
      UnknownNameError: a column or function is unknown; the message lists near and valid ones.
      UsageError: the text is invalid; the message states where, what was found and what is valid.
    """
    parser = Parser(text, option(name), columns)
    truth, table = parser.assertion(), parser.vocabulary.names
    read = {*tree.columns_read(truth)}
    return Assertion(text, tuple(name for name in dict.fromkeys(table) if name in read), table, truth)


def parse_all(texts: Sequence[str], columns: Sequence[str] | Vocabulary) -> list[Assertion]:
    """Parses the assertions of the option `assert`; errors state which."""
    assertions: list[Assertion] = []
    for index, text in enumerate(texts):
        with concerning("assert", index):
            assertions.append(parse(text, columns))
    return assertions


class AssertionChecker:
    """A checker of an assertion in one pass over a table, in memory that does not grow with the rows."""

    def __init__(self, assertion: Assertion) -> None:
        self._assertion, self._truth = assertion, assertion._truth
        self._rows = ChunkBuffer(assertion.table, assertion.columns)
        nodes = list(tree.walk(self._truth))
        self._aggregates = AggregateEvaluator([node for node in nodes if isinstance(node, tree.AggregateCall)])
        self._row_checks = {
            node: _FailingRowCounter(node.truth) for node in nodes if isinstance(node, tree.HoldsOnEveryRow)
        }
        self._values: KnownValues = {}  # known after the last row
        self._is_one_subject = len({self._text(side) for side in tree.sides(self._truth)}) == 1

    def feed(self, block: np.ndarray, first_row: int) -> None:
        """Adds the rows from `first_row` on: one column for each of the table's. The block may be reused.

        Raises:
          ValueError: the block has other columns, or does not follow the one before.
        """
        for chunk in self._rows.feed(block, first_row):
            self._digest(chunk)

    def verdict(self) -> Verdict:
        """Returns the outcome, after the last block. A table without rows is a failure."""
        for chunk in self._rows.rest():
            self._digest(chunk)
        text = self._assertion.text
        if not self._rows.seen:
            return Verdict(text, False, f"{clean(text)}: there are no rows", 0, self._decided)
        with np.errstate(all="ignore"):
            self._values = self._aggregates.values()
            passed = self._passes(self._truth)
            sentences = dict.fromkeys(self._sentences(self._truth, passed))
        return Verdict(text, passed, f"{clean(text)}: {'; '.join(sentences)}", self._rows.seen, self._decided)

    @property
    def first_failure(self) -> float | None:
        """The time of the first row on which a decisive part fails; None if it passes or only aggregates decide.

        It is known after `verdict`, for a table with a column `time`.
        """
        return min(self._failures(self._truth), default=None)

    @property
    def _decided(self) -> list[PartRowCount]:
        """The number of rows that each alternative decides, and that each aggregate with a condition uses."""
        parts = [part for check in self._row_checks.values() for each in check.alternatives for part in each.parts]
        calls = [(call, rows) for call, rows in self._aggregates.rows.items() if call.name not in tree.OF_CONDITIONS]
        return [PartRowCount(self._text(node), rows) for node, rows in (*parts, *calls)]

    def _digest(self, chunk: RowChunk) -> None:
        with np.errstate(all="ignore"):
            self._aggregates.add(chunk)
            for check in self._row_checks.values():
                check.add(chunk, self._aggregates.known)

    def _passes(self, truth: tree.BooleanExpression) -> bool:
        match truth:
            case tree.HoldsOnEveryRow():
                return not self._row_checks[truth].failures
            case tree.BooleanOperation(every=every, parts=parts):
                return (all if every else any)(map(self._passes, parts))
        return bool(evaluate_truth(truth, {}, self._values))

    def _failures(self, truth: tree.BooleanExpression) -> Iterator[float]:
        """Yields the time of the first failure of each decisive part of a truth that fails."""
        match truth:
            case _ if self._passes(truth):
                return
            case tree.HoldsOnEveryRow():
                time = self._row_checks[truth].time
                if time is not None:
                    yield time
            case tree.BooleanOperation(parts=parts):
                for part in parts:
                    yield from self._failures(part)
            case _:
                return

    def _sentences(self, truth: tree.BooleanExpression, outcome: bool) -> Iterator[str]:
        """Yields a sentence for each decisive part, whose outcome is that of the whole."""
        match truth:
            case tree.BooleanOperation(parts=parts):
                for part in parts:
                    if self._passes(part) == outcome:
                        yield from self._sentences(part, outcome)
            case tree.HoldsOnEveryRow() if outcome:
                rows = f"all {self._rows.seen} rows" if self._rows.seen > 1 else "the only row"
                subject = "it" if truth is self._truth else self._text(truth)
                alternatives = [part for each in self._row_checks[truth].alternatives for part in each.parts]
                counts = [f"on {count or 'none'} by {self._text(part)} alone" for part, count in alternatives]
                yield f"{subject} holds on {rows}" + (f": {', '.join(counts)}" if counts else "")
            case tree.HoldsOnEveryRow():
                yield self._failure(self._row_checks[truth])
            case _:
                yield from map(self._side, tree.sides(truth))

    def _failure(self, check: _FailingRowCounter) -> str:
        """Returns the first row on which a truth fails, and the values compared there."""
        sides = dict.fromkeys(self._value_text(side, value) for side, value in check.compared.items())
        more = f", the first of {check.failures} such rows" if check.failures > 1 else ""
        return ", ".join(sides) + check.place + more

    def _side(self, side: tree.NumericExpression) -> str:
        """Returns the value of one side of a comparison, and the rows of its aggregates."""
        sentence = self._value_text(side, float(evaluate(side, {}, self._values)))
        if isinstance(side, tree.AggregateCall):
            return sentence + self._origin(side)
        calls = [node for node in tree.walk(side) if isinstance(node, tree.AggregateCall)]
        aggregates = (f"{self._text(call)} is {shown(self._values[call])}{self._origin(call)}" for call in calls)
        return f"{sentence} ({'; '.join(dict.fromkeys(aggregates))})"

    def _origin(self, call: tree.AggregateCall) -> str:
        """Returns the row that decides the value of an aggregate, and its number of rows if it has a condition."""
        rows = self._aggregates.rows.get(call)
        is_counted = rows is None or call.name in tree.OF_CONDITIONS
        return self._aggregates.place(call) + ("" if is_counted else f", of {rows} of {self._rows.seen} rows")

    def _value_text(self, side: tree.NumericExpression, value: float) -> str:
        subject = "it" if self._is_one_subject else self._text(side)
        return f"{subject} is {shown(value)}" + (" (no comparison with nan holds)" if math.isnan(value) else "")

    def _text(self, node: tree.Node) -> str:
        return clean(self._assertion.text[node.start : node.end])


def _alternatives(truth: tree.BooleanExpression) -> Iterator[tree.BooleanOperation]:
    """Yields each `or` in a truth of one row."""
    if isinstance(truth, tree.BooleanOperation):
        if not truth.every:
            yield truth
        for part in truth.parts:
            yield from _alternatives(part)
