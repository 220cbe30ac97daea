"""Kinds of numeric option values: single numbers, sizes, ranges, groups, points and vectors."""

import math
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from fractions import Fraction
from typing import cast

from mjrun.errors import UsageError
from mjrun.options.kinds import Kind, ReadingContext
from mjrun.options.schema_validation import NUMBER, InvalidValueError, Schema, check, type_name
from mjrun.timeline import rational

Number = float | str | Fraction
Numbers = tuple[float, ...]
Vector = tuple[float, float, float]
GROUPS = tuple(range(6))  # MuJoCo's groups of geoms, sites, …: mjNGROUP of them
AUTO = "auto"
MOST_DIGITS = 18  # of an integer, so that it is one of 64 bits
LIMIT = 10**MOST_DIGITS
NUMBERS: Schema = {
    "anyOf": [NUMBER, {"type": "array", "items": NUMBER, "minItems": 1}],
    "forms": "a number or a list of numbers",
}
POINT: Schema = {"type": "array", "items": NUMBER, "minItems": 3, "maxItems": 3, "counted": "numbers"}


class IntegerKind(Kind[int, int]):
    """An integer from `least` to `most`, by default below 1e18."""

    metavar = "N"

    def __init__(self, least: int | None = 0, most: int | None = None, metavar: str = "") -> None:
        super().__init__(metavar)
        self.least, self.most = least, most

    @property
    def expected(self) -> str:
        if self.most is not None:
            return f"a whole number from {self.least} to {self.most}"
        return "a whole number" if self.least is None else f"a whole number of at least {self.least}"

    @property
    def form(self) -> Schema:
        least: Schema = {"exclusiveMinimum": -LIMIT} if self.least is None else {"minimum": self.least}
        most: Schema = {"exclusiveMaximum": LIMIT} if self.most is None else {"maximum": self.most}
        return {"type": "integer", **({"exclusiveMinimum": 0} if self.least == 1 else least), **most}

    def __call__(self, value: int) -> int:
        # NumPy's integers have __index__ too.
        if isinstance(value, bool) or not hasattr(value, "__index__"):
            raise InvalidValueError(self.expected)
        number = value.__index__()
        if (self.least is not None and number < self.least) or (self.most is not None and number > self.most):
            raise InvalidValueError(self.expected)
        if abs(number) >= LIMIT:
            raise self._too_large()
        return number

    def parse(self, text: str) -> int:
        digits = re.fullmatch(r"[-+]?([0-9]+)", text.strip())
        if digits is None:
            raise InvalidValueError(self.expected)
        if len(digits[1]) > MOST_DIGITS:
            raise self._too_large()
        return self(int(text))

    def _too_large(self) -> InvalidValueError:
        if self.least is None:
            return InvalidValueError("a whole number between -1e18 and 1e18")
        return InvalidValueError(self.expected if self.most is not None else f"{self.expected} and below 1e18")


class RealKind(Kind[float, float]):
    """A finite number from `least` to `most`; `above` is an exclusive lower bound instead of `least`."""

    metavar = "X"

    def __init__(
        self, least: float | None = 0.0, above: float | None = None, most: float | None = None, metavar: str = ""
    ) -> None:
        super().__init__(metavar)
        self.least, self.above, self.most = least, above, most

    @property
    def expected(self) -> str:
        if self.above is not None and self.most is not None:
            return f"a number above {self.above:g} and up to {self.most:g}"
        if self.above is not None:
            low = "a positive number" if self.above == 0 else f"a number above {self.above:g}"
        elif self.least is None:
            low = "a finite number"
        else:
            low = f"a number of at least {self.least:g}" if self.most is None else f"a number from {self.least:g}"
        return low if self.most is None else f"{low} to {self.most:g}"

    @property
    def form(self) -> Schema:
        bounds = {"minimum": self.least, "exclusiveMinimum": self.above, "maximum": self.most}
        if self.above is not None:
            bounds["minimum"] = None
        return {"type": "number", **{key: bound for key, bound in bounds.items() if bound is not None}}

    def __call__(self, value: float) -> float:
        number = to_float(value)
        least = -math.inf if self.least is None else self.least
        high_enough = number >= least if self.above is None else number > self.above
        if not math.isfinite(number) or not high_enough or (self.most is not None and number > self.most):
            raise InvalidValueError(self.expected)
        return number

    def parse(self, text: str) -> float:
        return self(to_float(text))


class PercentKind(RealKind):
    """A share, written as a percentage on the command line: `10%` is 0.1."""

    metavar = "PERCENT"

    def parse(self, text: str) -> float:
        try:
            return self(share_of(text[:-1]) if text.endswith("%") else math.nan)
        except ValueError:
            raise InvalidValueError("a percentage; write it as in 10%") from None


# Units that texts of some numbers may end with, by the placeholder of the number.
UNITS: Mapping[str, Mapping[str, Fraction]] = {
    "SECONDS": {
        "s": Fraction(1),
        "ms": Fraction(1, 1000),
        "us": Fraction(1, 10**6),
        "ns": Fraction(1, 10**9),
        "min": Fraction(60),
        "h": Fraction(3600),
    },
    "FACTOR": {"x": Fraction(1)},
    "FPS": {"fps": Fraction(1)},
    "HZ": {"Hz": Fraction(1), "kHz": Fraction(1000)},
}


class ExactNumberKind(Kind[Number, Fraction]):
    """A positive exact number: `0.25`, `30`, `30000/1001`; `zero` also allows 0, `signed` any number.

    Texts may end with a unit: `200ms`.
    """

    metavar = "NUMBER"

    def __init__(self, metavar: str = "", *, zero: bool = False, signed: bool = False) -> None:
        super().__init__(metavar)
        self.zero, self.signed = zero or signed, signed

    @property
    def expected(self) -> str:
        return "a number" if self.signed else "a number of at least 0" if self.zero else "a positive number"

    @property
    def form(self) -> Schema:
        bound: Schema = {} if self.signed else {"minimum" if self.zero else "exclusiveMinimum": 0}
        sign = "-?" if self.signed else ""
        unit = f" ?({'|'.join(self._units)})?" if self._units else ""
        text = {"type": "string", "pattern": f"^{sign}[0-9.]+(/[0-9]+|[eE][-+]?[0-9]+)?{unit}$"}
        return {"anyOf": [{**NUMBER, **bound}, text], "expected": self.expected}

    def __call__(self, value: Number) -> Fraction:
        try:
            number = self._rational(value)
            nearest = float(number)
        except (OverflowError, TypeError, ValueError):
            has_unit = isinstance(value, str) and value[:1].isdigit() and value[-1].isalpha()
            units = f"; units: {', '.join(self._units)}" if has_unit and self._units else ""
            raise InvalidValueError(f"{self.expected}{units}") from None
        too_small = nearest == 0 and not (self.zero and number == 0)  # below the smallest float
        if (number < 0 and not self.signed) or too_small:
            raise InvalidValueError(self.expected)
        return number

    def parse(self, text: str) -> Fraction:
        return self(text)

    @property
    def _units(self) -> Mapping[str, Fraction]:
        """The units that a text may end with, each in the option's unit."""
        return UNITS.get(self.metavar, {})

    def _rational(self, value: Number) -> Fraction:
        if isinstance(value, str):
            for unit in sorted(self._units, key=len, reverse=True):
                if value.endswith(unit):
                    return rational(value.removesuffix(unit).rstrip()) * self._units[unit]
        return rational(value)

    def read(self, value: object, reader: ReadingContext) -> object:
        if type_name(value) not in ("integer", "number", "string"):
            raise InvalidValueError(self.expected)
        return self(cast("Number", value))


class InstantKind(Kind[object, object]):
    """An exact time [s]; documents and Python also accept an event."""

    metavar = "SECONDS"
    accepted = "a time [s], or an event"

    def __call__(self, value: object) -> object:
        return (
            ExactNumberKind(self.metavar, zero=True)(value) if isinstance(value, (int, float, str, Fraction)) else value
        )

    def parse(self, text: str) -> Fraction:
        return ExactNumberKind(self.metavar, zero=True)(text)


class SizeKind(Kind[Sequence[int], tuple[int, int]]):
    """Width and height in pixels: `1280x720`."""

    metavar = "WxH"
    accepted = "a width and a height in pixels, as in (640, 480)"
    is_sequence = True

    @property
    def form(self) -> Schema:
        side = {"type": "integer", "exclusiveMinimum": 0}
        sides = {"type": "array", "items": side, "minItems": 2, "maxItems": 2}
        return {
            "anyOf": [{"type": "string", "pattern": "^[0-9]+[xX][0-9]+$"}, sides],
            "expected": "width and height in pixels, as in 1280x720 or [1280, 720]",
        }

    def __call__(self, value: Sequence[int]) -> tuple[int, int]:
        sides = () if isinstance(value, str) else tuple(value)
        if len(sides) != 2 or not all(hasattr(side, "__index__") and side > 0 for side in sides):
            raise InvalidValueError(self.accepted)
        return sides[0].__index__(), sides[1].__index__()

    def parse(self, text: str) -> tuple[int, int]:
        sides = re.fullmatch(rf"0*([1-9][0-9]{{0,{MOST_DIGITS - 1}}})[xX]0*([1-9][0-9]{{0,{MOST_DIGITS - 1}}})", text)
        if sides is None:
            raise InvalidValueError("a size; write width x height in pixels, as in 1280x720")
        return int(sides[1]), int(sides[2])

    def plain(self, value: tuple[int, int]) -> str:
        return f"{value[0]}x{value[1]}"

    def read(self, value: object, reader: ReadingContext) -> object:
        check(value, self.form)
        return self.parse(value) if isinstance(value, str) else value


class FigureSizeKind(SizeKind):
    """Width and height of a figure in pixels, or in millimetres as `85mmx60mm`, of which 25.4 are 96 pixels."""

    metavar = "WxH"
    _MILLIMETRES = r"([0-9.]+)(?:mm)?x([0-9.]+)mm"

    @property
    def form(self) -> Schema:
        form = dict(super().form)
        pattern = f"^([0-9]+[xX][0-9]+|{self._MILLIMETRES})$"
        sides = cast("Sequence[Schema]", form["anyOf"])[1]
        form["anyOf"] = [{"type": "string", "pattern": pattern}, sides]
        form["expected"] = "width and height in pixels or millimetres, as in 1280x720, [1280, 720] or 85mmx60mm"
        return form

    def parse(self, text: str) -> tuple[int, int]:
        match = re.fullmatch(self._MILLIMETRES, text)
        if match is None:
            return super().parse(text)
        try:
            width, height = (round(float(side) * 96 / 25.4) for side in match.groups())
        except (ValueError, OverflowError):
            raise InvalidValueError("a size; write width x height, as in 1280x720 or 85mmx60mm") from None
        return self((width, height))


class RangeKind(Kind[Sequence[float], tuple[float, float]]):
    """Two numbers, the smaller first: `0.5..4`."""

    metavar = "LOW..HIGH"

    def __init__(self, metavar: str = "", expected: str = "two numbers, the smaller first") -> None:
        super().__init__(metavar)
        self.expected = expected

    @property
    def form(self) -> Schema:
        return {"type": "array", "items": NUMBER, "minItems": 2, "maxItems": 2, "counted": "numbers"}

    def __call__(self, value: Sequence[float]) -> tuple[float, float]:
        low, high = value if len(value) == 2 else (math.nan, math.nan)
        if not -math.inf < low < high < math.inf:
            raise InvalidValueError(self.expected)
        return float(low), float(high)

    def parse(self, text: str) -> tuple[float, float]:
        first, _, last = text.partition("..")
        try:
            return self((to_float(first), to_float(last)))
        except InvalidValueError:
            raise InvalidValueError("a range; write two numbers, the smaller first, as in 0.5..4") from None

    def plain(self, value: tuple[float, float]) -> list[float]:
        return [*value]


class ProcessCountKind(Kind[int | str, int | str]):
    """A number of processes or threads, or `auto`."""

    metavar = "N|auto"

    def __init__(self, metavar: str = "", of: str = "processes") -> None:
        super().__init__(metavar)
        self.of = of

    @property
    def form(self) -> Schema:
        number = {"type": "integer", "exclusiveMinimum": 0}
        return {"anyOf": [number, {"type": "string", "enum": [AUTO]}], "forms": "a number of processes, or auto"}

    def __call__(self, value: int | str) -> int | str:
        whole = isinstance(value, int) and not isinstance(value, bool) and 0 < value < 10_000
        if value != AUTO and not whole:
            raise InvalidValueError(f"a number of {self.of}, at least 1, or auto")
        return value

    def parse(self, text: str) -> int | str:
        return self(int(text) if text.isascii() and text.isdigit() and len(text) < 5 else text)


class GroupsKind(Kind[Sequence[int] | str, tuple[int, ...]]):
    """MuJoCo's groups: `0,1,2`, `all` or `none`."""

    metavar = "GROUPS"

    @property
    def form(self) -> Schema:
        group = {"type": "integer", "minimum": 0, "maximum": GROUPS[-1]}
        return {
            "anyOf": [{"type": "array", "items": group}, {"type": "string", "enum": ["all", "none"]}],
            "forms": "a list of groups from 0 to 5, all or none",
        }

    def __call__(self, value: Sequence[int] | str) -> tuple[int, ...]:
        if value in ("all", "none"):
            return GROUPS if value == "all" else ()
        groups = tuple(value)
        if not all(group in GROUPS for group in groups):
            raise InvalidValueError("a list of groups from 0 to 5, all or none")
        return tuple(int(group) for group in groups)

    def parse(self, text: str) -> tuple[int, ...]:
        words = text.split(",")
        if text not in ("all", "none") and not all(re.fullmatch("[0-5]", word) for word in words):
            raise InvalidValueError("a list of groups from 0 to 5, as in 0,1,2, or all, or none")
        return self(text if text in ("all", "none") else [int(word) for word in words])

    def plain(self, value: tuple[int, ...]) -> str | list[int]:
        return "all" if value == GROUPS else [*value] or "none"


class NumberVectorKind(Kind["float | Sequence[float]", Numbers]):
    """One finite number, or one per component."""

    metavar = "NUMBERS"

    @property
    def form(self) -> Schema:
        return NUMBERS

    def __call__(self, value: "float | Sequence[float]") -> Numbers:
        parts: Sequence[float] = [value] if isinstance(value, (int, float)) else value
        each: list[object] = [] if isinstance(parts, str) else [*parts]
        numbers = tuple(float(part) for part in each if isinstance(part, (int, float)) and math.isfinite(part))
        if not numbers or len(numbers) < len(each):
            raise InvalidValueError("a finite number, or a list of them")
        return numbers

    def plain(self, value: Numbers) -> object:
        return value[0] if len(value) == 1 else [*value]


class PointKind(Kind[Vector, Vector]):
    """A point or a displacement [m]: `x/y/z`."""

    metavar = "X/Y/Z"

    @property
    def form(self) -> Schema:
        return POINT

    def __call__(self, value: Vector) -> Vector:
        x, y, z = map(float, value)
        if not all(map(math.isfinite, (x, y, z))):
            raise InvalidValueError("made of finite numbers", ", ".join(f"{number:g}" for number in value))
        return (x, y, z)

    def parse(self, text: str) -> Vector:
        try:
            x, y, z = map(float, text.split("/"))
            return self((x, y, z))
        except ValueError:
            raise InvalidValueError("a point x/y/z [m]") from None

    def plain(self, value: Vector) -> object:
        return [*value]


def refuse_loose_coordinate(text: str, where: str) -> None:
    """Raises UsageError if a setting is a number: the coordinate of a point that was written with commas."""
    with suppress(ValueError):
        float(text)
        raise UsageError(f"{where}: commas separate settings; write a point with slashes, as in 1/0/0.5")


def share_of(percentage: str) -> float:
    """Converts a percentage without its sign to a share, rounded once: 99.9 is 0.999.

    Raises:
      ValueError: the text is not a finite number.
    """
    return float(rational(to_float(percentage)) / 100)


def to_float(value: float | str) -> float:
    """Converts `value` to a number, or to NaN if it is invalid."""
    try:
        return float(value)
    except (TypeError, ValueError):
        return math.nan
