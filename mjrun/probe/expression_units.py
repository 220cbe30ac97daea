"""The unit of an expression, as far as it follows from those of its columns."""

from collections.abc import Mapping, Sequence

import numpy as np

from mjrun.probe import expression as tree

ANY = None  # of a number in the text, which takes the unit of what it is added to or compared with
KEEPING = {tree.ARITHMETIC["+"], tree.ARITHMETIC["-"], abs, np.minimum, np.maximum}


def expression_unit(root: tree.NumericExpression, units: Mapping[str, str]) -> str:
    """Returns the unit of an expression; empty where it is a pure number, mixed or changed by a factor.

    Args:
      units: the units of columns, by name.
    """
    return _unit(root, units) or ""


def _unit(node: tree.Node, units: Mapping[str, str]) -> str | None:
    match node:
        case tree.NumberLiteral():
            return ANY
        case tree.ColumnReference(name=name):
            return units.get(name, "")
        case tree.ColumnVector(names=names):
            return _common([units.get(name, "") for name in names])
        case tree.FunctionCall(functions=functions, operands=operands) if KEEPING.issuperset(functions):
            return _common([_unit(operand, units) for operand in operands])
        case tree.Reduction(operands=operands) | tree.Choice(operands=operands):
            return _common([_unit(operand, units) for operand in operands])
        case tree.AggregateCall(name=name, operand=operand):
            return "" if name in tree.OF_CONDITIONS else _unit(operand, units)
        case tree.PreviousValue(operand=operand):
            return _unit(operand, units)
        case _:
            return ""


def _common(units: Sequence[str | None]) -> str | None:
    """Returns the unit that all have, empty if they differ."""
    different = {unit for unit in units if unit is not ANY}
    if len(different) > 1:
        return ""
    return different.pop() if different else ANY
