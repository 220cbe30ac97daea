"""The codes, topics, explanations and thresholds of all rules, known without importing these, MuJoCo or NumPy."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import field, fields
from functools import cache
from math import isfinite, pi, radians
from pathlib import Path
from typing import Any

from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, UnknownNameError, option

EXPLANATIONS = Path(__file__).with_name("explanations")
SITE = ""  # the address of the published documentation, ending in a slash; empty until one exists
TOPICS = {  # by the first digit of the code
    "0": "The check itself",
    "1": "Loading",
    "2": "Names, masses and inertias",
    "3": "Joints, actuators and sensors",
    "4": "Keyframes",
    "5": "Contacts and constraints",
    "6": "Cameras",
    "7": "Simulation",
    "8": "Tasks and policies",
}


def _threshold(code: str, value: float, meaning: str) -> float:
    """Returns the field of a threshold of the rule `code`, for its explanation."""
    return field(default=value, metadata={"code": code, "meaning": meaning})


@dataclass(frozen=True)
class Thresholds:
    """Thresholds of rules, which a repository may set by name."""

    # Double precision has 16 digits; factoring the inertia matrix costs as many as its condition number has.
    principal_inertia_ratio: float = _threshold("MJ204", 1e6, "largest to smallest principal inertia of a body")
    tree_inertia_ratio: float = _threshold(
        "MJ205", 1e9, "largest to smallest inertia of joints of one kind in one tree"
    )
    inertia_spread: float = _threshold(  # 0.58 for a solid box
        "MJ206", 1.5, "mean distance of the mass from its centre, relative to the reach of the geoms"
    )
    min_inertia_share: float = _threshold(
        "MJ206", 0.1, "smallest inertia, relative to that of the boxes around the geoms, filled with the mass"
    )
    placeholder_spread: float = _threshold(
        "MJ206", 1.3, "such a distance for a body with equal inertias, relative to the reach of its geoms alone"
    )
    placeholder_slenderness: float = _threshold("MJ206", 3.0, "length to width of a body with equal inertias")

    density: float = _threshold("MJ207", 12_000.0, "density of a body [kg/m³]")  # lead has 11,340
    absurd_density: float = _threshold("MJ207", 80_000.0, "density from which it is an error [kg/m³]")
    min_density: float = _threshold("MJ207", 20.0, "smallest density [kg/m³]")  # of packaging foam
    absurd_min_density: float = _threshold("MJ207", 1.2, "density under which it is a warning [kg/m³]")  # of air

    centre_offset: float = _threshold(
        "MJ208", 0.25, "distance of the centre of mass from the box of the geoms, relative to the longest side"
    )
    body_size: float = _threshold("MJ209", 20.0, "longest side of a body's box [m]")
    visual_mass_share: float = _threshold("MJ210", 0.3, "share of the mass from geoms that do not collide")
    servo_excess: float = _threshold("MJ306", 0.1, "targets beyond the range of the joint, relative to that range")
    absurd_servo_excess: float = _threshold("MJ306", 5.0, "such targets from which it is a warning")
    servo_phase: float = _threshold(  # explicit integrators are unstable beyond 2
        "MJ307", 1.0, "phase of a servo's oscillation in one timestep [rad]"
    )
    min_hinge_turn: float = _threshold("MJ308", radians(4), "smallest range of a hinge [rad]")
    hinge_turn: float = _threshold("MJ308", 4.1 * pi, "largest range of a hinge [rad]")  # ±6.2832 is common

    # CAD models are not exactly symmetric.
    side_mass: float = _threshold("MJ309", 0.02, "relative difference of masses")
    side_inertia: float = _threshold("MJ309", 0.05, "relative difference of principal inertias")
    side_size: float = _threshold("MJ309", 0.05, "relative difference of the sizes of colliding geoms")
    side_offset: float = _threshold("MJ309", 0.02, "relative difference of distances from the parents")
    side_axis: float = _threshold("MJ309", 0.2, "difference between components of joint axes")
    side_force: float = _threshold("MJ309", 0.02, "relative difference of gears, gains and forceranges")
    side_range: float = _threshold("MJ309", 0.02, "relative difference of joint ranges")

    link_turn: float = _threshold("MJ313", pi, "turn of a hinge that can pass through its parent [rad]")
    link_overlap: float = _threshold(
        "MJ313", radians(30), "turn during which a geom's centre is inside its parent [rad]"
    )

    penetration: float = _threshold("MJ501", 0.002, "depth between two moving geoms [m]")
    static_penetration: float = _threshold("MJ501", 0.01, "depth against a geom that cannot move [m]")
    penetration_share: float = _threshold("MJ501", 0.1, "depth relative to the smaller geom's half size")
    initial_acceleration: float = _threshold(  # a contact with the default solref pushes that hard at a depth of 7 cm
        "MJ502", 20.0, "acceleration by constraints, relative to gravity"
    )
    inverted_volume: float = _threshold("MJ505", 0.01, "negative volume of a mesh, relative to that of its box")
    hull_volume: float = _threshold("MJ506", 1.5, "volume of a hull relative to that of its mesh")
    shape_overlap: float = _threshold(
        "MJ507", 0.2, "common part of the boxes of visual and colliding geoms, relative to the smaller one"
    )
    energy_gain: float = _threshold(
        "MJ702", 0.1, "gain relative to the largest kinetic energy plus that of a fall by the mean size of a geom"
    )


NAMES = tuple(each.name.replace("_", "-") for each in fields(Thresholds))


def described(code: str) -> Iterator[str]:
    """Yields a line about each threshold of a rule: its setting and its meaning."""
    for each in fields(Thresholds):
        facts: Mapping[str, Any] = each.metadata
        if facts["code"] == code:
            yield f"`--threshold {each.name.replace('_', '-')}={each.default:.5g}`: {facts['meaning']}"


def threshold_values(settings: Iterable[tuple[str, str]]) -> Mapping[str, float]:
    """Returns the fields of `Thresholds` that are set, by name.

    Args:
      settings: names, with hyphens or underscores, and numbers as text.

    Raises:
      UnknownNameError: no threshold has this name.
      BadValueError: a value is not a positive number.
    """
    values: dict[str, float] = {}
    for name, text in settings:
        if name.replace("_", "-") not in NAMES:
            raise UnknownNameError("threshold", name, NAMES)
        try:
            value = float(text)
        except ValueError:
            value = 0.0
        if not (isfinite(value) and value > 0):
            raise BadValueError(option("threshold"), f"{name}={text}", "a positive number")
        values[name.replace("-", "_")] = value
    return values


@cache
def codes() -> Sequence[str]:
    """Returns the codes of all rules, sorted; each has a page in `mjrun.check.explanations`."""
    return sorted(page.stem for page in EXPLANATIONS.glob("*.md"))


def matching_codes(prefixes: Sequence[str]) -> frozenset[str]:
    """Returns the codes that begin with one of `prefixes`, in any case.

    Raises:
      UnknownNameError: no code begins with one of them.
    """
    matching: set[str] = set()
    for prefix in prefixes:
        found = {code for code in codes() if prefix and code.startswith(prefix.upper())}
        if not found:
            raise UnknownNameError("code", prefix, list(codes()))
        matching |= found
    return frozenset(matching)


def topic(code: str) -> str:
    """Returns the topic of a rule."""
    return TOPICS[code[2]]


def published_page(code: str) -> str:
    """Returns the address of the page of a rule; empty until the documentation is published."""
    return f"{SITE}rules/{code}.html" if SITE else ""


def local_page(code: str) -> str:
    """Returns the address of the file with the explanation of a rule, on this machine."""
    return (EXPLANATIONS / f"{code}.md").as_uri()


def explanation(code: str) -> str:
    """Returns what a rule finds, why it matters, what to do, its thresholds, an example and when to ignore it, in
    Markdown.
    """
    if code not in codes():
        raise UnknownNameError("rule", code, list(codes()))
    page = (EXPLANATIONS / f"{code}.md").read_text("utf-8")
    thresholds = "\n".join(f"- {line}" for line in described(code))
    return page.replace("## Example", f"## Thresholds\n\n{thresholds}\n\n## Example", 1) if thresholds else page
