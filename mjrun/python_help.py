"""Docstrings of the Python API that explain every option, made from the declarations."""

import inspect
import re
import textwrap
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pkgutil import resolve_name

from mjrun.options.kinds import ChoiceKind
from mjrun.options.option import FrontEnd, Option, Options, options_of
from mjrun.outputs.format_lists import with_formats

WIDTH = 100  # characters
# Options of a video that concern its file, which functions in memory lack.
OF_FILES = ("output", "format", "codec", "crf", "preset", "separate", "calibration", "calibration_format", "manifest")
# The functions in memory: the classes whose options they have, and those of their options that they lack.
FUNCTIONS: dict[str, tuple[Sequence[str], Sequence[str]]] = {
    "evaluate": (["evaluation.evaluation:Evaluation"], []),
    "fit": (["simulation.simulation:Simulation", "fitting.fit:Fit"], ["data"]),
    "frames": (["simulation.simulation:Simulation", "outputs.video:Video"], OF_FILES),
    "sweep": (["simulation.simulation:Simulation", "study.study:Study"], []),
    "trace": (["simulation.simulation:Simulation", "outputs.trace:Trace"], []),
}


def add_options(name: str, value: object) -> None:
    """Adds all options to the docstring of a name of the API, if it is a class of options or takes such options."""
    if not isinstance(value, type) and name not in FUNCTIONS:
        return
    declared = options_of_name(name) if name in FUNCTIONS else _of_class(value)
    if declared:
        value.__doc__ = "\n".join([inspect.getdoc(value) or "", "", "Options:", *_lines(declared), ""])


def options_of_name(name: str) -> list[Option]:
    """Returns the options of a function in memory."""
    homes, without = FUNCTIONS[name]
    classes = [resolve_name(f"mjrun.{home}") for home in homes]
    declared = {each.attribute: each for cls in classes for each in _of_class(cls)}
    return [each for attribute, each in declared.items() if attribute not in without]


def _of_class(value: object) -> Sequence[Option]:
    """Returns the options that a class takes in Python; none of any other class."""
    if not (isinstance(value, type) and issubclass(value, Options)):
        return ()
    return [each for each in options_of(value) if FrontEnd.PYTHON in each.places]


def _lines(declared: Sequence[Option]) -> Iterator[str]:
    for each in sorted(declared, key=lambda option: not option.is_required):
        text = re.sub(r"--([a-z][a-z-]*)", lambda flag: flag[1].replace("-", "_"), with_formats(each.help))
        choices = f" One of {', '.join(_choices(each))}." if _choices(each) else ""
        usual = "" if each.is_required else each.usual or _shown(each.default)
        default = f" [default: {usual}]" if usual else ""
        line = f"{each.attribute}: {text}{choices}{default}"
        yield from textwrap.wrap(line, WIDTH, initial_indent="  ", subsequent_indent="    ", break_on_hyphens=False)


def _choices(each: Option) -> Sequence[str]:
    return each.kind.names if isinstance(each.kind, ChoiceKind) else ()


def _shown(default: object) -> str:
    """Formats a default as Python code; an empty text if it says nothing."""
    if default in (None, (), {}, False, ""):
        return ""
    return f"{float(default):g}" if isinstance(default, Fraction) else repr(default)
