"""What one column of a table is: its name, its unit, and what of the model it belongs to."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Column:
    """One named series of numbers, or of texts.

    Attributes:
      name: `group/object[/component]`, as in `qpos/knee` and `xpos/hand/z`; `time` alone.
      unit: SI, as in `m/s`; empty for pure numbers.
      meaning: a few words.
      kind, id: the kind of object it belongs to (`joint`, `body`, …) and its MuJoCo id; −1 for none.
      labels: the texts that the numbers stand for, each an index into them, −1 for no text; tables hold the texts.
        Empty for a column of numbers.
    """

    name: str
    unit: str = ""
    meaning: str = ""
    kind: str = ""
    id: int = -1
    labels: tuple[str, ...] = ()
