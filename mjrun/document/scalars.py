"""Plain scalars of documents: what they mean, and numbers in their shortest form."""

import math
import re
from fractions import Fraction

from mjrun.errors import UsageError
from mjrun.timeline import rational

NOTHING = {"", "~", "null", "Null", "NULL"}
TRUTH = {"true": True, "True": True, "TRUE": True, "false": False, "False": False, "FALSE": False}
LONGEST = 309  # digits of the largest float
_INTEGER = re.compile(r"[-+]?[0-9]+")
_PREFIXED = re.compile(r"0o[0-7]+|0x[0-9a-fA-F]+")
_REAL = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_INFINITY = re.compile(r"([-+]?)\.(?:inf|Inf|INF)")
_NO_NUMBER = {".nan", ".NaN", ".NAN"}


def meaning(text: str) -> bool | int | float | str | None:
    """Returns the value of a plain scalar; integers of more than `LONGEST` digits become floats, usually infinite."""
    if text in NOTHING:
        return None
    if text in TRUTH:
        return TRUTH[text]
    if _PREFIXED.fullmatch(text):
        return int(text, 0) if len(text) <= LONGEST else math.inf
    if _INTEGER.fullmatch(text) and len(text) <= LONGEST:
        return int(text)
    if _REAL.fullmatch(text):
        return float(text)
    if infinity := _INFINITY.fullmatch(text):
        return -math.inf if infinity[1] == "-" else math.inf
    return math.nan if text in _NO_NUMBER else text


def number(value: float) -> float:
    """Returns `value` as the shortest equal number.

    Raises:
      UsageError: the value is not finite.
    """
    if not math.isfinite(value):
        raise UsageError(f"a document cannot contain the number {value}; numbers must be finite")
    return int(value) if value == int(value) and (isinstance(value, int) or abs(value) < 1e16) else float(value)


def exact(value: float | str | Fraction) -> float | str:
    """Returns `value` as a number if that is exact, or else as text such as `30000/1001`."""
    meant = rational(value)
    try:
        near = number(float(meant))
        return near if rational(near) == meant else str(meant)
    except OverflowError:
        return str(meant)
