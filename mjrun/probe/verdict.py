"""What an assertion says of a table."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Verdict:
    """Whether an assertion holds.

    Attributes:
      text: the assertion, as it is written.
      passed: whether it holds.
      message: with which values, and where.
    """

    text: str
    passed: bool
    message: str
