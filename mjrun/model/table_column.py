"""The description of a table column: its name, its unit, and the model object that it belongs to."""

import re

from mjrun.dataclass import dataclass

_WITH_UNIT = re.compile(r"(.*\S)\s*\[([^\[\]]*)\]", re.DOTALL)
_IN_PARENTHESES = re.compile(r"(.*\S)\s+\(([^()]*)\)", re.DOTALL)


@dataclass(frozen=True)
class Column:
    """A named series of numbers or texts.

    Attributes:
      name: `group/object[/component]`, as in `qpos/knee` and `xpos/hand/z`; `time` alone.
      unit: the SI unit, such as `m/s`; empty for pure numbers.
      meaning: a short description.
      kind: the kind of the object that the column belongs to (`joint`, `body`, …); empty for none.
      id: the MuJoCo id of that object; −1 for none.
      labels: the texts of a text column, whose numbers are indices into them; −1 means no text. Tables show the texts.
      integer: true if all numbers are whole; formats that distinguish integers write them as such.
      has_gaps: true if NaN means that no number exists, as in an empty cell.
    """

    name: str
    unit: str = ""
    meaning: str = ""
    kind: str = ""
    id: int = -1
    labels: tuple[str, ...] = ()
    integer: bool = False
    has_gaps: bool = False


def with_unit(name: str, unit: str | None) -> str:
    """Returns a name with its unit in brackets, if it has one: `depth [mm]`."""
    return f"{name} [{unit}]" if unit else name


def split_unit(text: str) -> tuple[str, str | None]:
    """Splits a name from the unit in brackets after it: `depth [mm]`, or None."""
    match = _WITH_UNIT.fullmatch(text)
    return (match[1], match[2].strip()) if match else (text, None)


def split_column(name: str) -> tuple[str, str | None]:
    """Splits the name of a column from its unit, which other programs write in parentheses: `Time (s)`."""
    match = _IN_PARENTHESES.fullmatch(name)
    return (match[1], match[2].strip()) if match else split_unit(name)
