"""What is told of a verified recording."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from mjrun.errors import clean

if TYPE_CHECKING:
    from mjrun.simulation.verification import FieldDifference, VerificationResult


def lines(result: "VerificationResult") -> Iterator[str]:
    """The verdict, what differs at the first step that does, and what is not as it was."""
    path, steps = clean(result.path), f"{result.steps} step{'s' * (result.steps != 1)}"
    if result.agrees:
        every = "" if result.states == result.steps + 1 else f" at its {result.states} states"
        yield f"{path}: stepped again, and the same: {steps}, bit for bit{every}"
    else:
        yield f"{path}: stepped again, and not the same: the first difference is at {_place(result)}"
        yield from map(_difference, result.differences)
    yield from (f"  {text}" for text in result.origins)


def _difference(field: "FieldDifference") -> str:
    others = f" (and {field.count - 1} more of {field.field})" if field.count > 1 else ""
    if field.stepped is None:
        values = f"recorded {field.recorded!r}, stepped to what is not finite"
    else:
        apart = abs(field.recorded - field.stepped)
        values = f"recorded {field.recorded!r}, stepped {field.stepped!r}, {apart:.3g} apart"
    return f"  {clean(field.name)}: {values}{others}"


def _place(result: "VerificationResult") -> str:
    return f"step {result.steps}, time {result.time:.9g} s"
