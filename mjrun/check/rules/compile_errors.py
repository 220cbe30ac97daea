"""Reasons why a model does not load: from MuJoCo's message about the first error, all errors of that kind."""

import itertools
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from mjrun.check.finding import Finding, Fix, MakeFix, Place, short_path
from mjrun.check.rule import NOT_CERTAIN, SAFE, Rule
from mjrun.check.rules import asset_files, limits, mjcf_schema
from mjrun.check.rules.check_itself import OUT_OF_MEMORY
from mjrun.check.rules.keyframes import SIZE_REMEDY, incomplete_keyframes, size_message
from mjrun.check.rules.mjcf_schema import BAD_VALUE, REMOVED
from mjrun.errors import BrokenModelError, ModelError, clean, listing, near, option, quoted, spelled, suggestion
from mjrun.model.sources import load
from mjrun.model.text_edits import ElementEditor
from mjrun.model.xml_source import Element, XmlSource, attached_files, read_xml, xml_paths

COMPILE_ERROR = Rule("MJ100", "error", "model that does not load")
NOT_WELL_FORMED = Rule("MJ101", "error", "not well-formed XML")
DUPLICATE_NAME = Rule("MJ108", "error", "duplicate name", fix=SAFE)
UNKNOWN_NAME = Rule("MJ109", "error", "reference to an unknown name")
MISSING_ATTRIBUTE = Rule("MJ112", "error", "missing attribute")
SELF_ATTACHED = Rule("MJ113", "error", "model that attaches itself")
BAD_TIMESTEP = Rule("MJ114", "error", "timestep that is not positive")
WARNING = Rule("MJ115", "warning", "MuJoCo warns while loading")
MASSLESS_BODY = Rule("MJ202", "error", "moving body without mass", fix=SAFE)
MISSING_RANGE = Rule("MJ303", "error", "limit without range", fix=SAFE)

Findings = Iterator[Finding]
# Messages that need only a remedy.
REMEDIES = (
    (r"World body cannot have joints", "the world does not move; put the joint into a <body>"),
    (r"free joint can only be used on top level", "move the body directly into <worldbody>, or give it other joints"),
    (r"size \d must be positive", "give it a size, or fromto: a sphere has 1 number, a capsule 2, a box 3"),
    (r"plugin .* not found", "mjrun supports only the plugins that come with MuJoCo"),
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
BEFORE_ATTACHING = re.compile(r"Schema violation|invalid keyword|XML_|XML parse error")
_REFERENCE = "MuJoCo's XML reference lists them: https://mujoco.readthedocs.io/en/stable/XMLreference.html"


class CompileFailure(NamedTuple):
    """An error of MuJoCo's parser or compiler, or of mjrun, which refuses models that would crash MuJoCo.

    Attributes:
      source: the model.
      path: the model, or the part of it with the error.
      message: the message in one line, without the line number and the hint.
      line: the line in the model, or in a model that it attaches; None or 0 if unknown.
      hint: the remedy; empty if the error contains none.
    """

    source: XmlSource
    path: Path
    message: str
    line: int | None
    hint: str = ""

    @classmethod
    def of(cls, error: BrokenModelError, source: XmlSource) -> "CompileFailure":
        """Returns the compile error that `error` of the model `source` describes."""
        place = clean(str(error.path)) + (f":{error.line}" if error.line else "")
        hint = f"\n{spelled(error.hint)}" if error.hint else ""
        message = str(error).removeprefix(f"{place}: ").removesuffix(hint)
        return cls(source, error.path, "; ".join(message.splitlines()), error.line, error.hint)

    @property
    def text(self) -> str:
        """The message without MuJoCo's own description of the element."""
        return re.sub(r"; Element .*", "", self.message)

    @property
    def pattern(self) -> str:
        """The message without names and numbers, which change when a model is attached."""
        return re.sub(r"'.*?'|\d+", "", self.text)

    @property
    def place(self) -> Place:
        """The file of the error, with the line unless the line may be in an attached model."""
        if self.path != self.source.path:
            return Place(self.path, self.line or None)
        return Place(self.path, None if self.source.attached else self.line or None)

    def element(self, value: str = "") -> Element | None:
        """Returns the element that the message refers to; it has an attribute `value`, unless that is empty."""
        name = re.search(r"; Element name '(.+)', id", self.message)
        value = value or (name[1] if name else "")
        words = set(re.findall(r"\w+", self.message))
        if not self.line:  # it is in an included file, whose lines MuJoCo does not record
            candidates = [e for e in self._elements() if value and value in e.attributes.values()]
            return next((e for e in candidates if e.tag in words), next(iter(candidates), None))

        files = {self.path}
        if self.path == self.source.path:
            files |= {root.file for root in self.source.attached}  # MuJoCo does not report which
        candidates = [e for e in self._elements() if e.line == self.line and e.file in files]
        candidates = [e for e in candidates if value in e.attributes.values()] or candidates
        candidates = [e for e in candidates if e.tag in words] or candidates
        return candidates[0] if len({e.file for e in candidates}) == 1 else None

    def _elements(self) -> Iterator[Element]:
        yield from self.source.elements()
        yield from (e for root in self.source.attached for e in root.walk())

    def finding(self, rule: Rule, message: str, remedy: str, value: str = "", fix: MakeFix | None = None) -> Finding:
        """Returns a violation of `rule` by the element that the message refers to."""
        element = self.element(value)
        if element is None:
            return rule.finding(message, remedy, self.place, fix=fix)
        return rule.in_element(element, message, remedy, fix)


def explain(error: BrokenModelError, source: XmlSource, parents: frozenset[Path] = frozenset()) -> Findings:
    """Yields the findings, at least one, for `error` in the model `source`.

    An error in an attached model is reported for that model; `parents` are the models that attach `source`.
    """
    compile_error = CompileFailure.of(error, source)
    parents |= {source.path.resolve()}
    broken = () if BEFORE_ATTACHING.match(compile_error.message) else _broken_attached(source, parents)
    causes = [(e, part) for e, part in broken if CompileFailure.of(e, part).pattern in compile_error.pattern]
    if not causes:
        yield from _explain(compile_error)
        return
    yield from asset_files.missing_files(source)
    for cause, part in causes:
        yield from explain(cause, part, parents)
    yield from _invalid_xml(source)


def _broken_attached(source: XmlSource, parents: frozenset[Path]) -> Iterator[tuple[BrokenModelError, XmlSource]]:
    """Yields the models that `source` attaches, and that MuJoCo rejects by themselves."""
    paths = [] if source.circular else attached_files(source.elements(), source.path)
    for path in dict.fromkeys(path for path in paths if path.resolve() not in parents):
        try:
            load(path)
        except BrokenModelError as error:
            yield error, read_xml(path)
        except ModelError:  # it is reported where it is attached
            continue


def _explain(error: CompileFailure) -> Findings:
    """Yields missing files, which MuJoCo reports one at a time, and the findings of the first explanation with any."""
    pointers = list(asset_files.lfs_pointers(error.source))
    explained = _first_explanation(error)
    places = {(finding.code, finding.file, finding.line) for finding in explained}
    files = (*pointers, *asset_files.missing_files(error.source))
    yield from (finding for finding in files if (finding.code, finding.file, finding.line) not in places)
    yield from explained
    if not explained and not pointers:
        remedy = next((remedy for pattern, remedy in REMEDIES if re.search(pattern, error.message)), error.hint)
        yield error.finding(COMPILE_ERROR, f"the model does not load: {error.text}", remedy)


def _first_explanation(error: CompileFailure) -> list[Finding]:
    for pattern, explanation in EXPLANATIONS:
        match = re.search(pattern, error.message)
        if match and (findings := list(explanation(error, match))):
            return findings
    return []


def _syntax(error: CompileFailure, match: re.Match[str]) -> Findings:
    for xml_error in error.source.errors:
        place = Place(xml_error.file, xml_error.line)
        yield NOT_WELL_FORMED.finding(xml_error.message, xml_error.remedy, place)
    if not error.source.errors:
        remedy = "look at this line and just before it: MuJoCo reports nothing else" if error.line else ""
        yield NOT_WELL_FORMED.finding(f"not well-formed XML: {error.message}", remedy, error.place)


def _invalid_xml(source: XmlSource) -> Findings:
    """Yields findings for all elements, attributes and keywords in the XML that MuJoCo does not know."""
    findings = [*mjcf_schema.violations(source, source.root), *mjcf_schema.invalid_keywords(source)]
    own = short_path(source.path)
    yield from sorted(findings, key=lambda finding: (finding.file != own, finding.file, finding.line or 0))


def _schema(error: CompileFailure, match: re.Match[str]) -> Findings:
    return _invalid_xml(error.source)


def _files(error: CompileFailure, match: re.Match[str]) -> Findings:
    return asset_files.missing_files(error.source)


def _special_file(error: CompileFailure, match: re.Match[str]) -> Findings:
    yield error.finding(asset_files.MISSING_FILE, error.text, "name a regular file", match[1])


def _included_again(error: CompileFailure, match: re.Match[str]) -> Findings:
    name = match[1]
    again = [
        e for e in error.source.elements() if e.tag == "include" and Path(e.attributes.get("file", "")).name == name
    ]
    remedy = "a file is included once, and not by itself; put what repeats into <default>, or attach it as a <model>"
    for element in again:
        yield COMPILE_ERROR.in_element(element, f"the model does not load: {error.text}", remedy)


def _mesh(error: CompileFailure, match: re.Match[str]) -> Findings:
    """Yields a finding for the mesh, whose file may be damaged."""
    name, message = match["name"], f"the model does not load: {match['text']}"
    message += f", in mesh {quoted(name)}" if name not in match["text"] else ""
    remedy = "look at its file: it is flat, incomplete or damaged"
    meshes = [e for e in error.source.elements() if e.tag == "mesh" and _name(e, "mesh") == name]
    pointers = {finding.line for finding in asset_files.lfs_pointers(error.source)}  # which have their own finding
    for mesh in meshes[:1]:
        if mesh.line not in pointers:
            yield COMPILE_ERROR.in_element(mesh, message, remedy)


def _not_finite(error: CompileFailure, match: re.Match[str]) -> Findings:
    """Yields a finding for each attribute with a number like that in mjrun's message."""
    value = float(match[1])
    for element in error.source.elements():
        for attribute, text in element.attributes.items():
            if attribute not in ("name", "file", *REFERENTS) and any(_is_same(word, value) for word in text.split()):
                message = f"{attribute} must be finite: {quoted(text)}"
                yield BAD_VALUE.in_element(
                    element, message, "write finite numbers; MuJoCo's reference has the defaults"
                )


def _is_same(word: str, value: float) -> bool:
    """Returns whether a word is the number `value`, which may be NaN."""
    try:
        return repr(float(word)) == repr(value)
    except ValueError:
        return False


def _circle(error: CompileFailure, match: re.Match[str]) -> Findings:
    yield error.finding(SELF_ATTACHED, error.text, f"{error.hint}; <replicate> repeats a part of a model")


def _memory(error: CompileFailure, match: re.Match[str]) -> Findings:
    remedy = f"raise {option('memory')}, or look for a count, a size or a resolution that is too large"
    yield OUT_OF_MEMORY.finding("the model needs more memory than allowed", remedy, error.place)


def _duplicate_name(error: CompileFailure, match: re.Match[str]) -> Findings:
    name, kind = match.groups()
    duplicates = [e for e in error.source.elements() if e.attributes.get("name") == name]
    reported = error.element(name)
    duplicates = [e for e in duplicates if reported is None or e.tag == reported.tag]
    remedy = f"rename one of them; names are unique among all of kind {kind}"
    if len(duplicates) < 2:
        yield error.finding(DUPLICATE_NAME, f"the name {quoted(name)} is given twice in {kind}", remedy, name)
        return
    first, *others = duplicates
    for other in others:
        place = f"{first.file}:{first.line}" if first.file != other.file else f"line {first.line}"
        message = f"the name {quoted(name)} is already taken on {place}"
        yield DUPLICATE_NAME.in_element(other, message, remedy, partial(_renamed, error.source, others, other))


def _renamed(source: XmlSource, others: list[Element], other: Element) -> Fix:
    """Returns the fix that adds a number to the name of one of several elements; references keep the first one."""
    taken = {name for e in source.elements() if (name := e.attributes.get("name"))}
    name = other.attributes["name"]
    free = (f"{name}_{i}" for i in itertools.count(2) if f"{name}_{i}" not in taken)
    new = next(itertools.islice(free, others.index(other), None))
    return Fix((ElementEditor(source.mjcf_texts).with_value(other, "name", new),))


def _keyword(error: CompileFailure, match: re.Match[str]) -> Findings:
    findings = list(_invalid_xml(error.source))
    yield from findings
    if all(finding.code not in (BAD_VALUE.code, REMOVED.code) for finding in findings):
        yield error.finding(BAD_VALUE, f"no such keyword: {quoted(match[1])}", _REFERENCE, match[1])


def _value(error: CompileFailure, match: re.Match[str]) -> Findings:
    attribute, element = match["attribute"], error.element()
    value = element.attributes.get(attribute) if element else None
    shown = f": {quoted(value)}" if value is not None else ""
    remedy = f"write numbers separated by spaces; MuJoCo's XML reference states how many {attribute} needs"
    yield error.finding(BAD_VALUE, f"{error.text}{shown}", remedy)


def _missing_attribute(error: CompileFailure, match: re.Match[str]) -> Findings:
    element, attribute = error.element(), match["attribute"]
    what = f"<{clean(element.tag)}>" if element else "an element"
    message = f"{what} needs the attribute {quoted(attribute)}"
    yield error.finding(MISSING_ATTRIBUTE, message, f"write {attribute}=…")


def _massless_body(error: CompileFailure, match: re.Match[str]) -> Findings:
    remedy = (
        "give one of its geoms a density or mass, or the body an <inertial pos=… mass=… diaginertia=…/>, "
        "or remove its joints; <compiler boundmass=… boundinertia=…> sets a floor for all bodies"
    )
    element = error.element()
    if element and element.within("robot"):
        remedy = (
            "give the link an <inertial> with <mass value=…/> and <inertia ixx=… iyy=… izz=… ixy=… ixz=… iyz=…/>, "
            "or make its joint fixed"
        )
    what = element or "the body"
    message = f"{what} can move, but has no mass or no inertia"
    yield error.finding(MASSLESS_BODY, message, remedy, fix=partial(_inferred, error))


def _inferred(error: CompileFailure) -> Fix | str:
    """Returns the fix that infers the inertia of bodies without one, if the model prevents that."""
    body = error.element()
    compilers = [e for e in error.source.elements() if e.tag == "compiler" and "inertiafromgeom" in e.attributes]
    inside = {child.tag for child in body.children} if body else set[str]()
    if not compilers or compilers[-1].attributes["inertiafromgeom"] != "false":
        return NOT_CERTAIN
    if "inertial" in inside or "geom" not in inside:
        return "the body has no geoms from which its inertia could be inferred, or has an <inertial>"
    return Fix((ElementEditor(error.source.mjcf_texts).with_value(compilers[-1], "inertiafromgeom", "auto"),))


def _missing_range(error: CompileFailure, match: re.Match[str]) -> Findings:
    remedy = "write a range with the smaller number first, or do not declare it limited"
    reason, fix = "it is limited, but has no range or a reversed one", limits.swapped_ranges
    if "but not" in match[0]:
        remedy = 'remove autolimits="false" from <compiler>, or write limited="true" or "false" beside the range'
        reason, fix = "is it limited or not?", limits.enabled_ranges
    message = f"{error.text.partition('. ')[0]}: {reason}"
    finding = error.finding(MISSING_RANGE, message, remedy, fix=partial(fix, error.source))
    culprits = [element for element, _ in limits.elements_with_reversed_range(error.source)]
    if not finding.line and len(culprits) == 1:  # in an included file, whose lines MuJoCo does not record
        finding = replace(finding, file=short_path(culprits[0].file), line=culprits[0].line, object=str(culprits[0]))
    yield finding


def _timestep(error: CompileFailure, match: re.Match[str]) -> Findings:
    options = [e for e in error.source.elements() if e.tag == "option" and "timestep" in e.attributes]
    message, remedy = error.text.partition(";")[0], 'write <option timestep="0.002"/>'
    if options:
        yield BAD_TIMESTEP.in_element(options[-1], message, remedy)
    else:
        yield BAD_TIMESTEP.finding(message, remedy, error.place)


def _keyframe_size(error: CompileFailure, match: re.Match[str]) -> Findings:
    name, number, field, expected = match["name"], match["number"], match["field"], int(match["expected"])
    keys = [e for e in error.source.elements() if e.tag == "key"]
    candidates = keys[int(number) :][:1] if number else [e for e in keys if e.attributes.get("name", "") == name]
    wrong = [e for e in candidates if len(e.attributes.get(field, "").split()) not in (0, expected)]
    key = next(iter(wrong or candidates), None)
    if key:
        message = size_message(field, len(key.attributes.get(field, "").split()), expected)
        yield incomplete_keyframes.in_element(key, message, SIZE_REMEDY)
    else:
        message = f"{field} of the keyframe does not have {expected} numbers, as the model does"
        yield incomplete_keyframes.finding(message, SIZE_REMEDY, error.place, "<key>")


def _unknown_name(error: CompileFailure, match: re.Match[str]) -> Findings:
    """Yields a finding for the reference in MuJoCo's message, with the valid names."""
    name = match["name"]
    element = error.element(name)
    attribute = next((key for key, value in element.attributes.items() if value == name), "") if element else ""
    kinds = (attribute.rstrip("12"), match["kind"].strip())  # `joint1="knee"` says more than the message
    kind = next((word for word in kinds if word in REFERENTS), "")
    missing = asset_files.elements_without_file(error.source)
    candidates = [e for e in _candidates(error, element, kind) if e not in missing]
    hint, remedy = _valid_names(name, kind, candidates)
    if kind in NAMED_BY_FILE and (asset := asset_files.asset_of_other_file(error.source, kind, name)):
        hint, remedy = "", f"correct the file of the <{kind}> on line {asset.line}, which gives it its name"
    yield error.finding(UNKNOWN_NAME, f"{error.text}{hint}", remedy, name)


def _unquoted_name(error: CompileFailure, match: re.Match[str]) -> Findings:
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


def _candidates(error: CompileFailure, element: Element | None, kind: str) -> list[Element]:
    """Returns the elements that can have the name: those of the attached model for a reference in `<attach>`."""
    if element is None or element.tag != "attach" or kind == "model":
        return list(error.source.elements())
    models = [e for e in error.source.elements() if e.tag == "model"]
    attached = (e for e in models if e.attributes.get("name") == element.attributes.get("model"))
    paths = [path for model in attached for path in xml_paths(model, error.source.path)]
    return [e for root in error.source.attached if root.file in paths for e in root.walk()]


def _valid_names(name: str, kind: str, elements: list[Element]) -> tuple[str, str]:
    """Returns a suggestion in place of `name`, and a remedy."""
    valid = [other for other in _names(kind, elements) if other != name]
    what = f"names of kind {kind}" if kind else "names in the model"
    close = near(name, valid)
    choices = f"{what}: {listing(valid)}" if valid else f"the model has no {what}"
    if not close:
        return suggestion(name, valid), choices
    return suggestion(name, valid), f"write {quoted(close[0])}" + (f"; {choices}" if len(valid) > 1 else "")


def _names(kind: str, elements: list[Element]) -> list[str]:
    """Returns the names of a kind, or all names if it is empty."""
    candidates = [e for e in elements if not kind or REFERENTS[kind](e)]
    return sorted({name for e in candidates if (name := _name(e, kind))})


def _name(element: Element, kind: str) -> str:
    if kind == "class":
        return element.attributes.get("class", "")
    stem = Path(element.attributes.get("file", "")).stem if element.tag in NAMED_BY_FILE else ""
    return element.attributes.get("name") or stem


# Patterns in MuJoCo's messages, and the functions that explain them; the first one with findings wins.
EXPLANATIONS: list[tuple[str, Callable[[CompileFailure, re.Match[str]], Findings]]] = [
    (r"XML_|XML parse error|empty file|not UTF-8", _syntax),
    (
        r"Schema violation|unrecognized model element|World body cannot have attr|Unrecognized XML model type",
        lambda error, match: _invalid_xml(error.source),
    ),
    (r"plugin .* not found|coordinates no longer supported", _schema),
    (r"out of memory|[Cc]ould not allocate", _memory),
    (r"repeated name '(.*)' in (\w+)", _duplicate_name),
    (r"unknown (?P<kind>target body|default childclass)", _unquoted_name),
    (r"unknown default (?P<kind>class) name '(?P<name>.*?)'", _unknown_name),
    (r"(?:unknown|unrecognized)(?P<kind>[\w ]*) '(?P<name>.*?)'", _unknown_name),
    (r"could not find (?P<kind>\w+) '(?P<name>.*?)'", _unknown_name),
    (r"(?P<kind>\w+) '(?P<name>.*?)' not found in", _unknown_name),
    (r"[Ee]rror opening file|could not parse model file|not found|[Uu]nknown skin file|Could not", _files),
    (r"'(.*)' is .*; a model is read from regular files", _special_file),
    (r"or attaches this model again", _circle),
    (r"File '(.*)' already included", _included_again),
    (
        r"(?P<text>(?:qhull error|at least \d+ vertices|mesh '.*' has|mesh volume|mesh surface).*); Element name "
        r"'(?P<name>.*)', id",
        _mesh,
    ),
    (r"must be finite, not (nan|-?inf)", _not_finite),
    (r"invalid keyword: '(.*?)'", _keyword),
    (r"required attribute missing: '(?P<attribute>\w+)'", _missing_attribute),
    (r"(?:bad format in|problem reading|error in)? ?attribute '(?P<attribute>\w+)'", _value),
    (r"mass and inertia of moving bodies", _massless_body),
    (r"range\[0\] should be smaller|has `\w*range` but not `\w*limited`", _missing_range),
    (r"invalid (?:\w* ?range|limits) (?:for actuator|in tendon|in joint)", _missing_range),
    (r"the timestep must be", _timestep),
    (
        r"keyframe (?:'(?P<name>.*)'|(?P<number>\d+)): invalid (?P<field>\w+) size, "
        r"expected (?:length )?(?P<expected>\d+)(?:, got (?P<got>\d+))?",
        _keyframe_size,
    ),
]
