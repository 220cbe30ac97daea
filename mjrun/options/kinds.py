"""Kinds of option values: what Python may give, what a command line writes, and what a document holds.

A kind is a converter: called with what Python gives, it returns the value, checked and immutable.
"""

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from os import PathLike
from typing import Any, Generic, TypeVar, cast

from mjrun.timeline import rational

V = TypeVar("V", contravariant=True)
T = TypeVar("T")
W = TypeVar("W")
Number = float | str | Fraction
Numbers = tuple[float, ...]
Plain = str | int | float | bool | None | list["Plain"] | dict[str, "Plain"]

GROUPS = tuple(range(6))  # MuJoCo's groups of geoms, sites, …: mjNGROUP of them
AUTO = "auto"


class ExpectedError(ValueError):
    """A value is not what its kind takes.

    Attributes:
      expected: completes the sentence "… is not".
      part: of a text that holds several values, the one that is wrong; None for the whole.
    """

    def __init__(self, expected: str, part: str | None = None) -> None:
        self.expected, self.part = expected, part
        super().__init__(expected)


class Kind(ABC, Generic[V, T]):
    """What values an option takes.

    Attributes:
      metavar: what stands for the value in help texts.
      separator: between the parts of a command line's text, where one text holds several.
    """

    metavar: str = "TEXT"

    @abstractmethod
    def __call__(self, value: V) -> T:
        """The value that Python's `value` means.

        Raises:
          ExpectedError: it means none.
        """

    def parse(self, text: str) -> object:
        """What `text` on a command line means, as Python might give it.

        Raises:
          ExpectedError: nothing.
        """
        return text

    def plain(self, value: T) -> object:
        """`value` as a document writes it; exact numbers are left to the writer."""
        return value


AnyKind = Kind[Any, Any]  # a kind whose values are not known here


@dataclass(frozen=True)
class Text(Kind[str, str]):
    """Any text."""

    metavar: str = "TEXT"

    def __call__(self, value: object) -> str:
        if not isinstance(value, str):
            raise ExpectedError("text")
        return value


@dataclass(frozen=True)
class MujocoName(Text):
    """The name of something that MuJoCo knows, such as a visual flag; looked up where it is used.

    Attributes:
      of: what it is a name of; documents and editors list the names.
    """

    of: str = ""


@dataclass(frozen=True)
class Choice(Kind[str, str]):
    """One of a few words."""

    names: tuple[str, ...]

    @property
    def metavar(self) -> str:  # type: ignore[override]
        return "|".join(self.names)

    def __call__(self, value: str) -> str:
        if value not in self.names:
            raise ExpectedError(f"one of {', '.join(self.names)}")
        return value


@dataclass(frozen=True)
class Flag(Kind[bool, bool]):
    """Yes or no; `negatable` has a `--no-` spelling on the command line."""

    negatable: bool = False

    def __call__(self, value: object) -> bool:
        if not isinstance(value, bool):
            raise ExpectedError("true or false")
        return value


@dataclass(frozen=True)
class Integer(Kind[int, int]):
    """A whole number from `least` to `most`."""

    least: int | None = 0
    most: int | None = None
    metavar: str = "N"

    @property
    def expected(self) -> str:
        bounds = [f" from {self.least} on"] if self.least is not None and self.most is None else []
        bounds += [f" from {self.least} to {self.most}"] if self.most is not None else []
        return f"a whole number{''.join(bounds)}"

    def __call__(self, value: int) -> int:
        # NumPy's integers are whole numbers too.
        if isinstance(value, bool) or not hasattr(value, "__index__"):
            raise ExpectedError(self.expected)
        number = value.__index__()
        if (self.least is not None and number < self.least) or (self.most is not None and number > self.most):
            raise ExpectedError(self.expected)
        return number

    def parse(self, text: str) -> int:
        if not re.fullmatch(r"[-+]?[0-9]{1,18}", text.strip()):
            raise ExpectedError(self.expected)
        return self(int(text))


@dataclass(frozen=True)
class Real(Kind[float, float]):
    """A finite number from `least` to `most`; `above` instead of `least` leaves out the bound itself."""

    least: float | None = 0.0
    above: float | None = None
    most: float | None = None
    metavar: str = "X"

    @property
    def expected(self) -> str:
        if self.above is not None:
            low = "a positive number" if self.above == 0 else f"a number above {self.above:g}"
        else:
            low = "a finite number" if self.least is None else f"a number from {self.least:g} on"
        return low if self.most is None else f"{low.removesuffix(' on')} to {self.most:g}"

    def __call__(self, value: float) -> float:
        try:
            number = float(value)
        except (TypeError, ValueError):
            number = math.nan
        below = number < self.least if self.above is None and self.least is not None else False
        below = below or (self.above is not None and number <= self.above)
        if not math.isfinite(number) or below or (self.most is not None and number > self.most):
            raise ExpectedError(self.expected)
        return number

    parse = __call__  # type: ignore[assignment]


@dataclass(frozen=True)
class ExactNumber(Kind[Number, Fraction]):
    """A positive number, kept exactly: `0.25`, `30`, `30000/1001`; with `zero`, 0 too."""

    metavar: str = "NUMBER"
    zero: bool = False

    @property
    def expected(self) -> str:
        return "a number from 0 on" if self.zero else "a positive number"

    def __call__(self, value: Number) -> Fraction:
        try:
            number = rational(value)
            nearest = float(number)
        except (OverflowError, TypeError, ValueError):
            raise ExpectedError(self.expected) from None
        if number < 0 or (nearest == 0 and not (self.zero and number == 0)):  # too small for a float
            raise ExpectedError(self.expected)
        return number

    parse = __call__  # type: ignore[assignment]


@dataclass(frozen=True)
class Instant(Kind[object, object]):
    """A time [s], kept exactly, or in documents and Python an event, which the outputs know."""

    metavar: str = "SECONDS"

    def __call__(self, value: object) -> object:
        return ExactNumber(zero=True)(value) if isinstance(value, (int, float, str, Fraction)) else value

    def parse(self, text: str) -> Fraction:
        return ExactNumber(zero=True)(text)


@dataclass(frozen=True)
class Size(Kind[Sequence[int], tuple[int, int]]):
    """Width and height in pixels: `1280x720`."""

    metavar: str = "WxH"

    def __call__(self, value: Sequence[int]) -> tuple[int, int]:
        sides = () if isinstance(value, str) else tuple(value)
        if len(sides) != 2 or not all(hasattr(side, "__index__") and side > 0 for side in sides):
            raise ExpectedError("a width and a height in pixels, as in (640, 480)")
        return sides[0].__index__(), sides[1].__index__()

    def parse(self, text: str) -> tuple[int, int]:
        width, _, height = text.lower().partition("x")
        if not (width.isdecimal() and height.isdecimal() and int(width) and int(height)):
            raise ExpectedError("a size; write width x height in pixels, as in 1280x720")
        return int(width), int(height)

    def plain(self, value: tuple[int, int]) -> str:
        return f"{value[0]}x{value[1]}"


@dataclass(frozen=True)
class Range(Kind[Sequence[float], tuple[float, float]]):
    """Two numbers, the smaller first: `0.5..4`."""

    metavar: str = "LOW..HIGH"
    expected: str = "two numbers, the smaller first"

    def __call__(self, value: Sequence[float]) -> tuple[float, float]:
        low, high = value if len(value) == 2 else (math.nan, math.nan)
        if not -math.inf < low < high < math.inf:
            raise ExpectedError(self.expected)
        return float(low), float(high)

    def parse(self, text: str) -> tuple[float, float]:
        first, _, last = text.partition("..")
        try:
            return self((float(first), float(last)))
        except ValueError:
            raise ExpectedError("a range; write two numbers, the smaller first, as in 0.5..4") from None

    def plain(self, value: tuple[float, float]) -> list[float]:
        return [*value]


@dataclass(frozen=True)
class Processes(Kind[int | str, int | str]):
    """A number of processes or threads, or `auto`."""

    metavar: str = "N|auto"
    of: str = "processes"

    def __call__(self, value: int | str) -> int | str:
        whole = isinstance(value, int) and not isinstance(value, bool) and 0 < value < 10_000
        if value != AUTO and not whole:
            raise ExpectedError(f"a number of {self.of} from 1 on, or auto")
        return value

    def parse(self, text: str) -> int | str:
        return self(int(text) if text.isascii() and text.isdigit() and len(text) < 5 else text)


@dataclass(frozen=True)
class Percent(Real):
    """A share, written as a percentage on the command line: `10%` is 0.1."""

    metavar: str = "PERCENT"

    def parse(self, text: str) -> float:  # type: ignore[override]
        try:
            return self(float(text.removesuffix("%")) / 100 if text.endswith("%") else math.nan)
        except ValueError:
            raise ExpectedError("a percentage; write it as in 10%") from None


@dataclass(frozen=True)
class Groups(Kind[Sequence[int] | str, tuple[int, ...]]):
    """MuJoCo's groups: `0,1,2`, `all` or `none`."""

    metavar: str = "GROUPS"

    def __call__(self, value: Sequence[int] | str) -> tuple[int, ...]:
        if value in ("all", "none"):
            return GROUPS if value == "all" else ()
        groups = tuple(value)
        if not all(group in GROUPS for group in groups):
            raise ExpectedError("a list of groups from 0 to 5, all or none")
        return tuple(int(group) for group in groups)

    def parse(self, text: str) -> tuple[int, ...]:
        words = text.split(",")
        if text not in ("all", "none") and not all(re.fullmatch("[0-5]", word) for word in words):
            raise ExpectedError("a list of groups from 0 to 5, as in 0,1,2, or all, or none")
        return self(text if text in ("all", "none") else [int(word) for word in words])

    def plain(self, value: tuple[int, ...]) -> str | list[int]:
        return "all" if value == GROUPS else [*value] or "none"


@dataclass(frozen=True)
class Key(Kind[str | int, str]):
    """Something by name or index: a keyframe, a preset."""

    metavar: str = "NAME|INDEX"
    expected: str = "the name or index of a keyframe"

    def __call__(self, value: str | int) -> str:
        return str(value)


@dataclass(frozen=True)
class File(Kind[str | PathLike[str], str]):
    """A path.

    Attributes:
      written: whether it is an output; inputs are relative to the document's folder, outputs to that of all outputs.
    """

    metavar: str = "FILE"
    written: bool = False

    def __call__(self, value: str | PathLike[str]) -> str:
        return value if isinstance(value, str) else str(value.__fspath__())


@dataclass(frozen=True)
class PythonFunction(Kind[Callable[..., object] | None, Callable[..., object] | None]):
    """Python that the user names on the command line; a callable in Python; never in a document."""

    metavar: str = "CODE"

    def __call__(self, value: Callable[..., object] | None) -> Callable[..., object] | None:
        return value


@dataclass(frozen=True)
class Camera(Kind[object, object]):
    """What a camera does, as text; a document of shots, or such a document's value."""

    metavar: str = "SPEC"

    def __call__(self, value: object) -> object:
        match value:
            case int():
                return str(value)
            case PathLike():
                return str(cast("PathLike[str]", value).__fspath__())
            case _:
                return value


@dataclass(frozen=True)
class Ghost(Text):
    """The settings of a ghost as text; in documents a mapping too."""

    metavar: str = "SETTING,…"


@dataclass(frozen=True)
class Values(Kind[Mapping[str, float | Sequence[float]], Mapping[str, Numbers]]):
    """Numbers by name: `hip=0.3`, `root=0,0,1,1,0,0,0`."""

    metavar: str = "NAME=VALUE"

    def __call__(self, value: Mapping[str, float | Sequence[float]]) -> Mapping[str, Numbers]:
        return {name: _numbers(numbers) for name, numbers in value.items()}

    def parse(self, text: str) -> tuple[str, Numbers]:
        """One name and its numbers."""
        name, equals, written = text.rpartition("=")
        try:
            numbers = tuple(float(part) for part in written.split(","))
        except ValueError:
            numbers = (math.nan,)
        if not (equals and name and all(map(math.isfinite, numbers))):
            raise ExpectedError("NAME=VALUE, or NAME=VALUE,VALUE,… with finite numbers")
        return name, numbers

    def plain(self, value: Mapping[str, Numbers]) -> dict[str, float | Sequence[float]]:
        return {name: numbers[0] if len(numbers) == 1 else [*numbers] for name, numbers in value.items()}


@dataclass(frozen=True)
class Settings(Kind[Mapping[str, object] | Sequence[tuple[str, object]], tuple[tuple[str, str], ...]]):
    """Texts by path: `opt.gravity=0,0,10`. Later ones count where a path stands twice."""

    metavar: str = "PATH=VALUE"

    def __call__(self, value: Mapping[str, object] | Sequence[tuple[str, object]]) -> tuple[tuple[str, str], ...]:
        pairs = value.items() if isinstance(value, Mapping) else value
        return tuple((path, setting_text(setting)) for path, setting in pairs)

    def parse(self, text: str) -> tuple[str, str]:
        """One path and its text."""
        path, equals, setting = text.partition("=")
        if not (equals and path and setting):
            raise ExpectedError("PATH=VALUE, as in opt.gravity=0,0,10")
        return path, setting

    def plain(self, value: tuple[tuple[str, str], ...]) -> dict[str, str]:
        return dict(value)


@dataclass(frozen=True)
class ScanValues(Settings):
    """The values that settings take, in one text each: separated by commas, or semicolons where values have commas."""

    def __call__(self, value: Mapping[str, object] | Sequence[tuple[str, object]]) -> tuple[tuple[str, str], ...]:
        pairs = value.items() if isinstance(value, Mapping) else value
        return tuple((path, values if isinstance(values, str) else _one_text(values)) for path, values in pairs)


@dataclass(frozen=True)
class Several(Kind["W | Sequence[W]", tuple[T, ...]], Generic[W, T]):
    """One or several of a kind; repeated on the command line.

    Attributes:
      commas: whether one text may hold several, separated by commas outside of brackets.
      expected: what a text without any is not, if it is an error.
    """

    each: Kind[W, T]
    commas: bool = False
    expected: str = ""

    @property
    def metavar(self) -> str:  # type: ignore[override]
        return f"{self.each.metavar},…" if self.commas else self.each.metavar

    def __call__(self, value: "W | Sequence[W]") -> tuple[T, ...]:
        parts: list[Any] = [value] if self._is_one(value) else [*cast("Sequence[W]", value)]
        if self.commas:
            parts = [word for part in parts for word in (self._words(part) if isinstance(part, str) else (part,))]
        return tuple(self.each(part) for part in parts)

    def parse(self, text: str) -> object:
        """One of them, or those in one text."""
        return self._words(text) if self.commas else self.each.parse(text)

    @property
    def repeated(self) -> "Kind[Any, Any]":
        """The kind of one repetition on the command line."""
        return self if self.commas else self.each

    def _words(self, text: str) -> tuple[object, ...]:
        words = [word.strip() for word in re.split(r",(?![^\[]*\])", text) if word.strip()]
        if self.expected and not words:
            raise ExpectedError(self.expected)
        return tuple(map(self._parse_word, words))

    def plain(self, value: tuple[T, ...]) -> object:
        parts = [self.each.plain(part) for part in value]
        return parts[0] if len(parts) == 1 else parts

    def _parse_word(self, word: str) -> object:
        try:
            return self.each.parse(word)
        except ExpectedError as error:
            raise ExpectedError(error.expected, word) from None

    def _is_one(self, value: object) -> bool:
        """Whether `value` is one of them; (640, 480) is one size."""
        if not isinstance(value, Sequence) or isinstance(value, str):
            return True
        parts = cast("Sequence[object]", value)
        return isinstance(self.each, Size) and len(parts) == 2 and not isinstance(parts[0], Sequence)


@dataclass(frozen=True)
class Optional(Kind["W | None", "T | None"], Generic[W, T]):
    """What may be left out; None then."""

    each: Kind[W, T]

    @property
    def metavar(self) -> str:  # type: ignore[override]
        return self.each.metavar

    def __call__(self, value: "W | None") -> "T | None":
        return None if value is None else self.each(value)

    def parse(self, text: str) -> object:
        return self.each.parse(text)

    def plain(self, value: "T | None") -> object:
        return None if value is None else self.each.plain(value)


def setting_text(value: object) -> str:
    """What the command line would write for `value`: `0,0,-1.6`, `true`, `elliptic`.

    Raises:
      ExpectedError: it is no such value.
    """
    match value:
        case bool():
            return str(value).lower()
        case int() | float() if abs(value) < math.inf:
            return repr(value)
        case str() if value:
            return value
        case list() | tuple():
            parts = cast("Sequence[object]", value)
            if parts and all(type(part) in (int, float) for part in parts):
                return ",".join(map(setting_text, parts))
        case _:
            pass
    raise ExpectedError("a finite number, text, true or false, or a list of finite numbers")


def _one_text(values: object) -> str:
    if not isinstance(values, Sequence):
        raise ExpectedError("a list of values, or text")
    texts = [setting_text(value) for value in cast("Sequence[object]", values)]
    if not any("," in text for text in texts):
        return ",".join(texts)
    return ";".join(texts) + (";" if len(texts) == 1 else "")


def _numbers(value: float | Sequence[float]) -> Numbers:
    parts = value if isinstance(value, Sequence) or hasattr(value, "__len__") else [value]
    return tuple(float(part) for part in parts)  # type: ignore[union-attr]
