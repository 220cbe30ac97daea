"""Assertions about a table, such as `max(abs(energy/drift)) < 1e-3`: parsed whole, checked while rows stream by.

An assertion must hold on every row. A column has a value on each row; an aggregate has one value for the whole table,
the same on every row. So `abs(x) < 1` and `max(abs(x)) < 1` pass together, and differ in what a failure tells.

Grammar, from what binds loosest to what binds tightest::

    or                          row by row: `x < 1 or x > 2` holds if each row is on either side
    and
    not                         turns each comparison around: `not x < 1` is `x >= 1`, on every row
    < <= > >= == !=             chains as in mathematics, `0 < x < 1`; exact, `last(time) == 5` means this very float
    + -
    * /
    - +                         signs: `-2^2` is −4, `2^-1` is ½
    ^ **                        from the right: `2^3^2` is 2⁹; `x^2` is exactly `x*x`

Operands are numbers (`1e-3`, `.5`), `pi`, `inf`, columns, calls and parentheses.

    abs sqrt exp log sin cos tan (x)                one value per row from one per row
    min max (x, y, …)                               of several values: elementwise
    min max mean rms std sum first last count (x)   of one value: an aggregate over all rows

`std` is that of the whole population, `count` the number of rows. `first(x)` is known from the first row on, so it may
stand wherever a number may: `max(abs(x - first(x))) < 0.1`. Any other aggregate is known after the last row only: it
cannot be mixed with values per row in one comparison, nor stand inside another aggregate.

A column is called by its name. The longest known name at a place is taken: `a/b` is the column `a/b` where there is
one, and else `a` divided by `b`; `a / b` is a division always. A name with characters other than letters, digits,
`_ / : . -` and single inner spaces, or that is also a number or a keyword, is quoted, 'so' or `so`; a quote within is
doubled. Where it is known what model the table measures, `speed(box)` is the column `speed/box`, as in an event
(`mjrun.probe.event`).

NaN: no comparison with NaN holds, not even `!=`, nor under `not`; an aggregate of values among which is a NaN is NaN.
`abs(x) < inf` therefore says that x is finite.

Sums are exact: `sum`, `mean`, `rms` and `std` are the true value rounded once. Rows are evaluated in chunks of `CHUNK`
counted from the first, so a verdict does not depend on how the rows are split into blocks, to the last bit. Nothing
else is kept of them. An expression is read by this module alone and never reaches Python's own evaluation.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from mjrun.errors import clean, option
from mjrun.probe.aggregate import CHUNK, RowChunk, accumulator, shown
from mjrun.probe.expression import (
    START,
    AggregateCall,
    AggregateValues,
    AllRows,
    BooleanExpression,
    BooleanOperation,
    ColumnReference,
    Node,
    NumericExpression,
    evaluate,
    evaluate_truth,
    sides,
    walk,
)
from mjrun.probe.parser import Parser
from mjrun.probe.scanner import SourceText, Vocabulary


def evaluate_rows(value: NumericExpression, chunk: RowChunk, known: AggregateValues) -> np.ndarray:
    """The value on each row of `chunk`: `(n,)`."""
    return np.broadcast_to(evaluate(value, chunk.columns, known), chunk.count)


class RowCheck:
    """Where a truth fails first, what was compared there, and how often it fails."""

    def __init__(self, truth: BooleanExpression) -> None:
        self.truth, self.failures, self.place = truth, 0, ""
        self.found: dict[NumericExpression, float] = {}

    def add(self, chunk: RowChunk, known: AggregateValues) -> None:
        """Takes one chunk."""
        holds = evaluate_truth(self.truth, chunk.columns, known)
        failures = chunk.count - int(np.count_nonzero(holds))
        if failures and not self.failures:
            index = int(np.argmin(holds))
            self.place = chunk.place(index)
            self.found = {side: float(evaluate_rows(side, chunk, known)[index]) for side in sides(self.truth)}
        self.failures += failures


@dataclass(frozen=True)
class Verdict:
    """Whether the assertion `text` holds, and a `message` that says with which values and where."""

    text: str
    passed: bool
    message: str


@dataclass(frozen=True, eq=False)
class Assertion:
    """An assertion that is well formed.

    Attributes:
      text: as it was written.
      columns: the names that it reads, in the order of the table.
      table: all columns of the table.
    """

    text: str
    columns: tuple[str, ...]
    table: tuple[str, ...]
    _truth: BooleanExpression = field(repr=False)

    def checker(self) -> "AssertionChecker":
        """A new check, which has seen no row."""
        return AssertionChecker(self)


def parse(text: str, columns: Sequence[str] | Vocabulary) -> Assertion:
    """The assertion that `text` says about a table of `columns`, or of those that a vocabulary names.

    Raises:
      UnknownNameError: a name is that of no column or function; the message lists near and valid ones.
      UsageError: the text is none of the language; the message says where, what was found and what is valid.
    """
    vocabulary = columns if isinstance(columns, Vocabulary) else Vocabulary(columns)
    truth = Parser(SourceText(text, option("assert")), vocabulary).whole()
    read = {node.name for node in walk(truth) if isinstance(node, ColumnReference)}
    table = vocabulary.names
    return Assertion(text, tuple(name for name in dict.fromkeys(table) if name in read), table, truth)


class AssertionChecker:
    """One pass of an assertion over a table. What it keeps does not grow with the rows."""

    def __init__(self, assertion: Assertion) -> None:
        self._assertion, self._truth = assertion, assertion._truth
        table = assertion.table
        self._names = [name for name in dict.fromkeys(table) if name in {*assertion.columns, "time"}]
        self._indices = [table.index(name) for name in self._names]
        self._buffer = np.empty((len(self._names), CHUNK))
        self._first = self._count = self._waiting = 0  # rows evaluated and rows that wait, from the first on
        nodes = list(walk(self._truth))
        self._accumulators = {node: accumulator(node.name) for node in nodes if isinstance(node, AggregateCall)}
        self._row_checks = {node: RowCheck(node.truth) for node in nodes if isinstance(node, AllRows)}
        self._known: AggregateValues = {}  # known from the first row on
        self._values: AggregateValues = {}  # known after the last row
        self._is_one_subject = len({self._text(side) for side in sides(self._truth)}) == 1

    def feed(self, block: np.ndarray, first_row: int) -> None:
        """Takes the rows from `first_row` on: one column for each of the table's. The block may be used again.

        Raises:
          ValueError: the block has other columns, or does not follow the one before.
        """
        if block.ndim != 2 or block.shape[1] != len(self._assertion.table):
            raise ValueError(f"a block of shape {block.shape} for {len(self._assertion.table)} columns")
        seen = self._count + self._waiting
        self._first = self._first if seen else first_row
        if first_row != self._first + seen:
            raise ValueError(f"a block from row {first_row} after row {self._first + seen - 1}")
        start = 0
        while start < len(block):
            rows = block[start : start + CHUNK - self._waiting, self._indices]
            self._buffer[:, self._waiting : self._waiting + len(rows)] = rows.T
            self._waiting, start = self._waiting + len(rows), start + len(rows)
            if self._waiting == CHUNK:
                self._digest()

    def verdict(self) -> Verdict:
        """The outcome, after the last block. No rows at all is a failure."""
        self._digest()
        text = self._assertion.text
        if not self._count:
            return Verdict(text, False, f"{clean(text)}: there are no rows")
        with np.errstate(all="ignore"):
            self._values = {node: accumulator.value for node, accumulator in self._accumulators.items()}
            passed = self._passes(self._truth)
            sentences = dict.fromkeys(self._sentences(self._truth, passed))
        return Verdict(text, passed, f"{clean(text)}: {'; '.join(sentences)}")

    def _digest(self) -> None:
        """Evaluates the rows that wait."""
        if not self._waiting:
            return
        columns = {name: row[: self._waiting] for name, row in zip(self._names, self._buffer, strict=True)}
        chunk = RowChunk(columns, self._first + self._count, self._waiting)
        self._count, self._waiting = self._count + self._waiting, 0
        with np.errstate(all="ignore"):
            for node, accumulator in self._accumulators.items():
                accumulator.add(evaluate_rows(node.operand, chunk, self._known), chunk)
                self._known[node] = accumulator.value if node.kind == START else math.nan
            for check in self._row_checks.values():
                check.add(chunk, self._known)

    def _passes(self, truth: BooleanExpression) -> bool:
        match truth:
            case AllRows():
                return not self._row_checks[truth].failures
            case BooleanOperation(every=every, parts=parts):
                return (all if every else any)(map(self._passes, parts))
        return bool(evaluate_truth(truth, {}, self._values))

    def _sentences(self, truth: BooleanExpression, outcome: bool) -> Iterator[str]:
        """What decided: the parts whose outcome is that of the whole."""
        match truth:
            case BooleanOperation(parts=parts):
                for part in parts:
                    if self._passes(part) == outcome:
                        yield from self._sentences(part, outcome)
            case AllRows() if outcome:
                rows = f"all {self._count} rows" if self._count > 1 else "the only row"
                yield f"{'it' if truth is self._truth else self._text(truth)} holds on {rows}"
            case AllRows():
                yield self._failure(self._row_checks[truth])
            case _:
                yield from map(self._side, sides(truth))

    def _failure(self, check: RowCheck) -> str:
        """The first row where a truth fails, and what is compared there."""
        sides = dict.fromkeys(self._value_text(side, value) for side, value in check.found.items())
        more = f", the first of {check.failures} such rows" if check.failures > 1 else ""
        return ", ".join(sides) + check.place + more

    def _side(self, side: NumericExpression) -> str:
        """The value of one side of a comparison, and the rows that its aggregates come from."""
        sentence = self._value_text(side, float(evaluate(side, {}, self._values)))
        if isinstance(side, AggregateCall):
            return sentence + self._accumulators[side].place
        inner = [node for node in walk(side) if isinstance(node, AggregateCall)]
        aggregates = (f"{self._text(n)} is {shown(self._values[n])}{self._accumulators[n].place}" for n in inner)
        return f"{sentence} ({'; '.join(dict.fromkeys(aggregates))})"

    def _value_text(self, side: NumericExpression, value: float) -> str:
        subject = "it" if self._is_one_subject else self._text(side)
        return f"{subject} is {shown(value)}" + (" (no comparison with nan holds)" if math.isnan(value) else "")

    def _text(self, node: Node) -> str:
        return clean(self._assertion.text[node.start : node.end])
