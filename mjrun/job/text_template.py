"""`--text TEMPLATE`: time, speed and measured values, written over a film."""

import string
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mjrun.errors import UnknownNameError, UsageError, quoted

BUILTIN = {"time": ".2f", "frame": "d", "step": "d", "speed": "g"}
VALUE = ".4g"


@dataclass(frozen=True)
class Piece:
    """Text as it stands, then a value, if there is one, by name and format."""

    literal: str
    name: str = ""
    form: str = ""


@dataclass(frozen=True)
class Template:
    """A text with values in braces: `{time:.2f} s  {qpos/knee:.1f}`; `\\n` begins a line, `{{` is a brace."""

    pieces: Sequence[Piece]

    @property
    def columns(self) -> list[str]:
        """The columns that it shows, each once."""
        return list(dict.fromkeys(piece.name for piece in self.pieces if piece.name and piece.name not in BUILTIN))

    def filled(self, values: Mapping[str, float]) -> str:
        """The text with `values` by name."""
        parts = []
        for piece in self.pieces:
            value = format(values[piece.name], piece.form) if piece.name else ""
            parts.append(piece.literal + value)
        return "".join(parts)


def template(text: str, columns: Sequence[str]) -> Template:
    """The template that `text` is.

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
            f"--text {quoted(text)}: {error}\nwrite a value as {{time:.2f}}, and a brace as {{{{"
        ) from None
    known = [*BUILTIN, *columns]
    return Template([_piece(literal, name, form, known) for literal, name, form, _ in parsed])


def _piece(literal: str, name: str | None, form: str | None, known: Sequence[str]) -> Piece:
    if name is None:
        return Piece(literal)
    whole = f"{name}:{form}" if form else name  # a column may hold a colon itself, as in qpos/joint:0
    found = max((column for column in known if whole == column or whole.startswith(f"{column}:")), key=len, default="")
    if not found:
        raise UnknownNameError("value", name, known, where="--text")
    form = whole[len(found) + 1 :] or BUILTIN.get(found, VALUE)
    try:
        format(1 if found in ("frame", "step") else 1.0, form)
    except ValueError as error:
        raise UsageError(f"--text: {quoted(form)} cannot format {quoted(found)}: {error}") from None
    return Piece(literal, found, form)
