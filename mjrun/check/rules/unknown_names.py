"""Names that refer to nothing: where, and which there are."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path

from mjrun.check.compile_error import Refusal
from mjrun.check.finding import Sighting
from mjrun.check.xml_source import Element, attached
from mjrun.errors import listing, near, quoted, suggestion

NAME = "MJ109"
# What can have a name that an attribute of this name refers to.
OWNERS: dict[str, Callable[[Element], bool]] = {
    "class": lambda e: e.tag == "default",
    "joint": lambda e: e.tag in ("joint", "freejoint"),
    "tendon": lambda e: e.tag in ("fixed", "spatial"),
    "actuator": lambda e: e.parent is not None and e.parent.tag == "actuator",
    "sensor": lambda e: e.parent is not None and e.parent.tag == "sensor",
    **{kind: lambda e, kind=kind: e.tag == kind for kind in ("body", "geom", "site", "camera", "frame", "flex")},
    **{kind: lambda e, kind=kind: e.tag == kind for kind in ("mesh", "material", "texture", "hfield", "model", "skin")},
}
# What a sentence of MuJoCo that tells no name is about → the attribute that holds the name, and its kind.
NAMELESS = {"target body": ("target", "body"), "default childclass": ("childclass", "class")}
STEMS = ("mesh", "hfield", "skin", "texture")  # what is called after its file when it has no name


def unknown(refusal: Refusal, match: re.Match[str]) -> Iterator[tuple[str, Sighting]]:
    """What to say of the name that MuJoCo does not know."""
    name = match["name"]
    element = refusal.element(name)
    holder = next((key for key, value in element.attributes.items() if value == name), "") if element else ""
    kinds = (holder.rstrip("12"), match["kind"].strip())
    wanted = next((word for word in kinds if word in OWNERS), "")  # `joint1="knee"` tells more than the sentence
    hint, remedy = _meant(name, wanted, _searched(refusal, element, wanted))
    yield NAME, refusal.sighting(f"{refusal.said}{hint}", remedy, name)


def nameless(refusal: Refusal, match: re.Match[str]) -> Iterator[tuple[str, Sighting]]:
    """What to say when MuJoCo does not tell which name it does not know."""
    attribute, wanted = NAMELESS[match["kind"]]
    elements = list(refusal.source.elements())
    known = _names(wanted, elements)
    strange = [e for e in elements if e.attributes.get(attribute, "") not in ("", *known)]
    lined = [e for e in strange if e.line == refusal.line and e.file == refusal.source.path]
    for element in (lined or [] if refusal.line else strange)[:1]:
        name = element.attributes[attribute]
        hint, remedy = _meant(name, wanted, elements)
        message = f"{refusal.said}: {quoted(name)}{hint}"
        yield NAME, Sighting(message, remedy, str(element), (element.file, element.line))


def _searched(refusal: Refusal, element: Element | None, wanted: str) -> list[Element]:
    """The elements that can have the name: for what `<attach>` takes out of a model, those of that model."""
    if element is None or element.tag != "attach" or wanted == "model":
        return list(refusal.source.elements())
    models = [e for e in refusal.source.elements() if e.tag == "model"]
    named = (e for e in models if e.attributes.get("name") == element.attributes.get("model"))
    paths = [path for model in named for path in attached(model, refusal.source.path)]
    return [e for root in refusal.source.attached if root.file in paths for e in root.walk()]


def _meant(name: str, wanted: str, elements: list[Element]) -> tuple[str, str]:
    """A hint at what `name` should be called, and a remedy."""
    valid = [other for other in _names(wanted, elements) if other != name]
    what = f"names of kind {wanted}" if wanted else "names in the model"
    close = near(name, valid)
    remedy = f"write {quoted(close[0])}" if close else f"{what}: {listing(valid)}" if valid else f"there are no {what}"
    return suggestion(name, valid), remedy


def _names(wanted: str, elements: list[Element]) -> list[str]:
    """The names of kind `wanted`, or all if it is empty."""
    found = [e for e in elements if not wanted or OWNERS[wanted](e)]
    return sorted({name for e in found if (name := _called(e, wanted))})


def _called(element: Element, wanted: str) -> str:
    if wanted == "class":
        return element.attributes.get("class", "")
    stem = Path(element.attributes.get("file", "")).stem if element.tag in STEMS else ""
    return element.attributes.get("name") or stem
