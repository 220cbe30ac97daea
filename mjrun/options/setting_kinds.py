"""Kinds of settings: numbers, texts and variations by name, and maps of columns."""

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from decimal import Decimal
from fractions import Fraction
from os import PathLike, fspath
from typing import TypeVar, cast

from mjrun.options.kinds import Kind, ReadingContext
from mjrun.options.number_kinds import NUMBERS, Numbers, to_float
from mjrun.options.schema_validation import NUMBER, TEXT, InvalidValueError, Schema, SchemaViolationCollector, check
from mjrun.timeline import rational

N = TypeVar("N")
SETTING: Schema = {
    "anyOf": [NUMBER, TEXT, {"type": "boolean"}, {"type": "array", "items": NUMBER, "minItems": 1}],
    "expected": "a finite number, text, true or false, or a list of finite numbers",
}
SEVERAL = re.compile(r"=\s*[-+]?\.?\d[^=]*,")  # a value and a comma before another equals sign


class NamedNumbersKind(Kind[Mapping[str, float | Sequence[float]], Mapping[str, Numbers]]):
    """Numbers by name: `hip=0.3`, `root=0,0,1,1,0,0,0`."""

    metavar = "NAME=VALUE"
    accepted = "a mapping of names to numbers, as in {'hip': 0.3}"

    @property
    def form(self) -> Schema:
        return {"type": "object", "additionalProperties": NUMBERS}

    def __call__(self, value: Mapping[str, float | Sequence[float]]) -> Mapping[str, Numbers]:
        return {name: _numbers(numbers) for name, numbers in value.items()}

    def parse(self, text: str) -> tuple[str, Numbers]:
        """Splits text into a name and its numbers."""
        name, equals, written = _one_setting(text)
        numbers = tuple(map(to_float, written.split(",")))
        if not (equals and name and all(map(math.isfinite, numbers))):
            raise InvalidValueError("NAME=VALUE, or NAME=VALUE,VALUE,… with finite numbers")
        return name, numbers

    def plain(self, value: Mapping[str, Numbers]) -> dict[str, float | Sequence[float]]:
        return {name: numbers[0] if len(numbers) == 1 else [*numbers] for name, numbers in value.items()}


def _one_setting(text: str) -> tuple[str, str, str]:
    """Splits text at its last equals sign; several settings in one text are refused, as commas separate numbers."""
    parts = text.rpartition("=")
    if SEVERAL.search(parts[0]):
        raise InvalidValueError("one NAME=VALUE; repeat the option for each name")
    return parts


class AngleWithUnit(float):
    """An angle [rad] or its rate, for which a unit was given."""


class LengthWithUnit(float):
    """A length [m] or its rate, for which a unit was given."""


UNITS: Mapping[str, tuple[type[AngleWithUnit | LengthWithUnit], float]] = {
    "deg": (AngleWithUnit, math.pi / 180),
    "rad": (AngleWithUnit, 1.0),
    "mm": (LengthWithUnit, 0.001),
    "cm": (LengthWithUnit, 0.01),
    "m": (LengthWithUnit, 1.0),
}
QUANTITY = rf"\s*([-+.\deE]+)\s*({'|'.join(UNITS)})(/s)?\s*"  # compiled when it is used


class JointNumbersKind(NamedNumbersKind):
    """Positions or velocities by the name of the joint, whose numbers may have units: `hip=30deg`, `root/z=25cm`.

    Args:
      rate: the numbers are velocities, with units per second.
    """

    accepted = "a mapping of names to numbers, as in {'hip': 0.3} or {'hip': '20deg'}"

    def __init__(self, *, rate: bool = False) -> None:
        super().__init__()
        self._rate = rate
        self._units = [f"{unit}/s" if rate else unit for unit in UNITS]

    @property
    def form(self) -> Schema:
        units = "/s" if self._rate else ""
        pattern = rf"^\s*[-+.\deE]+\s*({'|'.join(UNITS)}){units}\s*$"
        listed = f"which may have units: {', '.join(self._units)}"
        one: Schema = {"type": "string", "pattern": pattern, "expected": f"a number, {listed}"}
        several: Schema = {"type": "array", "items": {"anyOf": [NUMBER, one]}, "minItems": 1}
        forms = f"a number or a list of numbers, {listed}"
        numbers: Schema = {"anyOf": [NUMBER, {**one, "expected": forms}, several], "forms": forms}
        return {"type": "object", "additionalProperties": numbers}

    def __call__(self, value: Mapping[str, float | str | Sequence[float | str]]) -> Mapping[str, Numbers]:
        return {name: tuple(map(self._number, _sequence(numbers))) for name, numbers in value.items()}

    def parse(self, text: str) -> tuple[str, Numbers]:
        """Splits text into a name and its numbers."""
        name, equals, written = _one_setting(text)
        try:
            if equals and name:
                return name, tuple(map(self._number, written.split(",")))
        except InvalidValueError:
            pass
        units = f"with finite numbers, which may have units: {', '.join(self._units)}"
        raise InvalidValueError(f"NAME=VALUE, or NAME=VALUE,VALUE,… {units}")

    def _number(self, value: float | str) -> float:
        """Converts a number, or a text that may have a unit, to SI units."""
        if not isinstance(value, str):
            return value if isinstance(value, AngleWithUnit | LengthWithUnit) else float(value)
        match = re.fullmatch(QUANTITY, value)
        if match is None and math.isfinite(number := to_float(value)):
            return number
        if match and bool(match[3]) == self._rate:
            kind, factor = UNITS[match[2]]
            number = to_float(match[1])
            if math.isfinite(number):
                is_exact = kind is LengthWithUnit  # and rounded once: 9mm is 0.009
                return kind(rational(number) * rational(factor) if is_exact else number * factor)
        raise InvalidValueError(f"a list of finite numbers, which may have units: {', '.join(self._units)}")

    def plain(self, value: Mapping[str, Numbers]) -> dict[str, float | Sequence[float]]:
        return super().plain({name: tuple(map(float, numbers)) for name, numbers in value.items()})


class SettingsKind(Kind[Mapping[str, object] | Sequence[tuple[str, object]], tuple[tuple[str, str], ...]]):
    """Texts by path: `opt.gravity=0,0,10`. If a path occurs twice, the last one applies."""

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
            raise InvalidValueError(self.accepted)
        return tuple((path, self.text(setting)) for path, setting in pairs)

    def text(self, setting: object) -> str:
        """Formats the value of one path as the command line would."""
        return setting_text(setting)

    def parse(self, text: str) -> tuple[str, str]:
        """Splits text into a path and its value."""
        path, equals, setting = text.partition("=")
        if not (equals and path and setting):
            raise InvalidValueError(f"{self.metavar}, as in {self.example}")
        return path, setting

    def plain(self, value: tuple[tuple[str, str], ...]) -> dict[str, str]:
        return dict(value)


class ColumnDefinitionsKind(Kind[str | PathLike[str] | Mapping[str, object] | Sequence[str], tuple[str, ...]]):
    """Definitions of columns as texts `COLUMN=EXPRESSION`, or `@FILE` for a file of such lines."""

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
        """Checks one definition."""
        column, equals, of = text.partition("=")
        is_file = column[:1] == "@" and column[1:]
        if not is_file and not (equals and column.strip() and of.strip()):
            raise InvalidValueError(self.expected)
        return text

    def _part(self, text: str) -> str:
        try:
            return self.parse(text)
        except InvalidValueError as error:
            raise InvalidValueError(error.expected, str(text)) from None

    def plain(self, value: tuple[str, ...]) -> object:
        pairs = [text.partition("=") for text in value if not text.startswith("@")]
        expressions = {column.strip(): of.strip() for column, _, of in pairs}
        if value and len(expressions) == len(value):
            return expressions
        return value[0] if len(value) == 1 else [*value]

    def read(self, value: object, reader: ReadingContext) -> object:
        check(value, self.form)
        texts = self(cast("str | Mapping[str, object] | Sequence[str]", value))
        return tuple(f"@{reader.input(text[1:])}" if text.startswith("@") else text for text in texts)


class ScanValuesKind(SettingsKind):
    """The values of each setting in one text, separated by commas, or by semicolons if values contain commas."""

    example = "opt.timestep=.001,.002"

    def text(self, setting: object) -> str:
        if isinstance(setting, str):
            return setting
        if not isinstance(setting, Sequence):
            raise InvalidValueError("a list of values, or text")
        texts = [setting_text(value) for value in cast("Sequence[object]", setting)]
        if not any("," in text for text in texts):
            return ",".join(texts)
        return ";".join(texts) + (";" if len(texts) == 1 else "")


def setting_text(value: object) -> str:
    """Formats `value` as the command line would: `0,0,-1.6`, `true`, `elliptic`.

    Raises:
      InvalidValueError: the value is not a setting.
    """
    match value:
        case bool():
            return str(value).lower()
        case int() | float() if abs(value) < math.inf:
            return repr(value)
        case Fraction() | Decimal():
            return setting_text(float(value))
        case str() if value:
            return value
        case list() | tuple():
            parts = cast("Sequence[object]", value)
            if parts and all(type(part) in (int, float, Fraction, Decimal) for part in parts):
                return ",".join(map(setting_text, parts))
        case _:
            pass
    raise InvalidValueError("a finite number, text, true or false, or a list of finite numbers")


def _expression(value: object) -> str:
    """Formats the definition of a column: an expression, or a number."""
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        raise InvalidValueError("an expression or a number", str(value))
    return str(value)


def _numbers(value: float | Iterable[float]) -> Numbers:
    return tuple(map(float, _sequence(value)))


def _sequence(value: N | Iterable[N]) -> Iterable[N]:
    """Returns several numbers unchanged, and one number, which may be text, in a list."""
    is_one = isinstance(value, str) or not isinstance(value, Iterable)
    return [cast("N", value)] if is_one else cast("Iterable[N]", value)


EXPECTED = "text, a list of values, {from, to, count}, or a distribution as in {uniform: [0.3, 1]}"
LOG = "log"
CHOICE = "choice("
CALL = r"(?s)\s*(\w+)\s*\((.*)\)\s*"  # the form of a distribution; compiled when it is used
# The distributions, each with its syntax.
DISTRIBUTIONS = {
    "uniform": "uniform(LOW, HIGH)",
    "loguniform": "loguniform(LOW, HIGH)",
    "normal": "normal(MEAN, STD)",
    "truncnormal": "truncnormal(MEAN, STD, LOW, HIGH)",
    "integers": "integers(FIRST, LAST)",
    "choice": "choice(VALUE, VALUE, …)",
}


SPAN_FORM: Schema = {
    "description": "Values from one number to another, both included.",
    "type": "object",
    "properties": {
        "from": {**NUMBER, "description": "The first value."},
        "to": {**NUMBER, "description": "The last value."},
        "count": {"type": "integer", "minimum": 2, "description": "Number of values."},
        "log": {
            "type": "boolean",
            "default": False,
            "description": "Space values by equal ratios instead of equal differences.",
        },
    },
    "required": ["from", "to", "count"],
    "additionalProperties": False,
}
DISTRIBUTION: Schema = {
    "description": f"Random values: {', '.join(DISTRIBUTIONS.values())}.",
    "type": "object",
    "propertyNames": {"enum": [*DISTRIBUTIONS]},
    "additionalProperties": {"type": "array", "items": {"anyOf": [NUMBER, TEXT]}},
    "minProperties": 1,
    "maxProperties": 1,
}


class VariedSettingsKind(ScanValuesKind):
    """Settings to vary, with their values: `0.3,0.6`, `0.1..1:10`, `log:1e-4..1e-1:7`, `uniform(0.3, 1)`."""

    @property
    def form(self) -> Schema:
        plain: list[Schema] = [NUMBER, TEXT, {"type": "boolean"}]
        listed: Schema = {"anyOf": [*plain, {"type": "array", "items": NUMBER}]}
        values = [*plain, {"type": "array", "items": listed}, SPAN_FORM, DISTRIBUTION]
        return {"type": "object", "additionalProperties": {"anyOf": values}}

    def read(self, value: object, reader: ReadingContext) -> object:
        if not isinstance(value, dict):
            raise InvalidValueError("a mapping")
        ways = {"model": reader.model, "ctrl_from": reader.input}
        texts: dict[str, str] = {}
        violations = SchemaViolationCollector()
        for path, setting in cast("dict[str, object]", value).items():
            with violations.at(path):
                text = self.text(setting)
                texts[path] = with_paths(text, ways[path]) if path in ways else text
        violations.raise_if_any()
        return texts

    def text(self, setting: object) -> str:
        match setting:
            case Mapping():
                return _mapping_text(cast("Mapping[str, object]", setting))
            case bool() | int() | float():
                return setting_text(setting)
            case _:
                return self._listed(setting)

    def _listed(self, setting: object) -> str:
        try:
            return super().text(setting)
        except InvalidValueError:
            raise InvalidValueError(EXPECTED) from None


def _mapping_text(mapping: Mapping[str, object]) -> str:
    """Formats `{from: 0.1, to: 1, count: 10, log: true}` or `{uniform: [0.3, 1]}` as text."""
    if set(mapping) - {LOG} == {"from", "to", "count"} and isinstance(mapping.get(LOG, False), bool):
        first, last, count = (setting_text(mapping[key]) for key in ("from", "to", "count"))
        return f"{'log:' if mapping.get(LOG) else ''}{first}..{last}:{count}"
    name, arguments = next(iter(mapping.items()), ("", None))
    if len(mapping) == 1 and name in DISTRIBUTIONS and isinstance(arguments, list | tuple):
        return f"{name}({', '.join(map(setting_text, cast('Sequence[object]', arguments)))})"
    raise InvalidValueError(EXPECTED)


def distribution_text(value: object) -> str:
    """Formats a distribution or a number as text; a document may write `{uniform: [-1, 1]}`.

    Raises:
      InvalidValueError: the value is neither.
    """
    match value:
        case Mapping() if not {"from", "to"} & set(cast("Mapping[str, object]", value)):
            return _mapping_text(cast("Mapping[str, object]", value))
        case str() | int() | float():
            return setting_text(value)
        case _:
            raise InvalidValueError("a distribution as in uniform(-0.1, 0.1), or a number")


def with_paths(text: str, convert: Callable[[str], str]) -> str:
    """Converts every path in `text`, a list or a choice of paths."""
    inner, is_choice = text.strip(), text.strip().startswith(CHOICE)
    inner = inner.removeprefix(CHOICE).removesuffix(")") if is_choice else inner
    mark = ";" if ";" in inner and not is_choice else ","
    converted = mark.join(convert(part.strip()) if part.strip() else part for part in inner.split(mark))
    return f"{CHOICE}{converted})" if is_choice else converted
