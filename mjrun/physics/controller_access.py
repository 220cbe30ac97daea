"""The fields of MjData that a controller uses, as far as its bytecode proves them.

A controller that uses `data` only for attributes, as in `data.ctrl[:] = -data.qvel`, can work on the data of the
simulation. Any other use, such as a call with `data` as an argument, may read or change every field.
"""

import dis
from collections.abc import Callable
from types import CodeType, FunctionType, MethodType
from typing import Any

EVERYTHING = ("locals", "vars", "eval", "exec", "globals")  # functions that reach local variables without their names


def used_fields(function: Callable[..., Any]) -> frozenset[str] | None:
    """Returns the attributes of its argument `data` that `function(model, data)` uses; None if it may use others."""
    function = getattr(function, "forwards_to", function)
    if isinstance(function, MethodType):
        code, first = _code(function.__func__), 1
    elif isinstance(function, FunctionType):
        code, first = _code(function), 0
    else:
        code, first = _code(vars(type(function)).get("__call__")), 1
    if code is None or code.co_argcount < first + 2:
        return None
    return _attributes(code, code.co_varnames[first + 1])


def _code(function: object) -> CodeType | None:
    return function.__code__ if isinstance(function, FunctionType) else None


def _attributes(code: CodeType, variable: str) -> frozenset[str] | None:
    """Returns the attributes of a local variable that `code` uses; None if it uses the variable in another way."""
    if variable in code.co_cellvars or any(name in EVERYTHING for name in code.co_names):
        return None
    attributes = set[str]()
    instructions = [each for each in dis.get_instructions(code) if each.opname not in ("CACHE", "EXTENDED_ARG")]
    for instruction, following in zip(instructions, [*instructions[1:], None], strict=True):
        names = _local_variables(instruction)
        if variable not in names:
            continue
        is_last_loaded = instruction.opname.startswith("LOAD_FAST") and names.index(variable) == len(names) - 1
        if not (is_last_loaded and following and following.opname in ("LOAD_ATTR", "LOAD_METHOD", "STORE_ATTR")):
            return None
        attributes.add(str(following.argval))
    return frozenset(attributes)


def _local_variables(instruction: dis.Instruction) -> tuple[str, ...]:
    """Returns the local variables that an instruction uses; other names are of globals and attributes."""
    if "_FAST" not in instruction.opname and instruction.opcode not in {*dis.haslocal, *dis.hasfree}:
        return ()
    if isinstance(instruction.argval, str):
        return (instruction.argval,)
    return tuple(map(str, instruction.argval))  # of several instructions in one
