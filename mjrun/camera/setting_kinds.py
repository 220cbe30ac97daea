"""Kinds of the settings of rigs and shots: objects, places, points, and numbers that change over a shot."""

import math

from mjrun.camera.easing_and_shake import EASINGS, EasedNumber
from mjrun.camera.targets import Place
from mjrun.errors import suggestion
from mjrun.options.kinds import Choice, Kind, Text
from mjrun.options.number_kinds import POINT, Point, Real
from mjrun.options.option import Options, option, options, required
from mjrun.options.schema_validation import TEXT, InvalidValueError, Schema
from mjrun.options.structured_kinds import OneOf, OptionsMapping


class ObjectName(Text):
    """The name of an object, as in `box`, `geom:edge`, `site:tip` or `subtree:torso`; resolved in a model later."""

    metavar = "OBJECT"


class PlaceKind(Kind[Place, Place]):
    """An object or a point."""

    metavar = "PLACE"

    @property
    def form(self) -> Schema:
        return {"anyOf": [TEXT, POINT], "forms": "an object's name or a point [x, y, z]"}

    def __call__(self, value: Place) -> Place:
        return value if isinstance(value, str) else Point()(value)

    def parse(self, text: str) -> Place:
        try:
            _, _, _ = map(float, text.split("/"))
        except ValueError:
            return text
        return Point().parse(text)

    def plain(self, value: Place) -> object:
        return value if isinstance(value, str) else [*value]


@options
class RampMapping(Options):
    """A number that changes over the shot."""

    start: float = required(converter=Real(least=None), key="from", help="At the beginning of the shot.")
    end: float = required(converter=Real(least=None), key="to", help="At the end of the shot.")
    ease: str = option(converter=Choice((*EASINGS,)), default="linear", help="Easing from one number to the other.")


@options
class PositiveRampMapping(RampMapping):
    """A positive number that changes over the shot."""

    start: float = required(converter=Real(above=0), key="from", help="At the beginning of the shot.")
    end: float = required(converter=Real(above=0), key="to", help="At the end of the shot.")


class RampKind(OneOf["EasedNumber | float", EasedNumber]):
    """A number, or one that changes over the shot: `140..240`.

    Args:
      unit: the plural noun in errors about numbers that must be positive, as in `metres`; empty if any sign is valid.
    """

    metavar = "X..Y"

    def __init__(self, unit: str = "") -> None:
        mapping = OptionsMapping(PositiveRampMapping if unit else RampMapping, EasedNumber)
        number = Real(above=0) if unit else Real(least=None)
        super().__init__("a number or {from, to, ease}", number=number, object=mapping)
        self.unit = unit

    def __call__(self, value: "EasedNumber | float") -> EasedNumber:
        ramp = value if isinstance(value, EasedNumber) else EasedNumber.still(value)
        if ramp.ease not in EASINGS:
            raise InvalidValueError(f"one of {', '.join(EASINGS)}{suggestion(ramp.ease, EASINGS)}", ramp.ease)
        for number in (ramp.start, ramp.end):
            if not math.isfinite(number):
                raise InvalidValueError("finite", f"{number:g}")
            if self.unit and number <= 0:
                raise InvalidValueError(f"a positive number of {self.unit}", f"{number:g}")
        return ramp

    def parse(self, text: str) -> EasedNumber:
        first, dots, last = text.partition("..")
        try:
            ramp = EasedNumber(float(first), float(last if dots else first))
        except ValueError:
            ramp = EasedNumber.still(math.nan)
        if not (math.isfinite(ramp.start) and math.isfinite(ramp.end)):
            raise InvalidValueError("a number, or two as in 140..240")
        return self(ramp)

    def plain(self, value: EasedNumber) -> object:
        if value == EasedNumber.still(value.start):
            return value.start
        ease = {} if value.ease == "linear" else {"ease": value.ease}
        return {"from": value.start, "to": value.end, **ease}
