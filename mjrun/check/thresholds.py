"""The numbers beyond which rules report something."""

from collections.abc import Iterable, Mapping
from dataclasses import fields
from math import isfinite

from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, UnknownNameError, option


@dataclass(frozen=True)
class Thresholds:
    """Thresholds of rules, which a repository may set by name.

    Attributes:
      principal_inertia_ratio: MJ204: largest to smallest principal inertia of a body; a rod of 1 m by 1 mm has 3e5.
      tree_inertia_ratio: MJ205: largest to smallest inertia of joints of one kind in one tree.
      inertia_spread: MJ206: mean distance of the mass from its centre, relative to the reach of the geoms.
      penetration: MJ501: depth between two moving geoms [m].
      static_penetration: MJ501: depth against a geom that cannot move [m].
      penetration_share: MJ501: depth relative to the smaller geom's half size.
      initial_acceleration: MJ502: acceleration by constraints, relative to gravity.
      energy_gain: MJ702: gain relative to the largest kinetic energy plus that of a fall by the mean size of a geom.
    """

    # Double precision has 16 digits; factoring the inertia matrix costs as many as its condition number has.
    principal_inertia_ratio: float = 1e6
    tree_inertia_ratio: float = 1e9
    inertia_spread: float = 1.5  # 0.58 for a solid box
    penetration: float = 0.002
    static_penetration: float = 0.01
    penetration_share: float = 0.1
    initial_acceleration: float = 20.0  # a contact with the default solref pushes that hard at a depth of 7 cm
    energy_gain: float = 0.1


NAMES = tuple(field.name.replace("_", "-") for field in fields(Thresholds))


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
