"""The keywords of attributes as MJCF spells them, and the keyword that was probably meant.

MuJoCo stops at the first unknown keyword, and does not list the valid ones.
"""

from collections.abc import Iterator

from mjrun.check.rule import Finding, Rule
from mjrun.check.rules.mjcf_schema import REMOVED_VALUES, SYNONYMS
from mjrun.errors import clean, listing, near, quoted
from mjrun.model.xml_source import Element, XmlSource

BAD_VALUE = Rule("MJ110", "error", "bad value of an attribute")

TRUTH, AUTO, SWITCH = "true false", "true false auto", "enable disable"
SHAPES = "plane hfield sphere capsule ellipsoid cylinder box mesh sdf"
FOLLOWING = "fixed track trackcom targetbody targetbodycom"
DYNAMICS = "none integrator filter filterexact pid dcmotor muscle user"
INPUTS = "none pos vel expmap quat"
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
    ("mesh", "builtin", "none sphere ellipsoid cylinder box disc grid"),
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
    ("flexcomp", "type", "grid box cylinder ellipsoid disc circle mesh gmsh direct"),
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
    likely = _likely(word, choices)
    hint = f" (did you mean {quoted(likely)}?)" if likely else ""
    message = f"{attribute} of <{clean(element.tag)}>: no such keyword: {quoted(word)}{hint}"
    remedy = f'write {attribute}="{likely}"; ' if likely else ""
    return BAD_VALUE.in_element(element, message, f"{remedy}valid: {listing(choices)}")


def _likely(word: str, choices: tuple[str, ...]) -> str:
    """Returns the keyword that was probably meant by `word`; empty if none is similar."""
    word = word.strip()
    synonyms = [keyword for keyword, words in SYNONYMS.items() if keyword in choices and word.casefold() in words]
    return next(iter(synonyms or near(word, choices)), "")
