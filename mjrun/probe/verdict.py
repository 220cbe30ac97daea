"""The outcomes of assertions about tables."""

from collections.abc import Sequence

from mjrun.dataclass import dataclass


@dataclass(frozen=True)
class PartRowCount:
    """The number of rows that one part of an assertion decides or uses.

    Attributes:
      part: text of the part.
      rows: number of the rows that it decides or uses.
    """

    part: str
    rows: int


@dataclass(frozen=True)
class Verdict:
    """The outcome of an assertion.

    Attributes:
      text: text of the assertion.
      passed: whether it holds.
      message: a sentence with the decisive values and their place.
      rows: number of checked rows.
      decided: number of rows that each alternative of an `or` decides alone, since all others fail there, and number of
        rows that each aggregate with a condition uses.
    """

    text: str
    passed: bool
    message: str
    rows: int = 0
    decided: Sequence[PartRowCount] = ()
