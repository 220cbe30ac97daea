"""Expressions compiled to Python: a program is a function with one line for each value that several of them need.

Common parts of the expressions are computed once. No text of a document gets into the source: names and functions are
passed as objects.
"""

from collections.abc import Callable
from math import isfinite
from typing import Any

import numpy as np

from mjrun.probe.expression import (
    ARITHMETIC,
    FINITE,
    NOT_FINITE,
    REDUCED,
    BooleanExpression,
    BooleanOperation,
    ColumnReference,
    ColumnVector,
    Comparison,
    ConditionalValue,
    FunctionCall,
    Node,
    NumberLiteral,
    NumericExpression,
    PreviousValue,
    RowwiseReduction,
    columns_read,
)
from mjrun.probe.expression_evaluation import vector_of


class ExpressionProgram:
    """The source of a function, built line by line."""

    def __init__(self) -> None:
        self._lines: list[str] = []
        self._variables: dict[str, str] = {}  # by their assigned source
        self._objects: dict[str, Any] = {}

    def add(self, line: str) -> None:
        """Adds a line of source."""
        self._lines.append(line)

    def function(self, parameters: str, result: str) -> Callable[..., Any]:
        """Compiles the function that returns `result`."""
        source = "\n    ".join([f"def program({parameters}):", *self._lines, f"return {result}"])
        namespace = {**self._objects}
        exec(compile(source, "<expressions of a task>", "exec"), namespace)
        return namespace["program"]

    def _assigned(self, text: str) -> str:
        """Returns the variable with the value of the source `text`."""
        if text not in self._variables:
            self._variables[text] = variable = f"v{len(self._variables)}"
            self.add(f"{variable} = {text}")
        return self._variables[text]

    def _object(self, thing: Any) -> str:
        """Returns the name of an object that has no source."""
        for name, known in self._objects.items():
            if known is thing:
                return name
        name = f"o{len(self._objects)}"
        self._objects[name] = thing
        return name


# Operators that are those of Python's numbers and of arrays.
OPERATORS = {ARITHMETIC["+"]: "+", ARITHMETIC["-"]: "-", ARITHMETIC["*"]: "*", np.add: "+"}


class WorldsProgram(ExpressionProgram):
    """A function of the columns of `count` worlds `rows`, whose numbers are bit for bit those of `evaluation`.

    It must be called within `np.errstate(all="ignore")`.

    Args:
      is_first: whether the function is for the first control instant of episodes.
    """

    def __init__(self, is_first: bool) -> None:
        super().__init__()
        self._is_first = is_first
        self._previous: dict[PreviousValue, str] = {}

    def remember(self, node: PreviousValue, memory: np.ndarray) -> None:
        """Adds the lines that read the previous value from the memory of all worlds, and store the present one."""
        now, stored = self._number(node.operand), f"{self._object(memory)}[rows]"
        self._previous[node] = now if self._is_first else self._assigned(f"{stored}.copy()")
        self.add(f"{stored} = {now}")

    def value(self, root: Node) -> str:
        """Adds the lines of an expression; returns the variable of its values `(count,)`."""
        is_truth = isinstance(root, BooleanExpression)
        value = self._truth(root) if is_truth else self._number(root)
        if columns_read(root):
            return value
        return self._assigned(f"{self._object(np.full)}(count, {value}, {'bool' if is_truth else 'float'})")

    def _number(self, node: NumericExpression) -> str:
        match node:
            case NumberLiteral(value=number):
                return f"({number!r})" if isfinite(number) else self._object(number)
            case ColumnReference(name=name):
                return self._assigned(f"columns[{self._object(name)}]")
            case ColumnVector(names=names):
                return self._called(vector_of, "columns", self._object(names))
            case PreviousValue():
                return self._previous[node]
            case FunctionCall(operands=operands):
                return self._call(node, [self._aligned(operand, node.width) for operand in operands])
            case RowwiseReduction(name=name, operands=operands):
                return self._called(REDUCED[name], self._side_by_side(operands), "-1")
            case ConditionalValue(condition=condition, operands=operands):
                choices = [self._aligned(operand, node.width) for operand in operands]
                return self._called(np.where, self._aligned(condition, node.width), *choices)
        raise TypeError(node)

    def _truth(self, node: BooleanExpression) -> str:
        match node:
            case Comparison(operator=operator, sides=(value, _)) if operator in (FINITE, NOT_FINITE):
                finite = self._called(np.isfinite, self._number(value))
                return finite if operator == FINITE else self._assigned(f"~{finite}")
            case Comparison(operator=operator, sides=sides):
                left, right = map(self._number, sides)
                unequal = f"({left} < {right}) | ({left} > {right})"  # false for NaN
                return self._assigned(unequal if operator == "!=" else f"{left} {operator} {right}")
            case BooleanOperation(every=every, parts=parts):
                return self._assigned((" & " if every else " | ").join(map(self._truth, parts)))
        raise TypeError(node)

    def _aligned(self, node: Node, width: int) -> str:
        """Returns the variable of an operand; beside vectors, one value per world becomes a vector of one."""
        value = self._truth(node) if isinstance(node, BooleanExpression) else self._number(node)
        is_vector = isinstance(node, NumericExpression) and node.width > 0
        return value if is_vector or not width or not columns_read(node) else self._assigned(f"{value}[:, None]")

    def _call(self, call: FunctionCall, values: list[str]) -> str:
        result, *others = values
        if not others:
            return self._called(call.functions[0], result)
        for function, other, operand in zip(call.functions, others, call.operands[1:], strict=True):
            number = operand.value if isinstance(operand, NumberLiteral) else None
            if function in OPERATORS:
                result = self._assigned(f"{result} {OPERATORS[function]} {other}")
            elif function is ARITHMETIC["/"] and number:
                result = self._assigned(f"{result} / {other}")
            elif function is ARITHMETIC["^"] and number == 2:
                result = self._assigned(f"{result} * {result}")
            else:
                result = self._called(function, result, other)
        return result

    def _side_by_side(self, operands: tuple[NumericExpression, ...]) -> str:
        """Returns the variable of all numbers of the operands of each world `(count, k)`, in C order."""
        values = [self._number(operand) for operand in operands]
        if len(operands) == 1 and operands[0].width:
            return self._called(np.ascontiguousarray, values[0])
        places, start = list[slice | int](), 0
        for operand in operands:
            stop = start + max(operand.width, 1)
            places.append(slice(start, stop) if operand.width else start)
            start = stop
        return self._called(_joined, "count", str(start), self._object(places), f"({', '.join(values)},)")

    def _called(self, function: Callable[..., Any], *arguments: str) -> str:
        """Returns the variable with the result of a function."""
        return self._assigned(f"{self._object(function)}({', '.join(arguments)})")


def _joined(count: int, width: int, places: list[slice | int], values: tuple[Any, ...]) -> np.ndarray:
    """Returns a matrix `(count, width)` with the values at these places."""
    numbers = np.empty((count, width))
    for place, value in zip(places, values, strict=True):
        numbers[:, place] = value
    return numbers
