"""What pydantic found, in our words: where it is written, what was expected, what was found."""

import re
from collections.abc import Callable, Sequence
from typing import Any

from pydantic import ValidationError

from mjrun.document.document_model import ComplaintError
from mjrun.document.tree import Broken, Fault, Node, Path, Scalar, cut, described, find, key_mark, spelled
from mjrun.errors import clean, listing, quoted, suggestion

Facts = dict[str, Any]


def _above(facts: Facts) -> str:
    return "a positive number" if facts["gt"] == 0 else f"a number above {facts['gt']:g}"


# Keys of earlier versions, and what they are called now.
RENAMED = {
    "films": "videos",
    "stills": "images",
    "recording": "recordings, a list",
    "at": "time",
    "groups": "geomgroup, sitegroup, jointgroup, …",
}

# What was expected, by pydantic's type of error.
EXPECTED: dict[str, Callable[[Facts], str]] = {
    "kind": lambda facts: facts["expected"],
    "float_type": lambda facts: "a number",
    "int_type": lambda facts: "a whole number",
    "int_from_float": lambda facts: "a whole number",
    "bool_type": lambda facts: "true or false",
    "string_type": lambda facts: "text",
    "list_type": lambda facts: "a list",
    "tuple_type": lambda facts: "a list",
    "dict_type": lambda facts: "a mapping",
    "model_type": lambda facts: "a mapping",
    "finite_number": lambda facts: "a finite number",
    "greater_than": _above,
    "greater_than_equal": lambda facts: f"a number of at least {facts['ge']:g}",
    "less_than": lambda facts: f"a number below {facts['lt']:g}",
    "less_than_equal": lambda facts: f"a number of at most {facts['le']:g}",
    "string_too_short": lambda facts: "text that is not empty",
    "string_too_long": lambda facts: f"text of at most {facts['max_length']} characters",
    "literal_error": lambda facts: facts["expected"],
}


def faults_of(error: ValidationError, tree: Node, besides: Sequence[str] = ()) -> list[Fault]:
    """What is wrong with `tree`, as `error` has it, but what is known already; `besides` are more keys of its top."""
    faults = []
    for details in error.errors(include_url=False, include_input=False):
        path = tuple(step for step in details["loc"] if isinstance(step, int) or not step.startswith("\0"))
        node = find(tree, path)
        if not isinstance(node, Broken):
            complaint = ComplaintError.of(details, ())
            keys = (*complaint.facts.get("keys", ()), *(besides if len(path) == 1 else ()))
            faults.append(_fault(complaint, path, node, tree, keys))
    return faults


def _fault(complaint: ComplaintError, path: Path, node: Node, tree: Node, keys: Sequence[str]) -> Fault:
    facts = complaint.facts
    match complaint.kind:
        case "said":
            return Fault(node.mark, spelled(path), facts["message"])
        case "missing":
            return Fault(node.mark, spelled(path[:-1]), f"{quoted(str(path[-1]))} is missing")
        case "extra_forbidden":
            return Fault(key_mark(tree, path), spelled(path[:-1]), _unknown(str(path[-1]), keys))
        case "too_short" | "too_long":
            return Fault(node.mark, spelled(path), _miscounted(facts))
        case kind if kind in EXPECTED:
            found = f"expected {EXPECTED[kind](facts)}, got {described(node)}"
            return Fault(node.mark, spelled(path), found + _hint(kind, facts, node))
    return Fault(node.mark, spelled(path), f"{clean(facts['said'])}, got {described(node)}")


def _unknown(key: str, keys: Sequence[str]) -> str:
    if key in RENAMED:
        return f"unknown key {quoted(key)}: it is called {RENAMED[key]} now"
    choices = f"; keys: {listing(keys)}" if keys else ""
    return f"unknown key {quoted(cut(key))}{suggestion(key, keys)}{choices}"


def _miscounted(facts: Facts) -> str:
    least, most = facts.get("min_length"), facts.get("max_length")
    bound, count = ("at least", least) if least is not None else ("at most", most)
    return f"expected {bound} {count} item{'' if count == 1 else 's'}, got {facts['actual_length'] or 'none'}"


def _hint(kind: str, facts: Facts, node: Node) -> str:
    if not isinstance(node, Scalar):
        return ""
    if kind == "literal_error" and isinstance(node.value, str):
        return suggestion(node.value, re.findall("'([^']*)'", facts["expected"]))
    if kind == "string_type" and node.text:
        return f"; as text it goes in quotes, {quoted(cut(node.text))}"
    return ""
