"""The fields of MjData that a controller uses, as far as its bytecode proves them.

A controller that uses `data` only for attributes, as in `data.ctrl[:] = -data.qvel`, can work on the data of the
simulation. So can the functions of Python that it passes `data` on to, its own methods, and a few functions of MuJoCo.
Any other use, such as keeping `data`, may read or change every field.
"""

import dis
import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import CodeType, FunctionType, MethodType, ModuleType
from typing import Any, NamedTuple

import mujoco

from mjrun.dataclass import dataclass

EVERYTHING = ("locals", "vars", "eval", "exec", "globals")  # functions that reach local variables without their names
PAUSING = inspect.CO_GENERATOR | inspect.CO_COROUTINE | inspect.CO_ASYNC_GENERATOR
# Functions of MuJoCo that read what belongs to positions and velocities, and write nothing into an MjData.
READERS = {
    *("mj_fullM", "mj_jac", "mj_jacBody", "mj_jacBodyCom", "mj_jacDot", "mj_jacGeom", "mj_jacPointAxis", "mj_jacSite"),
    *("mj_jacSubtreeCom", "mj_mulM", "mj_mulM2", "mj_objectVelocity", "mj_solveM", "mj_solveM2"),
}
# Methods of MjData that find an object by name, and how the fields begin that the object's attributes are parts of.
VIEWS = {
    "body": "",
    "joint": "",
    "geom": "geom_",
    "site": "site_",
    "camera": "cam_",
    "tendon": "ten_",
    "actuator": "actuator_",
    "sensor": "sensor",
}
NO_EFFECT = ("CACHE", "EXTENDED_ARG", "NOP", "PRECALL", "RESUME")
OPERANDS = {"BINARY_OP": 2, "BINARY_SUBSCR": 2, "COMPARE_OP": 2, "UNARY_NEGATIVE": 1}
ASSIGNMENTS = ("STORE_GLOBAL", "STORE_ATTR", "DELETE_GLOBAL", "DELETE_ATTR")


class _Namespace(NamedTuple):
    """The global names of a function."""

    names: Mapping[str, object]


class _Path(NamedTuple):
    """The names through which a function finds another: `mujoco.mj_jac` from its global names, or `self.act`."""

    root: object
    names: tuple[str, ...] = ()

    def find(self) -> object:
        """Returns the function or module that it leads to; None for anything else."""
        value = self.root
        for name in self.names:
            match value:
                case _Namespace():
                    value = value.names.get(name)
                case ModuleType():
                    value = getattr(value, name, None)
                case _:
                    value = _method(value, name)
        return value


@dataclass(frozen=True)
class FieldsUsedByController:
    """The fields of `data` that a controller uses, itself or in functions that it passes `data` on to.

    Attributes:
      fields: the fields.
      called: these functions, and where it finds them.
    """

    fields: frozenset[str]
    called: Sequence[tuple[_Path, object]] = ()

    @property
    def holds(self) -> bool:
        """True as long as none of the functions is replaced."""
        return not self.called or all(function == path.find() for path, function in self.called)


def access_of(controller: Callable[..., Any]) -> FieldsUsedByController | None:
    """Returns the fields of `data` that `controller(model, data)` uses; None if it may use others."""
    function = getattr(controller, "forwards_to", controller)
    if not isinstance(function, FunctionType | MethodType):
        function = _method(function, "__call__")
    examination = _Examination()
    if not examination.proves(function, 1):
        return None
    return FieldsUsedByController(frozenset(examination.fields), examination.called)


class _Examination:
    """An examination of a controller and of the functions that it passes `data` on to; see `FieldsUsedByController`."""

    def __init__(self) -> None:
        self.fields = set[str]()
        self.called: list[tuple[_Path, object]] = []
        self._examined = set[tuple[FunctionType, int, int]]()
        self._assigned: dict[int, set[str]] = {}

    def assigned(self, names: Mapping[str, object]) -> set[str]:
        """Returns the global names and attributes that functions of the module with these global names assign."""
        if id(names) not in self._assigned:
            self._assigned[id(names)] = _assigned(names)
        return self._assigned[id(names)]

    def proves(self, function: object, index: int) -> bool:
        """Examines a function whose argument number `index` is `data`; returns whether it uses only known fields."""
        if getattr(function, "__module__", "") == mujoco.mj_forward.__module__:
            return getattr(function, "__name__", "") in READERS
        owner = None
        if isinstance(function, MethodType):
            function, owner, index = function.__func__, function.__self__, index + 1
        if not isinstance(function, FunctionType) or index >= function.__code__.co_argcount:
            return False
        if (function, id(owner), index) in self._examined:
            return True
        self._examined.add((function, id(owner), index))
        code = function.__code__
        reaches_all = code.co_flags & PAUSING or any(name in EVERYTHING for name in code.co_names)
        return not reaches_all and _Run(self, function, owner, code.co_varnames[index]).follows()


class _DataOnStack:
    """`data` on the stack of a function."""


class _View(_DataOnStack):
    """A method of `data` on the stack, or the object that it returns: `data.body`, `data.body("hand")`."""

    def __init__(self, prefix: str) -> None:
        self.prefix = prefix


class _Run:
    """The instructions of a function, followed one by one while `data` is on the stack.

    The stack has a `_DataOnStack` for `data`, a `_Path` to what can be looked up, and None for any other value. Values
    below the first are not known.
    """

    def __init__(self, examination: _Examination, function: FunctionType, owner: object, variable: str) -> None:
        self._examination, self._variable = examination, variable
        self._code, self._globals, self._owner = function.__code__, function.__globals__, owner
        self._constant = {variable} if owner is None else {variable, function.__code__.co_varnames[0]}
        self._stack: list[_DataOnStack | _Path | None] = []

    def follows(self) -> bool:
        """Returns whether all uses of `data` are known."""
        if self._variable in self._code.co_cellvars:
            return False
        return all(self._follow(each) for each in dis.get_instructions(self._code) if each.opname not in NO_EFFECT)

    def _follow(self, instruction: dis.Instruction) -> bool:
        if instruction.is_jump_target and not self._forget():
            return False
        name, argument, stack = instruction.opname, instruction.argval, self._stack
        effect = dis.stack_effect(instruction.opcode, instruction.arg, jump=False)
        variables = _local_variables(instruction)
        if name == "STORE_FAST_LOAD_FAST":
            is_known = not isinstance(self._pop(), _DataOnStack)
            stack.append(self._local(variables[1]))
            return is_known and variables[0] not in self._constant
        if name.startswith("LOAD_FAST"):
            stack += map(self._local, variables)
            return True
        if name == "LOAD_GLOBAL":
            stack += [_Path(_Namespace(self._globals), (argument,)), *[None] * (effect - 1)]
            if instruction.argrepr.startswith("NULL"):  # below, up to Python 3.12
                stack.append(stack.pop(-2))
            return True
        if name in ("LOAD_ATTR", "LOAD_METHOD"):
            stack += [self._attribute(self._pop(), argument), *[None] * effect]
            return True
        if name == "STORE_ATTR":
            self._attribute(self._pop(), argument)
            return not isinstance(self._pop(), _DataOnStack)
        if name == "CALL":
            return self._call(argument)
        if name in OPERANDS:
            operands = [self._pop() for _ in range(OPERANDS[name])]
            stack.append(None)
            return not any(isinstance(operand, _DataOnStack) for operand in operands)
        if effect == 1 and name.startswith(("LOAD_", "PUSH_NULL")):
            stack.append(None)
            return True
        return self._forget() and self._constant.isdisjoint(variables)

    def _forget(self) -> bool:
        """Forgets what is on the stack; returns whether `data` was not there."""
        is_known = not any(isinstance(value, _DataOnStack) for value in self._stack)
        self._stack.clear()
        return is_known

    def _pop(self) -> _DataOnStack | _Path | None:
        return self._stack.pop() if self._stack else None

    def _call(self, count: int) -> bool:
        """Follows a call with `count` arguments."""
        arguments = [self._pop() for _ in range(count)][::-1]
        callee = [value for value in (self._pop(), self._pop()) if value is not None]
        indices = [index for index, value in enumerate(arguments) if isinstance(value, _DataOnStack)]
        if callee and isinstance(callee[0], _View) and not indices:
            self._stack.append(callee[0])
            return True
        self._stack.append(None)
        if not indices:
            return not any(isinstance(value, _DataOnStack) for value in callee)
        if len(callee) != 1 or not isinstance(path := callee[0], _Path):
            return False
        if any(isinstance(arguments[index], _View) for index in indices):
            return False
        if not self._examination.assigned(self._globals).isdisjoint(path.names):
            return False  # another function may be there by then
        function = path.find()
        self._examination.called.append((path, function))
        return all(self._examination.proves(function, index) for index in indices)

    def _local(self, variable: str) -> _DataOnStack | _Path | None:
        if variable == self._variable:
            return _DataOnStack()
        is_owner = self._owner is not None and variable == self._code.co_varnames[0]
        return _Path(self._owner) if is_owner else None

    def _attribute(self, value: _DataOnStack | _Path | None, name: str) -> _DataOnStack | _Path | None:
        """Returns the attribute of a value; notes it if the value is `data` or an object in it."""
        if isinstance(value, _View):
            whole = value.prefix + name
            self._examination.fields.add(whole if hasattr(mujoco.MjData, whole) else name)
            return None
        if isinstance(value, _DataOnStack):
            if name in VIEWS:
                return _View(VIEWS[name])
            self._examination.fields.add(name)
            return None
        return value and _Path(value.root, (*value.names, name))


def _method(owner: object, name: str) -> MethodType | None:
    """Returns the method of an object, if it is a function of its class."""
    if name in getattr(owner, "__dict__", ()):
        return None
    function = next((vars(base)[name] for base in type(owner).__mro__ if name in vars(base)), None)
    return MethodType(function, owner) if isinstance(function, FunctionType) else None


def _assigned(names: Mapping[str, object]) -> set[str]:
    """Returns the global names and attributes that functions of a module assign."""
    functions = [value for value in names.values() if isinstance(value, FunctionType)]
    classes = [
        value for value in names.values() if isinstance(value, type) and value.__module__ == names.get("__name__")
    ]
    functions += [value for each in classes for value in vars(each).values() if isinstance(value, FunctionType)]
    codes = [code for function in functions if function.__globals__ is names for code in _codes(function.__code__)]
    return {each.argval for code in codes for each in dis.get_instructions(code) if each.opname in ASSIGNMENTS}


def _codes(code: CodeType) -> Iterator[CodeType]:
    """Yields a code object and those within it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _local_variables(instruction: dis.Instruction) -> tuple[str, ...]:
    """Returns the local variables that an instruction uses; other names are of globals and attributes."""
    if "_FAST" not in instruction.opname and instruction.opcode not in {*dis.haslocal, *dis.hasfree}:
        return ()
    if isinstance(instruction.argval, str):
        return (instruction.argval,)
    return tuple(map(str, instruction.argval))  # of several instructions in one
