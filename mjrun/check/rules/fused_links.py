"""Links of a URDF that MuJoCo fuses into one body, because fixed joints connect them."""

from mjrun.check.context import LintContext
from mjrun.model.xml_source import Element

SHAPES = {"visual", "collision"}  # the elements with the geoms of a link


def fused_links(context: LintContext, body: int) -> list[Element]:
    """Returns the links that a body consists of, that of its name first; none unless they are those of a URDF."""
    root = context.source.root
    if root is None or root.tag != "robot" or context.spec is None or not context.spec.compiler.fusestatic:
        return []
    links = {element.attributes.get("name", ""): element for element in root.children if element.tag == "link"}
    fixed = [e for e in root.children if e.tag == "joint" and e.attributes.get("type") == "fixed"]
    ends = [(_end(joint, "parent"), _end(joint, "child")) for joint in fixed]
    names = [context.name("body", body)]
    for name in names:
        names += [child for parent, child in ends if parent == name and child not in names]
    return [links[name] for name in filter(None, names) if name in links]


def loses_its_shape(context: LintContext, link: Element) -> bool:
    """Returns whether MuJoCo discards all geoms of a link, which are only visual ones."""
    tags = {child.tag for child in link.children}
    return context.spec is not None and bool(context.spec.compiler.discardvisual) and tags & SHAPES == {"visual"}


def _end(joint: Element, tag: str) -> str:
    return next((child.attributes.get("link", "") for child in joint.children if child.tag == tag), "")
