"""What an assertion says of a table."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Verdict:
    """Whether the assertion `text` holds, and a `message` that says with which values and where."""

    text: str
    passed: bool
    message: str
