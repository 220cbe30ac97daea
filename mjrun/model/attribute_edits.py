"""Edits of numeric attributes in the text of an MJCF file; every other byte stays unchanged.

An override that names an element changes the attribute that holds the value. This is the element's attribute, or that
of the class default it inherits from, if every element that inherits the value gets the same new one; otherwise the
element gets an attribute itself.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UsageError, clean
from mjrun.model.override import ELEMENTS, PARTIAL, ROOTS, Override, apply, indices_at
from mjrun.model.source import load_respecting_confinement
from mjrun.model.text_edits import ElementEditor, edited
from mjrun.model.xml_source import Element, XmlSource, default_holder, read_xml

# Attributes whose name differs from that of the MjSpec field.
NAMES = {"solref_limit": "solreflimit", "solimp_limit": "solimplimit"}
NAMES |= {"solref_friction": "solreffriction", "solimp_friction": "solimpfriction"}
# Attributes of a body that belong to its <inertial> element.
INERTIAL = {"mass": "mass", "ipos": "pos", "inertia": "diaginertia", "fullinertia": "fullinertia", "iquat": "quat"}
ORIENTATIONS = ("euler", "axisangle", "xyaxes", "zaxis")
SECTIONS = {"opt": "option", "stat": "statistic", "compiler": "compiler", "size": "size"}
# Names of the first gain and bias parameters of the actuator elements that have shortcuts for them.
SHORTCUTS = {
    ("position", "gainprm", 0): "kp",
    ("position", "biasprm", 1): "kp",
    ("position", "biasprm", 2): "kv",
    ("velocity", "gainprm", 0): "kv",
    ("velocity", "biasprm", 2): "kv",
    ("damper", "gainprm", 2): "kv",
    ("adhesion", "gainprm", 0): "gain",
}


@dataclass(frozen=True)
class AttributeChange:
    """A change of an attribute: its new value.

    Attributes:
      element: the element with the attribute.
      attribute: the name of the attribute.
      value: the text of the new value.
      is_default: true if the element is a class default.
    """

    element: Element
    attribute: str
    value: str
    is_default: bool = False

    @property
    def sentence(self) -> str:
        """The place of the attribute and its new value."""
        where = " of a class default" if self.is_default else ""
        place = f"{self.element.file.name}:{self.element.line}"
        return f"{clean(place)}: {self.attribute}{where} = {self.value}"


def changes(path: Path, overrides: Sequence[Override]) -> list[AttributeChange]:
    """Returns the attribute changes that make the overrides in the file at `path` and the files that it includes.

    Raises:
      UsageError: no attribute of the text holds the overridden value, such as the gain of a muscle.
    """
    text, changed = read_xml(path), load_respecting_confinement(lambda: mujoco.MjSpec.from_file(str(path)))
    for override in overrides:
        apply(changed, override)
    made: dict[tuple[int, str], AttributeChange] = {}
    for override in overrides:
        for each in _of_override(text, changed, override):
            made[id(each.element), each.attribute] = each
    return list(made.values())


def with_changes(xml: bytes, made: Sequence[AttributeChange]) -> bytes:
    """Returns the text of one file with its attributes changed."""
    editor = ElementEditor({each.element.file: xml for each in made})
    return edited(xml, [editor.with_value(each.element, each.attribute, each.value) for each in made])


def _of_override(text: XmlSource, changed: mujoco.MjSpec, override: Override) -> Iterator[AttributeChange]:
    kind, slash, _ = override.target.partition("/")
    if not (slash and kind in ELEMENTS):
        yield _of_section(text, changed, override)
        return
    indices, fields = indices_at(changed, override)
    everyone = getattr(changed, ELEMENTS[kind])
    written = _written(text, kind)
    if len(written) != len(everyone) or len(fields) != 1:
        raise _refusal(override, "its elements are not written out in this file, as in attached or replicated models")
    chosen = {id(written[index]): everyone[index] for index in indices}
    for element in written:
        if id(element) in chosen:
            yield _of_element(element, written, chosen, fields[0], override)


def _of_element(
    element: Element,
    written: Sequence[Element],
    chosen: "dict[int, object]",
    field: str,
    override: Override,
) -> AttributeChange:
    owner = chosen[id(element)]
    holder, attribute = _holder(element, field, override)
    values = np.ravel(np.array(list(np.ravel(getattr(owner, field))), float))
    is_gain = field in ("gainprm", "biasprm") and attribute != field  # of which the bias is the negative
    written_values = np.abs(values[[override.index or 0]]) if is_gain else values
    if attribute in holder.attributes:
        return AttributeChange(holder, attribute, _text(written_values, holder.attributes[attribute], override))
    default = default_holder(element, attribute)
    if default is not None and (default.tag == element.tag or not is_gain):
        # All kinds of actuators share their defaults, but not their gains.
        others = [
            each for each in written if attribute not in each.attributes and (each.tag == element.tag or not is_gain)
        ]
        sharing = [each for each in others if default_holder(each, attribute) is default]
        new = _text(written_values, default.attributes[attribute], override)
        same = all(
            id(each) in chosen and np.array_equal(np.ravel(getattr(chosen[id(each)], field)), np.ravel(values))
            for each in sharing
        )
        if same:
            return AttributeChange(default, attribute, new, is_default=True)
        return AttributeChange(holder, attribute, new)
    return AttributeChange(holder, attribute, _text(written_values, "", override))


def _holder(element: Element, field: str, override: Override) -> tuple[Element, str]:
    """Returns the element and the attribute that hold a field."""
    if element.tag == "body" and field in INERTIAL:
        inner = element.child("inertial")
        if inner is None:
            raise _refusal(override, "this body has no <inertial>")
        if field == "iquat" and (other := next((name for name in ORIENTATIONS if name in inner.attributes), None)):
            raise _refusal(override, f"its <inertial> is oriented by {other}, which quat would contradict")
        return inner, INERTIAL[field]
    if element.tag == "freejoint":
        raise _refusal(override, "a <freejoint> has no joint attributes")
    if field in ("gainprm", "biasprm") and element.tag != "general":
        name = SHORTCUTS.get((element.tag, field, override.index or 0))
        if name is None:
            raise _refusal(override, f"<{element.tag}> has no attribute for it; use <general>")
        return element, name
    return element, NAMES.get(field, field)


def _text(values: np.ndarray, old: str, override: Override) -> str:
    """Returns the attribute value: as many numbers as before, and those that changed."""
    field = override.target.rpartition(".")[2]
    if override.index is None and field not in PARTIAL:
        last = values.size
    elif override.index is None and override.operation == "scale":  # default numbers too
        last = int(np.flatnonzero(values)[-1]) + 1 if values.any() else 1
    elif override.index is None:
        last = len(override.value.replace(",", " ").split())
    else:
        last = override.index + 1
    count = max(len(old.split()), last)
    return " ".join(repr(float(value)) for value in values[:count])


def _of_section(text: XmlSource, changed: mujoco.MjSpec, override: Override) -> AttributeChange:
    root, *fields = override.target.split(".")
    element = next((e for e in text.elements() if e.tag == SECTIONS.get(root) and e.parent is text.root), None)
    if element is None or len(fields) != 1:
        raise _refusal(override, f"the file has no <{SECTIONS.get(root, root)}>")
    values = np.ravel(np.array(getattr(ROOTS[root](changed), fields[0]), float))
    old = element.attributes.get(fields[0], "")
    return AttributeChange(
        element, fields[0], " ".join(repr(float(v)) for v in values[: max(len(old.split()), values.size)])
    )


def _written(text: XmlSource, kind: str) -> list[Element]:
    """Returns the elements of a kind in the order of MjSpec."""
    in_section = kind in ("actuator", "tendon", "equality", "sensor")
    tags = {"joint": ("joint", "freejoint"), "body": ("body", "worldbody")}.get(kind, (kind,))
    elements: list[Element] = []
    for element in text.elements():
        parent = element.parent.tag if element.parent else ""
        fits = parent == kind if in_section else element.tag in tags
        if kind == "joint":  # those of tendons and actuators are references
            fits = fits and parent in ("body", "worldbody")
        if fits and not element.within("default"):
            elements.append(element)
    return elements


def _refusal(override: Override, reason: str) -> UsageError:
    return UsageError(f"{clean(override.path)} cannot be written into the model's text: {reason}")
