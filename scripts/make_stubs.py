"""Writes mjrun/__init__.pyi, the types of `import mjrun`, from the declarations of options.

    .venv/bin/python scripts/make_stubs.py

An option accepts more types than its attribute has: a text for several values, a number for an exact one. The
classes of jobs convert these, which pyright follows and mypy does not. So each class gets its `__init__` written out.
"""

import dataclasses
import inspect
import subprocess
import sys
import textwrap
import types
from pathlib import Path
from typing import Any, ForwardRef, Union, get_args, get_origin

sys.path.insert(0, str(Path(__file__).parents[1]))

import mjrun
from mjrun.options.kinds import AnyKind, CameraKind, ChoiceKind, Kind, OneOrMoreKind
from mjrun.options.number_kinds import InstantKind, ProcessCountKind
from mjrun.options.option import Option, Options, options_of
from mjrun.options.policy import PolicyKind
from mjrun.options.structured_kinds import OneOfKind
from mjrun.python_help import FUNCTIONS, options_of_name

STUB = Path(mjrun.__file__).with_name("__init__.pyi")
HEADER = '''"""MuJoCo models to videos, images, tables and timing reports; written by scripts/make_stubs.py."""

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from fractions import Fraction
from os import PathLike
from pathlib import Path
from typing import Literal

import numpy as np
from mujoco import MjModel

from mjrun.camera.script import CameraScript, ConditionEvent
from mjrun.simulation.input_snapshot import InputSnapshot
from mjrun.model.source import ModelSource
from mjrun.model.sources import ModelLike
from mjrun.options.simulation import Push
'''
ARGUMENTS = {
    "model": "ModelLike | Task | _Simulation",
    "task": "ModelSource | str",
    "data": "str | PathLike[str] | Sequence[str | PathLike[str]]",
    "controllers": "Mapping[str, Callable[..., object]]",
}
RETURNED = {f"collections.abc.{kind}[numpy.ndarray]": f"{kind}[np.ndarray]" for kind in ("Generator", "Iterator")}
INTERNAL = {"rows_to"}  # fields of jobs that are no options and not for users
# Kinds that accept objects of rooms that declarations do not know.
ACCEPTED: dict[type[AnyKind], str] = {
    CameraKind: "str | int | PathLike[str] | CameraScript",
    InstantKind: "float | str | Fraction | ConditionEvent",
    ProcessCountKind: "int | Literal['auto']",
    PolicyKind: "str | PathLike[str] | Policy | Callable[..., object]",
}


def accepted(kind: AnyKind) -> str:
    """Returns the type of the values that a kind accepts."""
    match kind:
        case OneOrMoreKind():
            each = accepted(kind.each)
            return f"{each} | Sequence[{each}]"
        case ChoiceKind():
            return f"Literal[{', '.join(map(repr, kind.names))}]"
        case _ if type(kind) in ACCEPTED:
            return ACCEPTED[type(kind)]
    bases = [base for home in type(kind).__mro__ for base in vars(home).get("__orig_bases__", ())]
    return written(next(get_args(base)[0] for base in bases if get_origin(base) in (Kind, OneOfKind)))


def accepted_by(option: Option) -> str:
    """Returns the type of the values that an option accepts."""
    values = accepted(option.kind)
    return f"{values} | None" if option.default is None and not values.endswith("None") else values


def written(annotation: Any) -> str:
    """Returns a type as source."""
    match annotation:
        case None | types.NoneType:
            return "None"
        case types.EllipsisType():
            return "..."
        case str():
            return annotation
        case ForwardRef():
            return annotation.__forward_arg__
        case list():
            return f"[{', '.join(map(written, annotation))}]"
        case _:
            pass
    origin, arguments = get_origin(annotation), [written(argument) for argument in get_args(annotation)]
    if origin in (Union, types.UnionType):
        return " | ".join(arguments)
    return f"{origin.__name__}[{', '.join(arguments)}]" if origin else annotation.__name__


def class_stub(name: str, cls: type[Options]) -> str:
    """Returns a class with its `__init__` written out."""
    declared = {each.attribute: each for each in options_of(cls)}
    positional, keywords = [], []
    for field in (field for field in dataclasses.fields(cls) if field.init and field.name not in INTERNAL):  # type: ignore[arg-type]
        option = declared.get(field.name)
        kind = accepted_by(option) if option else "_Simulation" if field.name == "simulation" else written(field.type)
        required = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        parameter = f"{field.name}: {kind}{'' if required else ' = ...'}"
        (keywords if field.kw_only else positional).append(parameter)
    parameters = ", ".join(["self", *positional, *(["*"] if keywords else []), *keywords])
    return f"class {name}(_{name}):\n    {documentation(cls)}\n    def __init__({parameters},) -> None: ...\n"


def documentation(value: object) -> str:
    """Returns the docstring of a class or function with all options, which editors show."""
    return f'"""{textwrap.indent(str(value.__doc__).rstrip(), "    ").lstrip()}\n    """'


def function_stub(name: str) -> str:
    """Returns a function of `mjrun.in_memory`, with the options that it takes as keywords."""
    function = getattr(mjrun, name)
    own = [each for each in inspect.signature(function).parameters.values() if each.name != "options"]
    first = [f"{each.name}: {ARGUMENTS[each.name]}" for each in own if each.kind != each.KEYWORD_ONLY]
    options = [f"{each.name}: {ARGUMENTS[each.name]} = ..." for each in own if each.kind == each.KEYWORD_ONLY]
    options += [f"{option.attribute}: {accepted_by(option)} = ..." for option in options_of_name(name)]
    parameters = ", ".join([*first, "*", *options])
    made = str(inspect.signature(function).return_annotation).strip("'")
    returned = RETURNED.get(made, made.rpartition(".")[2].strip("'>"))
    return f"def {name}({parameters},) -> {returned}:\n    {documentation(function)}\n"


def stub() -> str:
    """Returns the whole file, formatted."""
    imports, classes = [], []
    for name in sorted(set(mjrun.__all__) - {"__version__", *FUNCTIONS}):
        value, home = getattr(mjrun, name), mjrun._HOMES[name]
        is_options = isinstance(value, type) and issubclass(value, Options)
        imports.append(f"from {home} import {name} as {'_' * is_options}{name}")
        if is_options:
            classes.append(class_stub(name, value))
    classes += map(function_stub, FUNCTIONS)
    names = f"__all__ = {sorted(mjrun.__all__)!r}\n_HOMES: dict[str, str]\n"
    imports += ["from mjrun import errors as errors", "from mjrun.version import __version__ as __version__"]
    text = "\n".join([HEADER, *imports, "", names, *classes])
    for arguments in (["check", "--fix", "--quiet", "--select", "I,F401"], ["format", "--quiet"]):
        command = [sys.executable, "-m", "ruff", *arguments, "--stdin-filename", str(STUB), "-"]
        text = subprocess.run(command, input=text, capture_output=True, text=True, check=True).stdout
    return text


if __name__ == "__main__":
    STUB.write_text(stub(), "utf-8")
