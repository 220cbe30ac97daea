"""What an assertion says of a table."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class PartRows:
    """A part of an assertion and how many rows it is about.

    Attributes:
      part: the part, as it is written.
      rows: the number of rows that it is about.
    """

    part: str
    rows: int


@dataclass(frozen=True)
class Verdict:
    """Whether an assertion holds.

    Attributes:
      text: the assertion, as it is written.
      passed: whether it holds.
      message: with which values, and where.
      rows: how many rows were checked.
      decided: the number of rows that each alternative of an `or` decides alone, since all others fail there, and the
        number that each aggregate with a condition is about.
    """

    text: str
    passed: bool
    message: str
    rows: int = 0
    decided: Sequence[PartRows] = ()
