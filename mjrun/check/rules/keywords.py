"""Keywords that attributes take, as MuJoCo's XML spells them, and what was probably meant.

MuJoCo stops at the first that it does not know, and does not say which there are.
"""

from collections.abc import Iterator

from mjrun.check.finding import Sighting
from mjrun.check.rules.deprecated import REMOVED_VALUES, SYNONYMS
from mjrun.check.xml_source import Element, Source
from mjrun.errors import clean, listing, near, quoted

KEYWORD = "MJ110"
TRUTH, AUTO, SWITCH = "true false", "true false auto", "enable disable"
SHAPES = "plane hfield sphere capsule ellipsoid cylinder box mesh sdf"
FOLLOWING = "fixed track trackcom targetbody targetbodycom"
DYNAMICS = "none integrator filter filterexact pid dcmotor muscle user"
INPUTS = "none pos vel expmap quat"
DOF = "full radial trilinear quadratic 2d"
ANY = "*"
# Elements, attributes of theirs, and the keywords that these take; nothing else may stand around them.
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
FRAMED = ("body", "xbody", "geom", "site", "camera")  # what a sensor of frames looks at
# Element and attribute that take several keywords.
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


def valid(element: Element, attribute: str) -> tuple[str, ...]:
    """The keywords that an attribute takes; none if it takes something else."""
    key = (element.tag, attribute)
    if attribute in ("objtype", "reftype") and (element.tag.startswith("frame") or element.tag == "insidesite"):
        return FRAMED
    return SEVERAL.get(key) or SINGLE.get(key) or SINGLE.get((ANY, attribute), ())


def wrong(source: Source) -> Iterator[tuple[str, Sighting]]:
    """Every value in the XML that is no keyword where one must be: codes and sightings, in the order of the file."""
    if source.root is None or source.root.tag != "mujoco":
        return
    for element in source.elements():
        for attribute, value in element.attributes.items():
            choices = valid(element, attribute)
            words = value.split() if (element.tag, attribute) in SEVERAL else [value]
            strange = [word for word in words if choices and word not in choices]
            if strange and (element.tag, attribute, value) not in REMOVED_VALUES:
                yield KEYWORD, _sighting(element, attribute, strange[0], choices)


def _sighting(element: Element, attribute: str, word: str, choices: tuple[str, ...]) -> Sighting:
    likely = meant(word, choices)
    hint = f" (did you mean {quoted(likely)}?)" if likely else ""
    message = f"{attribute} of <{clean(element.tag)}>: no such keyword: {quoted(word)}{hint}"
    remedy = f'write {attribute}="{likely}"; ' if likely else ""
    return Sighting(message, f"{remedy}valid: {listing(choices)}", str(element), (element.file, element.line))


def meant(word: str, choices: tuple[str, ...]) -> str:
    """The keyword that `word` was probably meant to be; empty if there is none."""
    word = word.strip()
    same = [known for known in SYNONYMS.get(word.casefold(), ()) if known in choices]
    return next(iter(same or near(word, choices)), "")
