"""The kind of the values over which something varies."""

from collections.abc import Callable, Mapping, Sequence
from typing import cast

from mjrun.options.kinds import ExpectedError, ScanValues, setting_text

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


class Variations(ScanValues):
    """What varies, and over which values: `0.3,0.6`, `0.1..1:10`, `log:1e-4..1e-1:7`, `uniform(0.3, 1)`."""

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
