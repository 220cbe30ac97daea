"""The kind of the values over which something varies."""

from collections.abc import Callable, Mapping, Sequence
from typing import cast

from mjrun.options.kinds import Reader, ScanValues, setting_text
from mjrun.options.schema import NUMBER, TEXT, ExpectedError, Misfits, Schema

EXPECTED = "text, a list of values, {from, to, count}, or a distribution as in {uniform: [0.3, 1]}"
SPAN = {"from", "to", "count"}
LOG = "log"
CHOICE = "choice("
# Distributions, and how each is written.
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
        "count": {"type": "integer", "minimum": 2, "description": "How many values."},
        "log": {
            "type": "boolean",
            "default": False,
            "description": "Equal ratios between them instead of equal distances.",
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


class Variations(ScanValues):
    """What varies, and over which values: `0.3,0.6`, `0.1..1:10`, `log:1e-4..1e-1:7`, `uniform(0.3, 1)`."""

    @property
    def form(self) -> Schema:
        plain: list[Schema] = [NUMBER, TEXT, {"type": "boolean"}]
        listed: Schema = {"anyOf": [*plain, {"type": "array", "items": NUMBER}]}
        values = [*plain, {"type": "array", "items": listed}, SPAN_FORM, DISTRIBUTION]
        return {"type": "object", "additionalProperties": {"anyOf": values}}

    def read(self, value: object, reader: Reader) -> object:
        if not isinstance(value, dict):
            raise ExpectedError("a mapping")
        ways = {"model": reader.model, "ctrl_from": reader.input}
        texts: dict[str, str] = {}
        misfits = Misfits()
        for path, setting in cast("dict[str, object]", value).items():
            with misfits.at(path):
                text = self.text(setting)
                texts[path] = with_paths(text, ways[path]) if path in ways else text
        misfits.raise_if_any()
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
        except ExpectedError:
            raise ExpectedError(EXPECTED) from None


def _mapping_text(mapping: Mapping[str, object]) -> str:
    """`{from: 0.1, to: 1, count: 10, log: true}` or `{uniform: [0.3, 1]}` as text."""
    if set(mapping) - {LOG} == SPAN and isinstance(mapping.get(LOG, False), bool):
        first, last, count = (setting_text(mapping[key]) for key in ("from", "to", "count"))
        return f"{'log:' if mapping.get(LOG) else ''}{first}..{last}:{count}"
    name, arguments = next(iter(mapping.items()), ("", None))
    if len(mapping) == 1 and name in DISTRIBUTIONS and isinstance(arguments, list | tuple):
        return f"{name}({', '.join(map(setting_text, cast('Sequence[object]', arguments)))})"
    raise ExpectedError(EXPECTED)


def distribution_text(value: object) -> str:
    """A distribution or a number as text, where a document may write `{uniform: [-1, 1]}`.

    Raises:
      ExpectedError: it is neither.
    """
    match value:
        case Mapping() if not {"from", "to"} & set(cast("Mapping[str, object]", value)):
            return _mapping_text(cast("Mapping[str, object]", value))
        case str() | int() | float():
            return setting_text(value)
        case _:
            raise ExpectedError("a distribution as in uniform(-0.1, 0.1), or a number")


def with_paths(text: str, convert: Callable[[str], str]) -> str:
    """`text`, a list or a choice of paths, with every path converted."""
    inner, is_choice = text.strip(), text.strip().startswith(CHOICE)
    inner = inner.removeprefix(CHOICE).removesuffix(")") if is_choice else inner
    mark = ";" if ";" in inner and not is_choice else ","
    converted = mark.join(convert(part.strip()) if part.strip() else part for part in inner.split(mark))
    return f"{CHOICE}{converted})" if is_choice else converted
