"""What pydantic found wrong, as faults: where it is written, what was expected, and what is there instead."""

import re
from collections.abc import Callable, Mapping, Sequence

from pydantic import ValidationError

from mjrun.document.document_model import InvalidValueError
from mjrun.document.tree import (
    Fault,
    InvalidNode,
    Node,
    Path,
    ScalarNode,
    described,
    find,
    key_mark,
    path_text,
    shortened,
)
from mjrun.errors import FAULTS, clean, listing, quoted, suggestion

Context = Mapping[str, object]


def _above(context: Context) -> str:
    return "a positive number" if context["gt"] == 0 else f"a number above {context['gt']:g}"


# Keys of earlier versions, and what they are called now.
RENAMED = {
    "films": "videos",
    "stills": "images",
    "recording": "recordings, a list",
    "at": "time",
    "groups": "geomgroup, sitegroup, jointgroup, …",
}

# What was expected, by pydantic's type of error.
EXPECTED: dict[str, Callable[[Context], object]] = {
    "expected": lambda context: context["expected"],
    "float_type": lambda context: "a number",
    "int_type": lambda context: "a whole number",
    "int_from_float": lambda context: "a whole number",
    "bool_type": lambda context: "true or false",
    "string_type": lambda context: "text",
    "list_type": lambda context: "a list",
    "tuple_type": lambda context: "a list",
    "dict_type": lambda context: "a mapping",
    "model_type": lambda context: "a mapping",
    "finite_number": lambda context: "a finite number",
    "greater_than": _above,
    "greater_than_equal": lambda context: f"a number of at least {context['ge']:g}",
    "less_than": lambda context: f"a number below {context['lt']:g}",
    "less_than_equal": lambda context: f"a number of at most {context['le']:g}",
    "string_too_short": lambda context: "text that is not empty",
    "string_too_long": lambda context: f"text of at most {context['max_length']} characters",
    "literal_error": lambda context: context["expected"],
}


def validation_faults(error: ValidationError, tree: Node, besides: Sequence[str] = ()) -> list[Fault]:
    """What is wrong with `tree`, as `error` has it, but what is known already; `besides` are more keys of its top."""
    faults: list[Fault] = []
    for details in error.errors(include_url=False, include_input=False):
        path = tuple(step for step in details["loc"] if isinstance(step, int) or not step.startswith("\0"))
        node = find(tree, path)
        if not isinstance(node, InvalidNode):
            invalid = InvalidValueError.from_details(details, ())
            keys = (*invalid.keys, *(besides if len(path) == 1 else ()))
            if invalid.type == "extra_forbidden" and len(faults) >= FAULTS:
                keys = ()  # to compare thousands of keys, of which few are shown, takes its time
            faults.append(_fault(invalid, path, node, tree, keys))
    return faults


def _fault(error: InvalidValueError, path: Path, node: Node, tree: Node, keys: Sequence[str]) -> Fault:
    context = error.context
    match error.type:
        case "message":
            return Fault(node.mark, path_text(path), str(context["message"]))
        case "missing":
            return Fault(node.mark, path_text(path[:-1]), f"{quoted(str(path[-1]))} is missing")
        case "extra_forbidden":
            return Fault(key_mark(tree, path), path_text(path[:-1]), _unknown(str(path[-1]), keys))
        case "too_short" | "too_long":
            return Fault(node.mark, path_text(path), _wrong_length(context))
        case kind if kind in EXPECTED:
            message = f"expected {EXPECTED[kind](context)}, got {described(node)}"
            return Fault(node.mark, path_text(path), message + _hint(kind, context, node))
        case _:
            return Fault(node.mark, path_text(path), f"{clean(str(context['msg']))}, got {described(node)}")


def _unknown(key: str, keys: Sequence[str]) -> str:
    if key in RENAMED:
        return f"unknown key {quoted(key)}: it is called {RENAMED[key]} now"
    choices = f"; keys: {listing(keys)}" if keys else ""
    return f"unknown key {quoted(shortened(key))}{suggestion(key, keys)}{choices}"


def _wrong_length(context: Context) -> str:
    least, most = context.get("min_length"), context.get("max_length")
    bound, count = ("at least", least) if least is not None else ("at most", most)
    return f"expected {bound} {count} item{'' if count == 1 else 's'}, got {context['actual_length'] or 'none'}"


def _hint(kind: str, context: Context, node: Node) -> str:
    if not isinstance(node, ScalarNode):
        return ""
    if kind == "literal_error" and isinstance(node.value, str):
        return suggestion(node.value, re.findall("'([^']*)'", str(context["expected"])))
    if kind == "string_type" and node.text:
        return f"; as text it goes in quotes, {quoted(shortened(node.text))}"
    return ""
