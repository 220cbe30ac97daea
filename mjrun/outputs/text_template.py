"""Templates of text over frames: time, speed and measured values in braces."""

import string
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mjrun.errors import UnknownNameError, UsageError, option, quoted

BUILTIN = {"time": ".2f", "frame": "d", "step": "d", "speed": "g"}
DEFAULT_FORMAT = ".4g"


@dataclass(frozen=True)
class TemplatePart:
    """Literal text, then a value by name and format, if there is one."""

    literal: str
    name: str = ""
    form: str = ""


@dataclass(frozen=True)
class Template:
    """A text with values in braces: `{time:.2f} s  {qpos/knee:.1f}`; `\\n` begins a line, `{{` is a brace."""

    parts: Sequence[TemplatePart]

    @property
    def columns(self) -> list[str]:
        """The columns that it shows, each once."""
        return list(dict.fromkeys(part.name for part in self.parts if part.name and part.name not in BUILTIN))

    def filled(self, values: Mapping[str, float]) -> str:
        """The text with `values` by name."""
        texts: list[str] = []
        for part in self.parts:
            value = format(values[part.name], part.form) if part.name else ""
            texts.append(part.literal + value)
        return "".join(texts)


def parse_template(text: str, columns: Sequence[str]) -> Template:
    """The template in `text`.

    Args:
      columns: those that can be measured.

    Raises:
      UnknownNameError: a value that is none of them.
      UsageError: a brace that does not close, or a format that no number has.
    """
    try:
        parsed = list(string.Formatter().parse(text.replace("\\n", "\n")))
    except ValueError as error:
        raise UsageError(
            f"{option('text')} {quoted(text)}: {error}\nwrite a value as {{time:.2f}}, and a brace as {{{{"
        ) from None
    valid = [*BUILTIN, *columns]
    return Template([_part(literal, name, form, valid) for literal, name, form, _ in parsed])


def _part(literal: str, name: str | None, form: str | None, valid: Sequence[str]) -> TemplatePart:
    if name is None:
        return TemplatePart(literal)
    whole = f"{name}:{form}" if form else name  # a column may hold a colon itself, as in qpos/joint:0
    column = max((column for column in valid if whole == column or whole.startswith(f"{column}:")), key=len, default="")
    if not column:
        raise UnknownNameError("value", name, valid, where=option("text"))
    form = whole[len(column) + 1 :] or BUILTIN.get(column, DEFAULT_FORMAT)
    try:
        format(1 if column in ("frame", "step") else 1.0, form)
    except ValueError as error:
        raise UsageError(f"{option('text')}: {quoted(form)} cannot format {quoted(column)}: {error}") from None
    return TemplatePart(literal, column, form)
