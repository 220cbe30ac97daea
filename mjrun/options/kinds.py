"""Kinds of option values: what Python may give, what a command line writes, and what a document holds.

A kind is a converter: called with what Python gives, it returns the value, checked and immutable. What a command line
writes (`parse`) and what a document holds (`read`) become what Python gives; `schema` describes the latter.

Kinds are plain classes: every command makes all of them before it knows which it needs, and dataclasses would take
longer to generate than all else here.
"""

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from os import PathLike, fspath
from typing import Any, Generic, TypeVar, cast

from mjrun.errors import Problem, suggestion
from mjrun.options.schema import NUMBER, TEXT, ExpectedError, Misfits, Schema, check, type_name
from mjrun.timeline import rational

V = TypeVar("V", contravariant=True)
T = TypeVar("T")
W = TypeVar("W")
Number = float | str | Fraction
Numbers = tuple[float, ...]
Vector = tuple[float, float, float]

GROUPS = tuple(range(6))  # MuJoCo's groups of geoms, sites, …: mjNGROUP of them
AUTO = "auto"


NUMBERS: Schema = {
    "anyOf": [NUMBER, {"type": "array", "items": NUMBER, "minItems": 1}],
    "forms": "a number or a list of numbers",
}
POINT: Schema = {"type": "array", "items": NUMBER, "minItems": 3, "maxItems": 3, "counted": "numbers"}
SETTING: Schema = {
    "anyOf": [NUMBER, TEXT, {"type": "boolean"}, {"type": "array", "items": NUMBER, "minItems": 1}],
    "expected": "a finite number, text, true or false, or a list of finite numbers",
}


class Reader:
    """What a document knows that the kinds of its values do not: where its paths lead, and how rooms above read a kind.

    This one leaves both as they are.

    Attributes:
      problems: what is wrong in other documents that this one names; it is reported after what is wrong here.
    """

    def __init__(self) -> None:
        self.problems: list[Problem] = []

    def input(self, path: str) -> str:
        """The path of a file that is read, as it is from here."""
        return path

    def output(self, path: str) -> str:
        """The path of a file that is written, as it is from here.

        Raises:
          UsageError: a document must not write there.
        """
        return path

    def model(self, text: str) -> str:
        """A model, as it is from here."""
        return text

    def form(self, kind: "AnyKind") -> "AnyKind":
        """The kind that reads the values of `kind` in documents."""
        return kind


class Kind(Generic[V, T]):
    """What values an option takes.

    Attributes:
      metavar: what stands for the value in help texts.
      accepted: completes the sentence "… is not" for values of types that the kind cannot convert.
    """

    metavar: str = "TEXT"
    accepted: str = ""

    def __init__(self, metavar: str = "") -> None:
        self.metavar = metavar or self.metavar

    def __call__(self, value: V) -> T:
        """The value that Python's `value` means.

        Raises:
          ExpectedError: it means none.
        """
        raise NotImplementedError

    def parse(self, text: str) -> object:
        """What `text` on a command line means, as Python might give it.

        Raises:
          ExpectedError: nothing.
        """
        return text

    @property
    def form(self) -> Schema:
        """The rule of what a document holds.

        Raises:
          NotImplementedError: documents do not know the kind.
        """
        raise NotImplementedError

    def schema(self, reader: Reader, definitions: dict[str, Schema]) -> Schema:
        """The same with the rules of all parts; those that have names are added to `definitions`."""
        return self.form

    def read(self, value: object, reader: Reader) -> object:
        """What a document's plain `value` means, as Python might give it.

        Raises:
          MisfitError, ExpectedError: it does not fit.
          UsageError: a path that it names does not.
        """
        check(value, self.form)
        return value

    def plain(self, value: T) -> object:
        """`value` as a document writes it; exact numbers are left to the writer."""
        return value


AnyKind = Kind[Any, Any]  # a kind whose values are not known here


class Text(Kind[str, str]):
    """Any text."""

    @property
    def form(self) -> Schema:
        return TEXT

    def __call__(self, value: object) -> str:
        if not isinstance(value, str):
            raise ExpectedError("text")
        return value


class MujocoName(Text):
    """The name of something that MuJoCo knows, such as a visual flag; looked up where it is used.

    Attributes:
      of: what it is a name of; documents and editors list the names.
    """

    def __init__(self, metavar: str, of: str) -> None:
        super().__init__(metavar)
        self.of = of


class Ghost(Text):
    """The settings of a ghost as text; in documents a mapping too."""

    metavar = "SETTING,…"


class Choice(Kind[str, str]):
    """One of a few words."""

    def __init__(self, names: tuple[str, ...]) -> None:
        super().__init__("|".join(names))
        self.names = names

    @property
    def form(self) -> Schema:
        return {"type": "string", "enum": [*self.names]}

    def __call__(self, value: str) -> str:
        if value not in self.names:
            hint = suggestion(value, self.names) if isinstance(value, str) else ""  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ExpectedError(f"one of {', '.join(self.names)}{hint}")
        return value


class Flag(Kind[bool, bool]):
    """Yes or no; `negatable` has a `--no-` spelling on the command line."""

    def __init__(self, *, negatable: bool = False) -> None:
        self.negatable = negatable

    @property
    def form(self) -> Schema:
        return {"type": "boolean"}

    def __call__(self, value: object) -> bool:
        if not isinstance(value, bool):
            raise ExpectedError("true or false")
        return value


class Integer(Kind[int, int]):
    """A whole number from `least` to `most`."""

    metavar = "N"

    def __init__(self, least: int | None = 0, most: int | None = None, metavar: str = "") -> None:
        super().__init__(metavar)
        self.least, self.most = least, most

    @property
    def expected(self) -> str:
        if self.most is not None:
            return f"a whole number from {self.least} to {self.most}"
        return "a whole number" if self.least is None else f"a whole number from {self.least} on"

    @property
    def form(self) -> Schema:
        least: Schema = {} if self.least is None else {"minimum": self.least}
        most: Schema = {} if self.most is None else {"maximum": self.most}
        return {"type": "integer", **({"exclusiveMinimum": 0} if self.least == 1 else least), **most}

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


class Real(Kind[float, float]):
    """A finite number from `least` to `most`; `above` instead of `least` leaves out the bound itself."""

    metavar = "X"

    def __init__(
        self, least: float | None = 0.0, above: float | None = None, most: float | None = None, metavar: str = ""
    ) -> None:
        super().__init__(metavar)
        self.least, self.above, self.most = least, above, most

    @property
    def expected(self) -> str:
        if self.above is not None:
            low = "a positive number" if self.above == 0 else f"a number above {self.above:g}"
        else:
            low = "a finite number" if self.least is None else f"a number from {self.least:g} on"
        return low if self.most is None else f"{low.removesuffix(' on')} to {self.most:g}"

    @property
    def form(self) -> Schema:
        bounds = {"minimum": self.least, "exclusiveMinimum": self.above, "maximum": self.most}
        if self.above is not None:
            bounds["minimum"] = None
        return {"type": "number", **{key: bound for key, bound in bounds.items() if bound is not None}}

    def __call__(self, value: float) -> float:
        number = _float(value)
        least = -math.inf if self.least is None else self.least
        high_enough = number >= least if self.above is None else number > self.above
        if not math.isfinite(number) or not high_enough or (self.most is not None and number > self.most):
            raise ExpectedError(self.expected)
        return number

    def parse(self, text: str) -> float:
        return self(_float(text))


class Percent(Real):
    """A share, written as a percentage on the command line: `10%` is 0.1."""

    metavar = "PERCENT"

    def parse(self, text: str) -> float:
        try:
            return self(_float(text[:-1]) / 100 if text.endswith("%") else math.nan)
        except ExpectedError:
            raise ExpectedError("a percentage; write it as in 10%") from None


class ExactNumber(Kind[Number, Fraction]):
    """A positive number, kept exactly: `0.25`, `30`, `30000/1001`; with `zero`, 0 too; with `signed`, any number."""

    metavar = "NUMBER"

    def __init__(self, metavar: str = "", *, zero: bool = False, signed: bool = False) -> None:
        super().__init__(metavar)
        self.zero, self.signed = zero or signed, signed

    @property
    def expected(self) -> str:
        return "a number" if self.signed else "a number from 0 on" if self.zero else "a positive number"

    @property
    def form(self) -> Schema:
        bound: Schema = {} if self.signed else {"minimum" if self.zero else "exclusiveMinimum": 0}
        sign = "-?" if self.signed else ""
        text = {"type": "string", "pattern": f"^{sign}[0-9.]+(/[0-9]+|[eE][-+]?[0-9]+)?$"}
        return {"anyOf": [{**NUMBER, **bound}, text], "expected": self.expected}

    def __call__(self, value: Number) -> Fraction:
        try:
            number = rational(value)
            nearest = float(number)
        except (OverflowError, TypeError, ValueError):
            raise ExpectedError(self.expected) from None
        too_small = nearest == 0 and not (self.zero and number == 0)  # for a float
        if (number < 0 and not self.signed) or too_small:
            raise ExpectedError(self.expected)
        return number

    def parse(self, text: str) -> Fraction:
        return self(text)

    def read(self, value: object, reader: Reader) -> object:
        if type_name(value) not in ("integer", "number", "string"):
            raise ExpectedError(self.expected)
        return self(cast("Number", value))


class Instant(Kind[object, object]):
    """A time [s], kept exactly, or in documents and Python an event, which the outputs know."""

    metavar = "SECONDS"

    def __call__(self, value: object) -> object:
        return ExactNumber(zero=True)(value) if isinstance(value, (int, float, str, Fraction)) else value

    def parse(self, text: str) -> Fraction:
        return ExactNumber(zero=True)(text)


class Size(Kind[Sequence[int], tuple[int, int]]):
    """Width and height in pixels: `1280x720`."""

    metavar = "WxH"
    accepted = "a width and a height in pixels, as in (640, 480)"

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
            raise ExpectedError(self.accepted)
        return sides[0].__index__(), sides[1].__index__()

    def parse(self, text: str) -> tuple[int, int]:
        width, _, height = text.lower().partition("x")
        if not (width.isdecimal() and height.isdecimal() and int(width) and int(height)):
            raise ExpectedError("a size; write width x height in pixels, as in 1280x720")
        return int(width), int(height)

    def plain(self, value: tuple[int, int]) -> str:
        return f"{value[0]}x{value[1]}"

    def read(self, value: object, reader: Reader) -> object:
        check(value, self.form)
        return self.parse(value) if isinstance(value, str) else value


class Range(Kind[Sequence[float], tuple[float, float]]):
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
            raise ExpectedError(self.expected)
        return float(low), float(high)

    def parse(self, text: str) -> tuple[float, float]:
        first, _, last = text.partition("..")
        try:
            return self((_float(first), _float(last)))
        except ExpectedError:
            raise ExpectedError("a range; write two numbers, the smaller first, as in 0.5..4") from None

    def plain(self, value: tuple[float, float]) -> list[float]:
        return [*value]


class Processes(Kind[int | str, int | str]):
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
            raise ExpectedError(f"a number of {self.of} from 1 on, or auto")
        return value

    def parse(self, text: str) -> int | str:
        return self(int(text) if text.isascii() and text.isdigit() and len(text) < 5 else text)


class Groups(Kind[Sequence[int] | str, tuple[int, ...]]):
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
            raise ExpectedError("a list of groups from 0 to 5, all or none")
        return tuple(int(group) for group in groups)

    def parse(self, text: str) -> tuple[int, ...]:
        words = text.split(",")
        if text not in ("all", "none") and not all(re.fullmatch("[0-5]", word) for word in words):
            raise ExpectedError("a list of groups from 0 to 5, as in 0,1,2, or all, or none")
        return self(text if text in ("all", "none") else [int(word) for word in words])

    def plain(self, value: tuple[int, ...]) -> str | list[int]:
        return "all" if value == GROUPS else [*value] or "none"


class Key(Kind[str | int, str]):
    """Something by name or index: a keyframe, a preset."""

    metavar = "NAME|INDEX"

    def __init__(self, metavar: str = "", expected: str = "the name or index of a keyframe") -> None:
        super().__init__(metavar)
        self.expected = expected

    @property
    def form(self) -> Schema:
        return {"anyOf": [TEXT, {"type": "integer", "minimum": 0}], "forms": self.expected}

    def __call__(self, value: str | int) -> str:
        return str(value)


class File(Kind[str | PathLike[str], str]):
    """A path.

    Attributes:
      written: whether it is an output; inputs are relative to the document's folder, outputs to that of all outputs.
    """

    metavar = "FILE"

    def __init__(self, metavar: str = "", *, written: bool = False) -> None:
        super().__init__(metavar)
        self.written = written

    @property
    def form(self) -> Schema:
        return TEXT

    def __call__(self, value: str | PathLike[str]) -> str:
        path = fspath(value)
        if not path:  # a variable of a script that was not set, as a rule
            raise ExpectedError("the name of a file")
        return path

    def read(self, value: object, reader: Reader) -> object:
        check(value, self.form)
        return reader.output(str(value)) if self.written else reader.input(str(value))


class PythonFunction(Kind[Callable[..., object] | None, Callable[..., object] | None]):
    """Python that the user names on the command line; a callable in Python; never in a document."""

    metavar = "CODE"

    def __call__(self, value: Callable[..., object] | None) -> Callable[..., object] | None:
        return value


class Camera(Kind[object, object]):
    """What a camera does, as text; a document of shots, or such a document's value."""

    metavar = "SPEC"

    def __call__(self, value: object) -> object:
        match value:
            case int():
                return str(value)
            case PathLike():
                return fspath(cast("PathLike[str]", value))
            case _:
                return value


class Values(Kind[Mapping[str, float | Sequence[float]], Mapping[str, Numbers]]):
    """Numbers by name: `hip=0.3`, `root=0,0,1,1,0,0,0`."""

    metavar = "NAME=VALUE"
    accepted = "a mapping of names to numbers, as in {'hip': 0.3}"

    @property
    def form(self) -> Schema:
        return {"type": "object", "additionalProperties": NUMBERS}

    def __call__(self, value: Mapping[str, float | Sequence[float]]) -> Mapping[str, Numbers]:
        return {name: _numbers(numbers) for name, numbers in value.items()}

    def parse(self, text: str) -> tuple[str, Numbers]:
        """One name and its numbers."""
        name, equals, written = text.rpartition("=")
        numbers = tuple(map(_float, written.split(",")))
        if not (equals and name and all(map(math.isfinite, numbers))):
            raise ExpectedError("NAME=VALUE, or NAME=VALUE,VALUE,… with finite numbers")
        return name, numbers

    def plain(self, value: Mapping[str, Numbers]) -> dict[str, float | Sequence[float]]:
        return {name: numbers[0] if len(numbers) == 1 else [*numbers] for name, numbers in value.items()}


class NumberVector(Kind["float | Sequence[float]", Numbers]):
    """One finite number, or one for each component."""

    metavar = "NUMBERS"

    @property
    def form(self) -> Schema:
        return NUMBERS

    def __call__(self, value: "float | Sequence[float]") -> Numbers:
        parts: Sequence[float] = [value] if isinstance(value, (int, float)) else value
        each: list[object] = [] if isinstance(parts, str) else [*parts]
        numbers = tuple(float(part) for part in each if isinstance(part, (int, float)) and math.isfinite(part))
        if not numbers or len(numbers) < len(each):
            raise ExpectedError("a finite number, or a list of them")
        return numbers

    def plain(self, value: Numbers) -> object:
        return value[0] if len(value) == 1 else [*value]


class Point(Kind[Vector, Vector]):
    """A point, or a displacement [m]: `x/y/z`."""

    metavar = "X/Y/Z"

    @property
    def form(self) -> Schema:
        return POINT

    def __call__(self, value: Vector) -> Vector:
        x, y, z = map(float, value)
        if not all(map(math.isfinite, (x, y, z))):
            raise ExpectedError("made of finite numbers", ", ".join(f"{number:g}" for number in value))
        return (x, y, z)

    def parse(self, text: str) -> Vector:
        try:
            x, y, z = map(float, text.split("/"))
            return self((x, y, z))
        except ValueError:
            raise ExpectedError("a point x/y/z [m]") from None

    def plain(self, value: Vector) -> object:
        return [*value]


class Settings(Kind[Mapping[str, object] | Sequence[tuple[str, object]], tuple[tuple[str, str], ...]]):
    """Texts by path: `opt.gravity=0,0,10`. Later ones count where a path stands twice."""

    metavar = "PATH=VALUE"
    accepted = "a mapping of names to values, or a sequence of pairs"
    example = "opt.gravity=0,0,10"

    def __init__(self, metavar: str = "", example: str = "") -> None:
        super().__init__(metavar)
        self.example = example or self.example

    @property
    def form(self) -> Schema:
        return {"type": "object", "additionalProperties": SETTING}

    def __call__(self, value: Mapping[str, object] | Sequence[tuple[str, object]]) -> tuple[tuple[str, str], ...]:
        pairs = [*(value.items() if isinstance(value, Mapping) else value)]
        if not all(isinstance(path, str) for path, _ in pairs):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ExpectedError(self.accepted)
        return tuple((path, self.text(setting)) for path, setting in pairs)

    def text(self, setting: object) -> str:
        """What the command line would write for the value of one path."""
        return setting_text(setting)

    def parse(self, text: str) -> tuple[str, str]:
        """One path and its text."""
        path, equals, setting = text.partition("=")
        if not (equals and path and setting):
            raise ExpectedError(f"{self.metavar}, as in {self.example}")
        return path, setting

    def plain(self, value: tuple[tuple[str, str], ...]) -> dict[str, str]:
        return dict(value)


class ColumnMap(Kind[str | PathLike[str] | Mapping[str, object] | Sequence[str], tuple[str, ...]]):
    """What columns mean, in texts `COLUMN=EXPRESSION`, or `@FILE` for a file of such lines."""

    metavar = "COLUMN=EXPRESSION"
    expected = "COLUMN=EXPRESSION, as in qpos/knee=knee_deg*pi/180, or @FILE"

    @property
    def form(self) -> Schema:
        expression = {"anyOf": [TEXT, NUMBER], "forms": "an expression or a number"}
        expressions = {
            "type": "object",
            "description": "Expressions by column.",
            "additionalProperties": expression,
        }
        return {
            "anyOf": [TEXT, {"type": "array", "items": TEXT}, expressions],
            "forms": "a mapping of columns to expressions, a list of COLUMN=EXPRESSION, or @FILE",
        }

    def __call__(self, value: str | PathLike[str] | Mapping[str, object] | Sequence[str]) -> tuple[str, ...]:
        match value:
            case str():
                return (self.parse(value),)
            case PathLike():
                return (f"@{fspath(value)}",)
            case Mapping():
                return tuple(self._part(f"{column}={_expression(of)}") for column, of in value.items())
            case _:
                return tuple(map(self._part, value))

    def parse(self, text: str) -> str:
        """One of the texts."""
        column, equals, of = text.partition("=")
        is_file = column[:1] == "@" and column[1:]
        if not is_file and not (equals and column.strip() and of.strip()):
            raise ExpectedError(self.expected)
        return text

    def _part(self, text: str) -> str:
        try:
            return self.parse(text)
        except ExpectedError as error:
            raise ExpectedError(error.expected, str(text)) from None

    def plain(self, value: tuple[str, ...]) -> object:
        pairs = [text.partition("=") for text in value if not text.startswith("@")]
        expressions = {column.strip(): of.strip() for column, _, of in pairs}
        if value and len(expressions) == len(value):
            return expressions
        return value[0] if len(value) == 1 else [*value]

    def read(self, value: object, reader: Reader) -> object:
        check(value, self.form)
        texts = self(cast("str | Mapping[str, object] | Sequence[str]", value))
        return tuple(f"@{reader.input(text[1:])}" if text.startswith("@") else text for text in texts)


class ScanValues(Settings):
    """The values that settings take, in one text each: separated by commas, or semicolons where values have commas."""

    example = "opt.timestep=.001,.002"

    def text(self, setting: object) -> str:
        if isinstance(setting, str):
            return setting
        if not isinstance(setting, Sequence):
            raise ExpectedError("a list of values, or text")
        texts = [setting_text(value) for value in cast("Sequence[object]", setting)]
        if not any("," in text for text in texts):
            return ",".join(texts)
        return ";".join(texts) + (";" if len(texts) == 1 else "")


class Several(Kind["W | Sequence[W]", tuple[T, ...]], Generic[W, T]):
    """One or several of a kind; repeated on the command line.

    Attributes:
      commas: whether one text may hold several, separated by commas outside of brackets.
      expected: what a text without any is not, if it is an error.
    """

    def __init__(self, each: Kind[W, T], *, commas: bool = False, expected: str = "") -> None:
        super().__init__(f"{each.metavar},…" if commas else each.metavar)
        self.accepted = each.accepted
        self.each: AnyKind = each
        self.commas, self.expected = commas, expected

    def __call__(self, value: "W | Sequence[W]") -> tuple[T, ...]:
        parts: Sequence[object] = [value] if self._is_one(value) else [*cast("Sequence[object]", value)]
        if self.commas:
            parts = [word for part in parts for word in (self._words(part) if isinstance(part, str) else (part,))]
        return tuple(self.each(part) for part in parts)

    def parse(self, text: str) -> object:
        """One of them, or those in one text."""
        return self._words(text) if self.commas else self.each.parse(text)

    @property
    def repeated(self) -> AnyKind:
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

    def read(self, value: object, reader: Reader) -> object:
        each = reader.form(self.each)
        if not isinstance(value, list):
            return (each.read(value, reader),)
        return read_list(each, cast("list[object]", value), reader)

    def schema(self, reader: Reader, definitions: dict[str, Schema]) -> Schema:
        each = reader.form(self.each).schema(reader, definitions)
        return {"anyOf": [each, {"type": "array", "items": each}]}


class Optional(Kind["W | None", "T | None"], Generic[W, T]):
    """What may be left out; None then."""

    def __init__(self, each: Kind[W, T]) -> None:
        super().__init__(each.metavar)
        self.accepted = each.accepted
        self.each: AnyKind = each

    def __call__(self, value: "W | None") -> "T | None":
        return None if value is None else self.each(value)

    def parse(self, text: str) -> object:
        return self.each.parse(text)

    def plain(self, value: "T | None") -> object:
        return None if value is None else self.each.plain(value)

    def read(self, value: object, reader: Reader) -> object:
        return reader.form(self.each).read(value, reader)

    def schema(self, reader: Reader, definitions: dict[str, Schema]) -> Schema:
        return reader.form(self.each).schema(reader, definitions)


def read_list(each: AnyKind, items: Sequence[object], reader: Reader) -> tuple[object, ...]:
    """What the items of a document's list mean.

    Raises:
      MisfitError: with all that does not fit.
    """
    parts: list[object] = []
    misfits = Misfits()
    for index, item in enumerate(items):
        with misfits.at(index):
            parts.append(each.read(item, reader))
    misfits.raise_if_any()
    return tuple(parts)


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


def _float(value: float | str) -> float:
    """`value` as a number, not finite where it is none."""
    try:
        return float(value)
    except (TypeError, ValueError):
        return math.nan


def _expression(value: object) -> str:
    """What gives a column, as text: an expression, or a number."""
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        raise ExpectedError("an expression or a number", str(value))
    return str(value)


def _numbers(value: float | Iterable[float]) -> Numbers:
    return tuple(map(float, value if isinstance(value, Iterable) else [value]))
