"""The elements of a model's XML that set attributes: an element itself, or a default class that it inherits from."""

from collections.abc import Iterator

from mjrun.model.xml_source import Element

ACTUATORS = (
    *("general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder", "muscle", "adhesion"),
    *("orientation", "pid", "dcmotor", "plugin"),
)
# The tags of elements in defaults that concern elements of other tags, too.
SHARED = (ACTUATORS, ("tendon", "spatial", "fixed"))


def holder(element: Element, attribute: str) -> Element | None:
    """Returns the element that sets an attribute of `element`; None if the value is MuJoCo's default."""
    return element if attribute in element.attributes else default_holder(element, attribute)


def default_holder(element: Element, attribute: str) -> Element | None:
    """Returns the element of a default class that sets an attribute unless `element` does; None without one."""
    tags = next((tags for tags in SHARED if element.tag in tags), (element.tag,))
    for default in _inherited(element):
        for child in reversed(default.children):
            if child.tag in tags and attribute in child.attributes:
                return child
    return None


def _inherited(element: Element) -> Iterator[Element]:
    """Yields the `<default>` elements that concern an element, those that override others first."""
    root = element
    while root.parent is not None:
        root = root.parent
    defaults = [each for each in root.walk() if each.tag == "default"][::-1]
    name = _class(element)
    while name is not None:
        own = [each for each in defaults if _class_name(each) == name]
        yield from own
        above = own[-1].parent if own else None
        name = _class_name(above) if above is not None and above.tag == "default" else None


def _class(element: Element) -> str:
    """Returns the name of the class of an element; empty for that of the whole model."""
    above = element.parent
    if above is not None and above.tag == "default":
        return _class_name(above)
    name = element.attributes.get("class")
    while name is None and above is not None:
        name, above = above.attributes.get("childclass"), above.parent
    return "" if name in (None, "main") else str(name)


def _class_name(default: Element) -> str:
    """Returns the class that a `<default>` defines; empty for that of the whole model."""
    name = default.attributes.get("class", "")
    return "" if name == "main" else name
