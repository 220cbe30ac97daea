"""Violations of MuJoCo's own XML schema, all of them, with suggestions, and what MJCF no longer has.

MuJoCo stops at the first violation or unknown keyword, and ignores attributes inside `<frame>` and `<replicate>`.
Elements and values that were removed, or never existed, have their replacements from MuJoCo's changelog.
"""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import field
from functools import cache, partial

import mujoco

from mjrun.check.finding import Finding, Fix, Place
from mjrun.check.rule import NOT_CERTAIN, SAFE, Rule
from mjrun.dataclass import dataclass
from mjrun.errors import clean, listing, near, quoted, suggestion
from mjrun.model.text_edits import ElementEditor
from mjrun.model.xml_source import Element, XmlSource, holder

FLEXCOMP = 'use <flexcomp type="grid" dim="1" …> with <elasticity young=… shear=…/> or <edge equality="true"/>'

# The version without the element, alone or in its parent, and the remedy.
REMOVED_ELEMENTS = {
    "composite": ("in MuJoCo 4.0.0", f"{FLEXCOMP}; cloth and soft bodies are <flexcomp> of dim 2 and 3"),
    "flexvert": (
        "in MuJoCo 4.0.0",
        'use continuum <elasticity> with integrator="discrete", or <edge equality="true"/> for cloth',
    ),
    "equality/distance": (
        "in MuJoCo 2.2.2",
        "connect sites of both bodies by a <spatial> tendon, and keep its length by <tendon> in <equality>",
    ),
}

REMOVED_PLUGINS = {
    "mujoco.elasticity.cable": ("in MuJoCo 4.0.0", FLEXCOMP),
    "mujoco.elasticity.shell": ("in MuJoCo 3.3.3", 'use <flexcomp dim="2"> with <elasticity>'),
    "mujoco.elasticity.solid": ("in MuJoCo 3.2.4", 'use <flexcomp dim="3"> with <elasticity>'),
    "mujoco.elasticity.membrane": ("in MuJoCo 3.2.4", 'use <flexcomp dim="2"> with <elasticity>'),
    "mujoco.sdf.sdflib": ("in MuJoCo 3.3.5", 'use a separate mesh: <geom type="sdf" mesh=…>'),
}

# The version without the attribute of an element, and the remedy.
REMOVED_ATTRIBUTES = {
    ("option", "collision"): (
        "in MuJoCo 3.0.0",
        'delete collision="all"; for "predefined" write <default><geom contype="0" conaffinity="0"/></default>',
    ),
    ("option", "apirate"): ("in MuJoCo 3.3.7", "delete it; it had no effect"),
    ("option", "mpr_iterations"): ("in MuJoCo 3.2.3", "write ccd_iterations"),
    ("option", "mpr_tolerance"): ("in MuJoCo 3.2.3", "write ccd_tolerance"),
    ("compiler", "convexhull"): ("in MuJoCo 3.2.5", "delete it; convex hulls are made where they are needed"),
    ("compiler", "exactmeshinertia"): ("in MuJoCo 3.2.5", 'write <mesh inertia="exact"> on the meshes that need it'),
    ("joint", "actuatorforcerange"): ("in MuJoCo 3.0.0", "write actuatorfrcrange"),
    ("joint", "actuatorforcelimited"): ("in MuJoCo 3.0.0", "write actuatorfrclimited"),
    ("camera", "orthographic"): ("in MuJoCo 3.5.0", 'write projection="orthographic"'),
    ("flag", "passive"): ("in MuJoCo 3.3.6", "write spring and damper"),
    ("flag", "sensornoise"): ("in MuJoCo 3.1.4", "delete it; add noise where sensors are read"),
    ("contact", "internal"): ("in MuJoCo 3.15.0", "write selfcollide"),
}

# Attributes that have another name now, and values that are written as other attributes, or no longer needed.
RENAMED_ATTRIBUTES = {
    ("option", "mpr_iterations"): "ccd_iterations",
    ("option", "mpr_tolerance"): "ccd_tolerance",
    ("joint", "actuatorforcerange"): "actuatorfrcrange",
    ("joint", "actuatorforcelimited"): "actuatorfrclimited",
}
REWRITTEN_VALUES: dict[tuple[str, str, str], dict[str, str]] = {
    ("option", "collision", "all"): {},
    ("compiler", "convexhull", "true"): {},
    ("compiler", "convexhull", "false"): {},
    ("compiler", "exactmeshinertia", "false"): {},
    ("flag", "sensornoise", "enable"): {},
    ("flag", "sensornoise", "disable"): {},
    ("flag", "passive", "enable"): {},
    ("flag", "passive", "disable"): {"spring": "disable", "damper": "disable"},
    ("camera", "orthographic", "true"): {"projection": "orthographic"},
    ("camera", "orthographic", "false"): {"projection": "perspective"},
    ("contact", "internal", "false"): {},
}
# The fields of the compiled model on which they act, where MuJoCo ignores what it does not know, as in <frame>.
REWRITTEN_FIELDS = {"joint": ("jnt_actfrc*",), "camera": ("cam_projection",)}
UNKNOWN_ELEMENT = Rule("MJ102", "error", "unknown element")
MISPLACED_ELEMENT = Rule("MJ103", "error", "element in the wrong place")
UNKNOWN_ATTRIBUTE = Rule("MJ104", "error", "unknown attribute")
REMOVED = Rule("MJ105", "error", "removed from MuJoCo", fix=SAFE)
STRAY_VALUE = Rule("MJ106", "error", "value outside an attribute")
REPEATED_ELEMENT = Rule("MJ111", "error", "repeated element")

BODY = "(world)body"  # the schema's name for the node of both
POSE = {"pos", "quat", "axisangle", "xyaxes", "zaxis", "euler"}
# Elements in MuJoCo's XML reference that are missing from its schema.
UNLISTED: dict[str, frozenset[str]] = {
    "worldbody": frozenset(),
    "frame": frozenset({"name", "childclass", *POSE}),
    "replicate": frozenset({"count", "sep", "offset", "euler", "childclass"}),
    "include": frozenset({"file"}),
}
UNLIKELY_PARENTS = ("default", "frame", "replicate")  # valid, but seldom what was meant
BAD_VALUE = Rule("MJ110", "error", "bad value of an attribute")

TRUTH, AUTO, SWITCH = "true false", "true false auto", "enable disable"
SHAPES = "plane hfield sphere capsule ellipsoid cylinder box mesh sdf"
FOLLOWING = "fixed track trackcom targetbody targetbodycom"
DYNAMICS = "none integrator filter filterexact pid dcmotor muscle user"
INPUTS = "none pos vel expmap quat ff voltage pressure"
PARAMETRIC_MESHES = "square hemisphere cone wedge plate supersphere supertorus"
DOF = "full radial trilinear quadratic 2d"
ANY = "*"
# Elements, some of their attributes, and the keywords that these accept.
TABLE = (
    ("compiler", "angle", "radian degree"),
    ("compiler", "inertiafromgeom", AUTO),
    ("compiler", "coordinate", "local global"),
    ("compiler", "conflict", "warning merge error"),
    ("compiler", "passthrough", "none textures"),
    ("compiler", "autolimits alignfree balanceinertia discardvisual fitaabb fusestatic", TRUTH),
    ("compiler", "strippath savecanonical savecompiled saveinertial usethread", TRUTH),
    ("lengthrange", "mode", "none muscle muscleuser all"),
    ("lengthrange", "useexisting uselimit", TRUTH),
    ("option", "integrator", "Euler RK4 implicit implicitfast discrete"),
    ("option", "cone", "pyramidal elliptic"),
    ("option", "jacobian", "dense sparse auto"),
    ("option", "solver", "PGS CG Newton"),
    ("flag", "actuation autoreset clampctrl constraint contact damper diagexact energy equality eulerdamp", SWITCH),
    ("flag", "filterparent frictionloss fwdinv gravity invdiscrete ipc island limit midphase multiccd", SWITCH),
    ("flag", "nativeccd override refsafe sensor sleep speculative spring warmstart", SWITCH),
    ("global", "bvactive ellipsoidinertia orthographic", TRUTH),
    ("mesh", "inertia", "convex exact legacy shell"),
    ("mesh", "builtin", f"none sphere ellipsoid cylinder box disc grid {PARAMETRIC_MESHES}"),
    ("mesh", "smoothnormal", TRUTH),
    ("texture", "type", "2d cube skybox"),
    ("texture", "colorspace", "auto linear sRGB"),
    ("texture", "builtin", "none gradient checker flat"),
    ("texture", "mark", "none edge cross random"),
    ("texture", "hflip vflip", TRUTH),
    ("texture", "embed", AUTO),
    ("material", "texuniform", TRUTH),
    ("body", "mocap", TRUTH),
    ("body", "sleep", "auto never allowed init"),
    ("body", "simple fuse", "false auto"),
    ("joint", "type", "free ball slide hinge"),
    ("joint", "actuatorgravcomp", TRUTH),
    ("freejoint", "align", AUTO),
    ("geom site", "type", SHAPES),
    ("geom", "fluidshape", "none ellipsoid"),
    ("geom", "shellinertia", TRUTH),
    ("geom light", "castshadow", TRUTH),
    ("camera light", "mode", FOLLOWING),
    ("camera", "projection", "perspective orthographic"),
    ("light", "type", "spot directional point image"),
    ("light", "directional", TRUTH),
    ("flexcomp", "type", "grid box cylinder ellipsoid square disc circle mesh gmsh direct"),
    ("flexcomp", "rigid", TRUTH),
    ("flex flexcomp", "dof", DOF),
    ("flex flexcomp", "flatskin", TRUTH),
    ("edge", "equality", "true false strain"),
    ("elasticity", "elastic2d", "none bend stretch both"),
    ("elasticity", "section", "circle box"),
    ("contact", "selfcollide", "none narrow bvh sap auto"),
    ("contact", "passive", TRUTH),
    ("contact", "reduce", "none mindist maxforce netforce"),
    ("light equality connect weld joint tendon flex flexstrain", "active", TRUTH),
    ("joint tendon spatial fixed", "limited actuatorfrclimited", AUTO),
    (ANY, "ctrllimited forcelimited actlimited", AUTO),
    (ANY, "interp", "zoh linear cubic"),
    ("general plugin", "dyntype", DYNAMICS),
    ("general plugin", "actearly", TRUTH),
    ("general", "gaintype", "fixed affine muscle dcmotor pid so3 user"),
    ("general", "biastype", "none affine muscle dcmotor so3 user"),
    ("general orientation pid dcmotor", "input", INPUTS),
    ("user", "datatype", "real positive axis quaternion"),
    ("user", "needstage", "none pos vel acc"),
)
FRAME_OBJECTS = ("body", "xbody", "geom", "site", "camera")  # of frame sensors
# Elements and attributes that accept several keywords.
SEVERAL = {
    ("camera", "output"): ("rgb", "depth", "distance", "normal", "segmentation"),
    ("contact", "data"): ("found", "force", "torque", "dist", "pos", "normal", "tangent", "linvel", "angvel"),
    ("rangefinder", "data"): ("dist", "dir", "origin", "point", "normal", "depth"),
}
SINGLE = {
    (tag, attribute): tuple(words.split())
    for tags, attributes, words in TABLE
    for tag in tags.split()
    for attribute in attributes.split()
}


def rewritten(tag: str, attribute: str, value: str) -> dict[str, str] | None:
    """Returns the attributes that replace a removed one; None if that is not certain."""
    if name := RENAMED_ATTRIBUTES.get((tag, attribute)):
        return {name: value}
    if (tag, attribute) == ("option", "apirate"):
        return {}
    return REWRITTEN_VALUES.get((tag, attribute, value))


# The version without the value of an attribute, and the remedy.
REMOVED_VALUES = {
    ("edge", "equality", "vert"): ("in MuJoCo 4.0.0", REMOVED_ELEMENTS["flexvert"][1]),
    ("compiler", "coordinate", "global"): (
        "in MuJoCo 2.3.4",
        "load and save the model in MuJoCo 2.3.3 to convert it to local coordinates",
    ),
}

# Keywords of MJCF, and words of other formats and languages with the same meaning.
SYNONYMS = {
    "true": ("yes", "on", "1", "enabled"),
    "enable": ("yes", "on", "1", "true"),
    "false": ("no", "off", "0", "disabled"),
    "disable": ("no", "off", "0", "false"),
    "radian": ("rad",),
    "degree": ("deg",),
    "box": ("cube", "cuboid"),
    "sphere": ("ball",),
    "capsule": ("rod",),
    "cylinder": ("tube",),
    "plane": ("ground",),
    "hinge": ("revolute", "continuous"),
    "slide": ("prismatic", "linear"),
    "ball": ("spherical",),
    "free": ("floating",),
    "directional": ("sun",),
    "RK4": ("rungekutta",),
    "PGS": ("gauss-seidel",),
}

# Elements that MJCF never had, but that people write.
FOREIGN_ELEMENTS = {
    "solver": 'the solver is chosen in <option>: <option solver="Newton" iterations="100" tolerance="1e-8"/>',
    "world": "the world is called <worldbody>",
    "restitution": 'MJCF has none; for bouncing, lower the damping: <geom solref="-STIFFNESS -DAMPING">',
    "gravity": 'gravity is an option: <option gravity="0 0 -9.81"/>',
    "physics": 'physics is in <option>: <option timestep="0.002" gravity="0 0 -9.81"/>',
    "link": "a link is a <body>, with its <geom> and <joint> inside",
    "robot": "a file with <robot> as its root is URDF and needs the suffix .urdf",
    "collision": "a <geom> collides; contype and conaffinity say with what",
    "visual": 'a geom that is only seen is <geom contype="0" conaffinity="0">; <visual> is for rendering options',
    "actuators": "write <actuator>, directly in <mujoco>",
    "sensors": "write <sensor>, directly in <mujoco>",
}


@dataclass
class SchemaElement:
    """The attributes and children that an element may contain; `unique` if its parent may contain only one."""

    attributes: set[str] = field(default_factory=set[str])
    children: "dict[str, SchemaElement]" = field(default_factory=dict[str, "SchemaElement"])
    unique: bool = False


@cache
def schema() -> SchemaElement:
    """Returns the schema of the installed MuJoCo; its root is the parent of `<mujoco>`."""
    top = SchemaElement()
    path: list[SchemaElement] = [top]
    for line in mujoco.mj_printSchema(False, False).splitlines():
        element = re.match(r"( *)(\S+) \((.)\)\s*(.*)", line)
        if not element:
            path[-1].attributes.update(line.split())
            continue
        indent, name, kind, attributes = element.groups()
        node = SchemaElement(set(attributes.split()), unique=kind in "?!")
        del path[len(indent) // 3 + 1 :]
        path[-1].children[name] = node
        path.append(node)
        if kind == "R":
            node.children[name] = node
    _split_bodies(top.children["mujoco"])
    return top


def _split_bodies(root: SchemaElement) -> None:
    """Makes separate nodes of `worldbody`, `body`, `frame` and `replicate`, which share their children."""
    body = root.children.pop(BODY)
    inside = body.children
    inside.pop(BODY)
    for name in ("frame", "replicate"):
        inside[name] = SchemaElement(set(UNLISTED[name]), inside)
    inside["body"] = SchemaElement(body.attributes, inside)
    root.children["worldbody"] = SchemaElement(set(), inside)


@cache
def valid_parents() -> dict[str, list[tuple[str, SchemaElement]]]:
    """Returns, by tag, the parents that an element may have, and its node in each."""
    parents_by_tag: dict[str, dict[str, SchemaElement]] = {}
    waiting, seen = [("mujoco", schema().children["mujoco"])], set[tuple[str, int]]()
    while waiting:
        parent, node = waiting.pop(0)
        if (parent, id(node.children)) in seen:
            continue
        seen.add((parent, id(node.children)))
        for tag, child in node.children.items():
            parents_by_tag.setdefault(tag, {}).setdefault(parent, child)
            waiting.append((tag, child))
    return {
        tag: sorted(parents.items(), key=lambda parent: parent[0] in UNLIKELY_PARENTS)
        for tag, parents in parents_by_tag.items()
    }


def violations(source: XmlSource, root: Element | None) -> Iterator[Finding]:
    """Yields everything below `root`, of the model or of one that it attaches, that is not in the schema, in order."""
    if root is None or root.tag != "mujoco":
        return
    stack = [(root, schema().children["mujoco"])]
    while stack:
        element, node = stack.pop()
        yield from _attributes(source, element, node)
        yield from _repeated(element, node)
        if element.text and (element.attributes or element.children):  # others have been reported as values
            yield _stray_text(element)
        children = list[tuple[Element, SchemaElement]]()
        for child in element.children:
            inner = node.children.get(child.tag)
            if inner is None and child.tag not in UNLISTED:
                finding = _unknown(child, node)
                yield finding
                inner = _only_node(child) if finding.code != REMOVED.code else None
            if inner is not None:
                children.append((child, inner))
        stack.extend(reversed(children))


def _attributes(source: XmlSource, element: Element, node: SchemaElement) -> Iterator[Finding]:
    for name, value in element.attributes.items():
        removed = REMOVED_VALUES.get((element.tag, name, value))
        if name == "plugin" and value in REMOVED_PLUGINS:
            removed = REMOVED_PLUGINS[value]
        if removed:
            message = f"{name}={quoted(value)} of <{element.tag}> was removed {removed[0]}"
            yield REMOVED.in_element(element, message, removed[1])
        if name in node.attributes:
            continue
        if removed := REMOVED_ATTRIBUTES.get((element.tag, name)):
            message = f"the attribute {quoted(name)} of <{element.tag}> was removed {removed[0]}"
            yield REMOVED.in_element(element, message, removed[1], partial(_rewritten, source, element, name))
            continue
        message = f"<{clean(element.tag)}> has no attribute {quoted(name)}{suggestion(name, node.attributes)}"
        yield UNKNOWN_ATTRIBUTE.in_element(element, message, _attribute_remedy(element, name, node))


def _rewritten(source: XmlSource, element: Element, name: str) -> Fix | str:
    """Returns the fix that writes a removed attribute as MuJoCo reads it now."""
    editor, value = ElementEditor(source.mjcf_texts), element.attributes[name]
    if (element.tag, name, value) == ("compiler", "exactmeshinertia", "true"):
        meshes = [e for e in source.elements() if e.tag == "mesh" and e.parent and e.parent.tag == "asset"]
        exact = [editor.with_value(e, "inertia", "exact") for e in meshes if not holder(e, "inertia")]
        return Fix((editor.without(element, name, {name}), *exact))
    new = rewritten(element.tag, name, value)
    if new is None:
        return NOT_CERTAIN
    if not new:
        removed = [each for each, value in element.attributes.items() if rewritten(element.tag, each, value) == {}]
        return Fix((editor.without(element, name, removed),))
    missing = [other for other in new if other not in element.attributes]
    if len(missing) == 1:
        edits = [editor.renamed(element, name, missing[0])]
        edits += [editor.with_value(element, name, new[missing[0]])] if new[missing[0]] != value else []
    else:
        edits = [editor.without(element, name), *(editor.with_value(element, other, new[other]) for other in missing)]
    owner = f"{element.attributes.get('name', f'{element.tag}:')}*"  # <replicate> extends names
    return Fix(tuple(edits), tuple((field, owner) for field in REWRITTEN_FIELDS.get(element.tag, ())))


def _attribute_remedy(element: Element, name: str, node: SchemaElement) -> str:
    if not node.attributes:
        inner = [c.tag for c in element.children if c.tag in node.children and name in node.children[c.tag].attributes]
        example = f"<{inner[0]} {name}=…>" if inner else "its children"
        return f"<{element.tag}> only groups elements and takes no attributes; write it on {example}"
    close = near(name, node.attributes)
    if close:
        return f"write {close[0]}"
    return f"attributes of <{element.tag}>: {listing(sorted(node.attributes))}"


def _repeated(element: Element, node: SchemaElement) -> Iterator[Finding]:
    counts = Counter(child.tag for child in element.children)
    for child in element.children:
        inner = node.children.get(child.tag)
        if inner is None or not inner.unique or counts[child.tag] < 2:
            continue
        first = next(other for other in element.children if other.tag == child.tag)
        if child is not first:
            message = f"<{child.tag}> occurs more than once in <{element.tag}>; the first is on line {first.line}"
            yield REPEATED_ELEMENT.in_element(child, message, "put all its attributes into one element")


def _unknown(element: Element, node: SchemaElement) -> Finding:
    """Returns a finding that explains why this element must not occur here."""
    tag, parent = element.tag, element.parent
    assert parent is not None
    for name in (tag, f"{parent.tag}/{tag}"):
        if name not in REMOVED_ELEMENTS:
            continue
        since, remedy = REMOVED_ELEMENTS[name]
        return REMOVED.in_element(element, f"<{tag}> was removed {since}", remedy)
    if value := _as_attribute(element, node):
        return value
    parents = [tag for tag, _ in valid_parents().get(tag, [])]
    if parents and tag not in FOREIGN_ELEMENTS:
        homes = " or ".join(f"<{home}>" for home in parents[:3])
        message = f"<{tag}> is inside <{clean(parent.tag)}>, but must be directly inside {homes}"
        return MISPLACED_ELEMENT.in_element(element, message, _move(tag, parent, parents[0]))
    message = f"<{clean(parent.tag)}> has no element <{clean(tag)}>{suggestion(tag, node.children)}"
    remedy = FOREIGN_ELEMENTS.get(tag) or _children_remedy(tag, parent, node)
    return UNKNOWN_ELEMENT.in_element(element, message, remedy)


def _move(tag: str, parent: Element, home: str) -> str:
    if home == "mujoco":
        outer = "worldbody" if parent.tag == "worldbody" or parent.within("worldbody") else parent.tag
        return f"move <{tag}> … </{tag}> out of <{clean(outer)}>, directly into <mujoco>"
    return f"move it into <{home}>"


def _children_remedy(tag: str, parent: Element, node: SchemaElement) -> str:
    close = near(tag, node.children)
    if close:
        return f"write <{close[0]}>"
    if not node.children:
        return f"<{clean(parent.tag)}> contains no elements; end its tag with />"
    return f"elements of <{clean(parent.tag)}>: {listing(sorted(node.children))}"


def _as_attribute(element: Element, node: SchemaElement) -> Finding | None:
    """Returns a finding if `element` is the value of an attribute, as in `<friction>0.3</friction>`."""
    parent, tag = element.parent, element.tag
    assert parent is not None
    if not (element.text and not element.attributes and not element.children):
        return None
    holders = [name for name, inner in node.children.items() if tag in inner.attributes]
    if tag in node.attributes:
        holders.insert(0, parent.tag)
    if not holders:
        return None
    holder = holders[0]
    inner = node if holder == parent.tag else node.children[holder]
    values = {tag: element.text}
    if holder != parent.tag:  # add the siblings that belong to the same element
        values = {c.tag: c.text for c in parent.children if c.text and c.tag in inner.attributes}
    example = " ".join(f'{name}="{value}"' for name, value in values.items())
    message = f"<{tag}> is written as an element, but is an attribute of <{holder}>"
    return STRAY_VALUE.in_element(element, message, f"write <{holder} {example}/>: MJCF stores values in attributes")


def _stray_text(element: Element) -> Finding:
    shown = element.text if len(element.text) <= 40 else f"{element.text[:39]}…"
    message = f"text between the tags of <{clean(element.tag)}>: {quoted(shown)}"
    remedy = "MuJoCo ignores it; put values into attributes and comments into <!-- … -->"
    return STRAY_VALUE.finding(message, remedy, Place(element.file, element.text_line), str(element))


def _only_node(element: Element) -> SchemaElement | None:
    """Returns the node of a misplaced element if it has only one valid parent."""
    parents = valid_parents().get(element.tag, [])
    return parents[0][1] if len(parents) == 1 else None


def valid_keywords(element: Element, attribute: str) -> tuple[str, ...]:
    """Returns the keywords that an attribute accepts; none if it does not accept keywords."""
    key = (element.tag, attribute)
    if attribute in ("objtype", "reftype") and (element.tag.startswith("frame") or element.tag == "insidesite"):
        return FRAME_OBJECTS
    return SEVERAL.get(key) or SINGLE.get(key) or SINGLE.get((ANY, attribute), ())


def invalid_keywords(source: XmlSource) -> Iterator[Finding]:
    """Yields a finding for each attribute in the XML whose value is not one of its keywords, in file order."""
    if source.root is None or source.root.tag != "mujoco":
        return
    for element in source.elements():
        for attribute, value in element.attributes.items():
            choices = valid_keywords(element, attribute)
            words = value.split() if (element.tag, attribute) in SEVERAL else [value]
            invalid = [word for word in words if choices and word not in choices]
            if invalid and (element.tag, attribute, value) not in REMOVED_VALUES:
                yield _invalid(element, attribute, invalid[0], choices)


def _invalid(element: Element, attribute: str, word: str, choices: tuple[str, ...]) -> Finding:
    synonyms = [
        keyword for keyword, words in SYNONYMS.items() if keyword in choices and word.strip().casefold() in words
    ]
    likely = next(iter(synonyms or near(word.strip(), choices)), "")
    hint = f" (did you mean {quoted(likely)}?)" if likely else ""
    message = f"{attribute} of <{clean(element.tag)}>: no such keyword: {quoted(word)}{hint}"
    remedy = f'write {attribute}="{likely}"; ' if likely else ""
    return BAD_VALUE.in_element(element, message, f"{remedy}valid: {listing(choices)}")
