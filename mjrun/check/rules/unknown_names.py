"""References to names that do not exist, and the names that do."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path

from mjrun.check.compile_error import CompileError
from mjrun.check.rule import Finding, Rule
from mjrun.errors import listing, near, quoted, suggestion
from mjrun.model.xml_source import Element, attach_paths

UNKNOWN_NAME = Rule("MJ109", "error", "reference to an unknown name")

# The elements whose names an attribute of this name can refer to.
REFERENTS: dict[str, Callable[[Element], bool]] = {
    "class": lambda e: e.tag == "default",
    "joint": lambda e: e.tag in ("joint", "freejoint"),
    "tendon": lambda e: e.tag in ("fixed", "spatial"),
    "actuator": lambda e: e.parent is not None and e.parent.tag == "actuator",
    "sensor": lambda e: e.parent is not None and e.parent.tag == "sensor",
    **{kind: lambda e, kind=kind: e.tag == kind for kind in ("body", "geom", "site", "camera", "frame", "flex")},
    **{kind: lambda e, kind=kind: e.tag == kind for kind in ("mesh", "material", "texture", "hfield", "model", "skin")},
}
# The subjects of MuJoCo's messages without a name: the attribute with the name, and its kind.
WITHOUT_NAME = {"target body": ("target", "body"), "default childclass": ("childclass", "class")}
NAMED_BY_FILE = ("mesh", "hfield", "skin", "texture")  # elements that are named after their file by default


def unknown_name(error: CompileError, match: re.Match[str]) -> Iterator[Finding]:
    """Yields a finding for the reference in MuJoCo's message, with the valid names."""
    name = match["name"]
    element = error.element(name)
    attribute = next((key for key, value in element.attributes.items() if value == name), "") if element else ""
    kinds = (attribute.rstrip("12"), match["kind"].strip())  # `joint1="knee"` says more than the message
    kind = next((word for word in kinds if word in REFERENTS), "")
    hint, remedy = _valid_names(name, kind, _candidates(error, element, kind))
    yield error.finding(UNKNOWN_NAME, f"{error.text}{hint}", remedy, name)


def unquoted_name(error: CompileError, match: re.Match[str]) -> Iterator[Finding]:
    """Yields a finding for the first unknown reference of a kind, for a message in which MuJoCo omits the name."""
    attribute, kind = WITHOUT_NAME[match["kind"]]
    elements = list(error.source.elements())
    valid = _names(kind, elements)
    unknown = [e for e in elements if e.attributes.get(attribute, "") not in ("", *valid)]
    if error.line:
        unknown = [e for e in unknown if e.line == error.line and e.file == error.source.path]
    for element in unknown[:1]:
        name = element.attributes[attribute]
        hint, remedy = _valid_names(name, kind, elements)
        yield UNKNOWN_NAME.in_element(element, f"{error.text}: {quoted(name)}{hint}", remedy)


def _candidates(error: CompileError, element: Element | None, kind: str) -> list[Element]:
    """Returns the elements that can have the name: those of the attached model for a reference in `<attach>`."""
    if element is None or element.tag != "attach" or kind == "model":
        return list(error.source.elements())
    models = [e for e in error.source.elements() if e.tag == "model"]
    attached = (e for e in models if e.attributes.get("name") == element.attributes.get("model"))
    paths = [path for model in attached for path in attach_paths(model, error.source.path)]
    return [e for root in error.source.attached if root.file in paths for e in root.walk()]


def _valid_names(name: str, kind: str, elements: list[Element]) -> tuple[str, str]:
    """Returns a suggestion in place of `name`, and a remedy."""
    valid = [other for other in _names(kind, elements) if other != name]
    what = f"names of kind {kind}" if kind else "names in the model"
    close = near(name, valid)
    choices = f"{what}: {listing(valid)}" if valid else f"the model has no {what}"
    remedy = f"write {quoted(close[0])}" if close else choices
    return suggestion(name, valid), remedy


def _names(kind: str, elements: list[Element]) -> list[str]:
    """Returns the names of a kind, or all names if it is empty."""
    candidates = [e for e in elements if not kind or REFERENTS[kind](e)]
    return sorted({name for e in candidates if (name := _name(e, kind))})


def _name(element: Element, kind: str) -> str:
    if kind == "class":
        return element.attributes.get("class", "")
    stem = Path(element.attributes.get("file", "")).stem if element.tag in NAMED_BY_FILE else ""
    return element.attributes.get("name") or stem
