"""Why MuJoCo refused a model: its one sentence, turned into all findings of that kind."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path

from mjrun.check.compile_error import Refusal
from mjrun.check.finding import Sighting
from mjrun.check.rules import asset_files, keywords, mjcf_schema, unknown_names
from mjrun.check.rules.keywords import KEYWORD
from mjrun.check.xml_source import Source, attached_files, read
from mjrun.errors import BrokenModelError, ModelError, clean, quoted
from mjrun.model.load import load

REFUSED, SYNTAX, MEMORY = "MJ100", "MJ101", "MJ004"
TWIN, LACKING, TIMESTEP = "MJ108", "MJ112", "MJ114"
MASSLESS, RANGELESS, KEY = "MJ202", "MJ303", "MJ405"

Found = Iterator[tuple[str, Sighting]]
# Sentences that need no more than a remedy.
CURES = (
    (r"World body cannot have joints", "the world does not move; put the joint into a <body>"),
    (r"free joint can only be used on top level", "move the body directly into <worldbody>, or give it other joints"),
    (r"size \d must be positive", "give it a size, or fromto: a sphere has 1 number, a capsule 2, a box 3"),
    (r"plugin .* not found", "mjrun knows the plugins that come with MuJoCo, and no others"),
    (r"already included", "a file is included once; put what repeats into <default>, or attach it as a <model>"),
    (
        r"no decoder found for mesh",
        "MuJoCo reads meshes in STL, OBJ and MSH; convert it to one of them, as Blender does",
    ),
    (
        r"Unrecognized XML model type: 'mujocoinclude'",
        "this is a part of a model: <include> it, or make its root <mujoco>",
    ),
    (r"Unrecognized XML model type", "the root element of MJCF is <mujoco>, that of URDF <robot>"),
    (r"attached to itself|recursive", "attach another file"),
)
OWN = re.compile(r"Schema violation|invalid keyword|XML_|XML parse error")  # said before anything is attached
_REFERENCE = "MuJoCo's XML reference lists them: https://mujoco.readthedocs.io/en/stable/XMLreference.html"


def explain(error: BrokenModelError, source: Source, above: frozenset[Path] = frozenset()) -> Found:
    """The findings that `error` of the model `source` stands for, one at least.

    A mistake in a model that is attached is told of that model; `above` are those that attach `source`.
    """
    refusal = Refusal.of(error, source)
    above |= {source.path.resolve()}
    broken = () if OWN.match(refusal.message) else _broken(source, above)
    below = [(error, part) for error, part in broken if Refusal.of(error, part).form in refusal.form]
    if not below:
        yield from _explained(refusal)
        return
    for error, part in below:
        yield from explain(error, part, above)
    yield from _unread(source)
    yield from asset_files.missing(source)


def _broken(source: Source, above: frozenset[Path]) -> Iterator[tuple[BrokenModelError, Source]]:
    """The models that `source` attaches, and that MuJoCo refuses by themselves."""
    found = [] if source.circular else attached_files(source.elements(), source.path)
    for path in dict.fromkeys(path for path in found if path.resolve() not in above):
        try:
            load(path)
        except BrokenModelError as error:
            yield error, read(path)
        except ModelError:  # it is told where it is attached
            continue


def _explained(refusal: Refusal) -> Found:
    """The findings of the first explanation that finds any, after files that are none."""
    pointers = list(asset_files.pointers(refusal.source))
    yield from pointers
    for pattern, explained in EXPLANATIONS:
        match = re.search(pattern, refusal.message)
        found = list(explained(refusal, match)) if match else []
        if found:
            yield from found
            return
    if not pointers:
        yield from _plain(refusal)


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
    yield from _unread(refusal.source)


def _unread(source: Source) -> Found:
    """Everything in the XML that MuJoCo does not know."""
    found = [*mjcf_schema.violations(source), *keywords.wrong(source)]
    yield from sorted(found, key=lambda found: _order(found[1], source))


def _order(sighting: Sighting, source: Source) -> tuple[bool, str, int]:
    file, line, *_ = sighting.place or (source.path, None)
    return file != source.path, str(file), line or 0


def _files(refusal: Refusal, match: re.Match[str]) -> Found:
    yield from asset_files.missing(refusal.source)


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


def _keyword(refusal: Refusal, match: re.Match[str]) -> Found:
    found = list(_schema(refusal, match))
    yield from found
    if all(code not in (KEYWORD, mjcf_schema.REMOVED) for code, _ in found):
        yield KEYWORD, refusal.sighting(f"no such keyword: {quoted(match[1])}", _REFERENCE, match[1])


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
    name, number, field, expected = match["name"], match["number"], match["field"], int(match["expected"])
    keys = [e for e in refusal.source.elements() if e.tag == "key"]
    told = keys[int(number) :][:1] if number else [e for e in keys if e.attributes.get("name", "") == name]
    wrong = [e for e in told if len(e.attributes.get(field, "").split()) not in (0, expected)]
    key = next(iter(wrong or told), None)
    place = (key.file, key.line) if key else refusal.place
    held = len(key.attributes.get(field, "").split()) if key else 0
    counted = f"{held} number{'s' * (held != 1)}" if key else "too few or too many numbers"
    message = f"{field} of the keyframe holds {counted}, and the model has {expected}"
    remedy = "write one number for each; `mjrun info` lists them by joint, actuator and address"
    yield KEY, Sighting(message, remedy, str(key or "<key>"), place)


# Parts of MuJoCo's sentences, and what they stand for; the first that yields anything wins.
EXPLANATIONS: list[tuple[str, Callable[[Refusal, re.Match[str]], Found]]] = [
    (r"XML_|XML parse error|empty file|not UTF-8", _syntax),
    (r"Schema violation|unrecognized model element|World body cannot have attr|Unrecognized XML model type", _schema),
    (r"plugin .* not found|coordinates no longer supported", _schema),
    (r"out of memory|[Cc]ould not allocate", _memory),
    (r"repeated name '(.*)' in (\w+)", _twin),
    (r"unknown (?P<kind>target body|default childclass)", unknown_names.nameless),
    (r"unknown default (?P<kind>class) name '(?P<name>.*?)'", unknown_names.unknown),
    (r"(?:unknown|unrecognized)(?P<kind>[\w ]*) '(?P<name>.*?)'", unknown_names.unknown),
    (r"could not find (?P<kind>\w+) '(?P<name>.*?)'", unknown_names.unknown),
    (r"(?P<kind>\w+) '(?P<name>.*?)' not found in", unknown_names.unknown),
    (r"[Ee]rror opening file|could not parse model file|not found|[Uu]nknown skin file|Could not", _files),
    (r"invalid keyword: '(.*?)'", _keyword),
    (r"required attribute missing: '(?P<attribute>\w+)'", _required),
    (r"(?:bad format in|problem reading|error in)? ?attribute '(?P<attribute>\w+)'", _value),
    (r"mass and inertia of moving bodies", _massless),
    (r"range\[0\] should be smaller|has `\w*range` but not `\w*limited`", _rangeless),
    (r"invalid \w* ?range (?:for actuator|in tendon|in joint)", _rangeless),
    (r"its timestep is", _timestep),
    (
        r"keyframe (?:'(?P<name>.*)'|(?P<number>\d+)): invalid (?P<field>\w+) size, "
        r"expected (?:length )?(?P<expected>\d+)(?:, got (?P<got>\d+))?",
        _key,
    ),
]
