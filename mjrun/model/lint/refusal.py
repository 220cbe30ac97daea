"""Why MuJoCo refused a model: its one sentence, turned into all findings of that kind."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import mujoco

from mjrun.errors import BrokenModelError, clean, listing, near, quoted, suggestion
from mjrun.model.lint import assets, schema
from mjrun.model.lint.finding import Sighting
from mjrun.model.lint.source import Element, Source
from mjrun.model.names import members

REFUSED, SYNTAX, MEMORY = "MJ100", "MJ101", "MJ004"
TWIN, NAME, KEYWORD, LACKING, TIMESTEP = "MJ108", "MJ109", "MJ110", "MJ112", "MJ114"
MASSLESS, RANGELESS, KEY = "MJ202", "MJ303", "MJ405"

Found = Iterator[tuple[str, Sighting]]
KEYWORDS: dict[tuple[str, str], Any] = {
    ("geom", "type"): mujoco.mjtGeom,
    ("site", "type"): mujoco.mjtGeom,
    ("joint", "type"): mujoco.mjtJoint,
    ("option", "integrator"): mujoco.mjtIntegrator,
    ("option", "cone"): mujoco.mjtCone,
    ("option", "solver"): mujoco.mjtSolver,
    ("option", "jacobian"): mujoco.mjtJacobian,
    ("camera", "mode"): mujoco.mjtCamLight,
    ("light", "mode"): mujoco.mjtCamLight,
    ("light", "type"): mujoco.mjtLightType,
    ("general", "dyntype"): mujoco.mjtDyn,
    ("general", "gaintype"): mujoco.mjtGain,
    ("general", "biastype"): mujoco.mjtBias,
}
# Sentences that need no more than a remedy.
CURES = (
    (r"World body cannot have joints", "the world does not move; put the joint into a <body>"),
    (r"free joint can only be used on top level", "move the body directly into <worldbody>, or give it other joints"),
    (r"size \d must be positive", "give it a size, or fromto: a sphere has 1 number, a capsule 2, a box 3"),
    (r"plugin .* not found", "mjrun knows the plugins that come with MuJoCo, and no others"),
    (r"already included", "a file is included once; put what repeats into <default>, or attach it as a <model>"),
    (r"Unrecognized XML model type", "the root element of MJCF is <mujoco>, that of URDF <robot>"),
    (r"attached to itself|recursive", "attach another file"),
)
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
DRAWN_ONLY = range(100, 10_000)  # values of mjtGeom that are decoration


class Refusal(NamedTuple):
    """What MuJoCo said of the model `source`, without its line, and that line in the model itself."""

    source: Source
    message: str
    line: int | None

    @property
    def place(self) -> tuple[Path, int | None]:
        return self.source.path, self.line

    def element(self, told: str = "") -> Element | None:
        """The element that MuJoCo means: by line, in the model itself, the one that holds the text `told`."""
        if not self.line:  # in an included file, whose lines MuJoCo forgets
            found = [e for e in self.source.elements() if told and told in e.attributes.values()]
        else:
            mine = (e for e in self.source.elements() if e.file == self.source.path)
            found = [e for e in mine if e.line == self.line]
            found = [e for e in found if told in e.attributes.values()] or found
            words = set(re.findall(r"\w+", self.message))
            found = [e for e in found if e.tag in words] or found
        return found[0] if found else None

    @property
    def said(self) -> str:
        """MuJoCo's sentence without what it says of the element, which it names by its tag."""
        return re.sub(r"; Element .*", "", self.message)

    def sighting(self, message: str, remedy: str, told: str = "") -> Sighting:
        """A sighting at the element that MuJoCo means."""
        element = self.element(told)
        if element is None:
            return Sighting(message, remedy, "", self.place)
        return Sighting(message, remedy, str(element), (element.file, element.line))


def explain(error: BrokenModelError, source: Source) -> Found:
    """The findings that `error` of the model `source` stands for, one at least."""
    refusal = Refusal(source, _sentence(error), error.line)
    for pattern, explained in EXPLANATIONS:
        match = re.search(pattern, refusal.message)
        found = list(explained(refusal, match)) if match else []
        if found:
            yield from found
            return
    yield from _plain(refusal)


def _sentence(error: BrokenModelError) -> str:
    """What MuJoCo said, on one line."""
    text = str(error)
    place = clean(str(error.path)) + (f":{error.line}" if error.line else "")
    return "; ".join(text.removeprefix(f"{place}: ").splitlines())


def _plain(refusal: Refusal) -> Found:
    remedy = next((remedy for pattern, remedy in CURES if re.search(pattern, refusal.message)), "")
    yield REFUSED, refusal.sighting(f"MuJoCo refuses the model: {refusal.said}", remedy)


def _syntax(refusal: Refusal, match: re.Match[str]) -> Found:
    for fault in refusal.source.faults:
        yield SYNTAX, Sighting(fault.message, fault.remedy, "", (fault.file, fault.line))
    if not refusal.source.faults:
        remedy = "look there and just before: MuJoCo tells no more" if refusal.line else ""
        yield SYNTAX, Sighting(f"not well-formed XML: {refusal.message}", remedy, "", refusal.place)


def _schema(refusal: Refusal, match: re.Match[str]) -> Found:
    yield from sorted(schema.violations(refusal.source), key=lambda found: _order(found[1], refusal.source))


def _order(sighting: Sighting, source: Source) -> tuple[bool, str, int]:
    file, line = sighting.place or (source.path, None)
    return file != source.path, str(file), line or 0


def _files(refusal: Refusal, match: re.Match[str]) -> Found:
    yield from assets.missing(refusal.source)


def _memory(refusal: Refusal, match: re.Match[str]) -> Found:
    remedy = "give it more with --memory, or look for a count, a size or a resolution that is too large"
    yield MEMORY, Sighting("the model needs more memory than it may have", remedy, "", refusal.place)


def _twin(refusal: Refusal, match: re.Match[str]) -> Found:
    name, kind = match.groups()
    twins = [e for e in refusal.source.elements() if e.attributes.get("name") == name]
    second = refusal.element(name)
    twins = [e for e in twins if second is None or e.tag == second.tag]
    remedy = f"rename one of them; names are unique among all of kind {kind}"
    if len(twins) < 2:
        yield TWIN, refusal.sighting(f"the name {quoted(name)} is given twice in {kind}", remedy, name)
    for twin in twins[1:]:
        first = f"{twins[0].file}:{twins[0].line}" if twins[0].file != twin.file else f"line {twins[0].line}"
        message = f"the name {quoted(name)} is already taken on {first}"
        yield TWIN, Sighting(message, remedy, str(twin), (twin.file, twin.line))


def _name(refusal: Refusal, match: re.Match[str]) -> Found:
    name = match["name"]
    what, valid = _namesakes(refusal, name, match["kind"])
    close = near(name, valid)
    remedy = f"write {quoted(close[0])}" if close else f"{what}: {listing(valid)}" if valid else f"there are no {what}"
    yield NAME, refusal.sighting(f"{refusal.said}{suggestion(name, valid)}", remedy, name)


def _namesakes(refusal: Refusal, name: str, kind: str) -> tuple[str, list[str]]:
    """What the unknown `name` could be called, and what those names are of.

    The attribute that holds the name tells its kind, as in `joint1="knee"`; else MuJoCo's sentence does.
    """
    element = refusal.element(name)
    holder = next((key for key, value in element.attributes.items() if value == name), "") if element else ""
    wanted = next((word for word in (holder.rstrip("12"), kind.strip()) if word in OWNERS), "")
    found = [e for e in refusal.source.elements() if not wanted or OWNERS[wanted](e)]
    key = "class" if wanted == "class" else "name"
    valid = sorted({e.attributes[key] for e in found if e.attributes.get(key)} - {name})
    return f"names of kind {wanted}" if wanted else "names in the model", valid


def _keyword(refusal: Refusal, match: re.Match[str]) -> Found:
    word = match[1]
    element = refusal.element(word)
    attribute = next((k for k, v in element.attributes.items() if v == word), "") if element else ""
    tag = element.tag if element else ""
    removed = schema.REMOVED_VALUES.get((tag, attribute, word))
    if removed:
        message = f"{attribute}={quoted(word)} of <{tag}> was removed {removed[0]}"
        yield schema.REMOVED, refusal.sighting(message, removed[1], word)
        return
    enum = KEYWORDS.get((tag, attribute))
    valid = [name for name, value in members(enum).items() if value not in DRAWN_ONLY] if enum else []
    where = f"{attribute} of <{tag}>: " if attribute else ""
    close = near(word, valid)
    remedy = f'write {attribute}="{close[0]}"' if close else f"valid: {listing(valid)}" if valid else ""
    yield KEYWORD, refusal.sighting(f"{where}no such keyword: {quoted(word)}{suggestion(word, valid)}", remedy, word)


def _value(refusal: Refusal, match: re.Match[str]) -> Found:
    attribute, element = match["attribute"], refusal.element()
    value = element.attributes.get(attribute) if element else None
    shown = f": {quoted(value)}" if value is not None else ""
    remedy = f"write numbers separated by spaces; MuJoCo's XML reference says how many {attribute} takes"
    yield KEYWORD, refusal.sighting(f"{refusal.said}{shown}", remedy)


def _required(refusal: Refusal, match: re.Match[str]) -> Found:
    element, attribute = refusal.element(), match["attribute"]
    what = f"<{clean(element.tag)}>" if element else "an element"
    yield LACKING, refusal.sighting(f"{what} needs the attribute {quoted(attribute)}", f"write {attribute}=…")


def _massless(refusal: Refusal, match: re.Match[str]) -> Found:
    remedy = (
        "give one of its geoms a density or mass, or the body an <inertial pos=… mass=… diaginertia=…/>, "
        "or remove its joints; <compiler boundmass=… boundinertia=…> sets a floor for all bodies"
    )
    what = refusal.element() or "the body"
    yield MASSLESS, refusal.sighting(f"{what} can move and has no mass or no inertia", remedy)


def _rangeless(refusal: Refusal, match: re.Match[str]) -> Found:
    remedy = "write a range with the smaller number first, or remove what says that it is limited"
    why = "it is limited and has no range, or a reversed one"
    if "autolimits" in match[0] or "`limited`" in match[0]:
        remedy = 'remove autolimits="false" from <compiler>, or say limited="true" or limited="false" beside the range'
        why = "is it limited or not?"
    yield RANGELESS, refusal.sighting(f"{refusal.said.partition('. ')[0]}: {why}", remedy)


def _timestep(refusal: Refusal, match: re.Match[str]) -> Found:
    options = [e for e in refusal.source.elements() if e.tag == "option" and "timestep" in e.attributes]
    place = (options[-1].file, options[-1].line) if options else refusal.place
    message = refusal.said.partition(";")[0]
    yield TIMESTEP, Sighting(message, 'write <option timestep="0.002"/>', str(options[-1]) if options else "", place)


def _key(refusal: Refusal, match: re.Match[str]) -> Found:
    name, field, expected, got = match.groups()
    keys = [e for e in refusal.source.elements() if e.tag == "key" and e.attributes.get("name", "") == name]
    sized = [e for e in keys if len(e.attributes.get(field, "").split()) == int(got)]
    key = next(iter(sized or keys), None)
    place = (key.file, key.line) if key else refusal.place
    message = f"{field} of the keyframe holds {got} numbers, and the model has {expected}"
    remedy = "write one number for each; `mjrun info` lists them by joint, actuator and address"
    yield KEY, Sighting(message, remedy, str(key or "<key>"), place)


# Parts of MuJoCo's sentences, and what they stand for; the first that yields anything wins.
EXPLANATIONS: list[tuple[str, Callable[[Refusal, re.Match[str]], Found]]] = [
    (r"XML_|XML parse error|empty file|not UTF-8", _syntax),
    (r"Schema violation|unrecognized model element|World body cannot have attr|Unrecognized XML model type", _schema),
    (r"plugin .* not found|coordinates no longer supported", _schema),
    (r"out of memory|[Cc]ould not allocate", _memory),
    (r"repeated name '(.*)' in (\w+)", _twin),
    (r"unknown default (?P<kind>class) name '(?P<name>.*?)'", _name),
    (r"(?:unknown|unrecognized)(?P<kind>[\w ]*) '(?P<name>.*?)'", _name),
    (r"(?P<kind>\w+) '(?P<name>.*?)' not found in", _name),
    (r"[Ee]rror opening file|could not parse model file|not found|[Uu]nknown skin file|Could not", _files),
    (r"invalid keyword: '(.*?)'", _keyword),
    (r"required attribute missing: '(?P<attribute>\w+)'", _required),
    (r"(?:bad format in|problem reading|error in)? ?attribute '(?P<attribute>\w+)'", _value),
    (r"mass and inertia of moving bodies", _massless),
    (r"range\[0\] should be smaller|has `\w*range` but not `\w*limited`", _rangeless),
    (r"invalid \w* ?range (?:for actuator|in tendon|in joint)", _rangeless),
    (r"its timestep is", _timestep),
    (r"keyframe '(.*)': invalid (\w+) size, expected (\d+), got (\d+)", _key),
]
