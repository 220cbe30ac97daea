"""The description of one column of a table: its name, its unit, and the object of the model it belongs to."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Column:
    """A named series of numbers, or of texts.

    Attributes:
      name: `group/object[/component]`, as in `qpos/knee` and `xpos/hand/z`; `time` alone.
      unit: SI, as in `m/s`; empty for pure numbers.
      meaning: a short description.
      kind, id: the kind of object it belongs to (`joint`, `body`, …) and its MuJoCo id; −1 for none.
      labels: for a column of texts, the texts that the numbers are indices into, −1 for none; tables show the texts.
      integer: whether all its numbers are whole, so that formats that know integers write them as such.
    """

    name: str
    unit: str = ""
    meaning: str = ""
    kind: str = ""
    id: int = -1
    labels: tuple[str, ...] = ()
    integer: bool = False
