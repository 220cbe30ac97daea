"""Fixes of all ranges in the text of a model at once: MuJoCo rejects them one by one."""

from collections.abc import Iterator

from mjrun.check.rule import NOT_CERTAIN, Fix
from mjrun.model.class_defaults import ACTUATORS, holder
from mjrun.model.text_edits import ElementEditor
from mjrun.model.xml_source import Element, XmlSource

# The attributes with ranges, and those that enable them, of joints and tendons, and of actuators.
LIMITS = {"range": "limited", "actuatorfrcrange": "actuatorfrclimited"}
ACTUATOR_LIMITS = {"ctrlrange": "ctrllimited", "forcerange": "forcelimited", "actrange": "actlimited"}
RANGES = {
    **dict.fromkeys(("joint", "tendon", "spatial", "fixed"), tuple(LIMITS.items())),
    **dict.fromkeys(ACTUATORS, tuple(ACTUATOR_LIMITS.items())),
    "position": (*ACTUATOR_LIMITS.items(), ("inheritrange", "ctrllimited")),
    "intvelocity": (*ACTUATOR_LIMITS.items(), ("inheritrange", "actlimited")),
}


def enabled(source: XmlSource) -> Fix | str:
    """Returns the fix that enables every range of which the text does not state whether it applies."""
    editor = ElementEditor(source.mjcf_texts)
    edits = [
        editor.with_value(element, limit, "true")
        for element, span, limit in _ranges(source)
        if holder(element, limit) is None and any(_numbers(element, span))
    ]
    return Fix(tuple(edits)) if edits else NOT_CERTAIN


def swapped(source: XmlSource) -> Fix | str:
    """Returns the fix that swaps the numbers of every reversed range."""
    editor = ElementEditor(source.mjcf_texts)
    edits = [
        edit
        for element, span in reversed_ranges(source)
        for edit in editor.with_words(element, span, dict(enumerate(reversed(element.attributes[span].split()))))
    ]
    return Fix(tuple(edits)) if edits else NOT_CERTAIN


def reversed_ranges(source: XmlSource) -> list[tuple[Element, str]]:
    """Returns each element with a reversed range, and the attribute with the range."""
    numbers = ((element, span, _numbers(element, span)) for element, span, _ in _ranges(source))
    return [(element, span) for element, span, values in numbers if len(values) == 2 and values[0] > values[1]]


def _ranges(source: XmlSource) -> Iterator[tuple[Element, str, str]]:
    """Yields each element with a range, and the names of the attributes with the range and with what enables it."""
    for element in source.elements():
        for span, limit in RANGES.get(element.tag, ()):
            if span in element.attributes:
                yield element, span, limit


def _numbers(element: Element, attribute: str) -> tuple[float, ...]:
    """Returns the numbers of an attribute; none if it holds something else."""
    try:
        return tuple(map(float, element.attributes[attribute].split()))
    except ValueError:
        return ()
