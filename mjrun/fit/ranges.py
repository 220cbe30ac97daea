"""What a fit knows of parameters as distributions that a study varies."""

import json
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from mjrun.errors import UsageError, clean, option
from mjrun.fit.free_parameter import FreeParameter
from mjrun.formats.atomic_output import OutputWriter, written_file
from mjrun.suffixes import is_yaml

if TYPE_CHECKING:
    from mjrun.fit.result import FittedParameter


def write_ranges(
    stack: ExitStack,
    path: str,
    free: Sequence[FreeParameter],
    fitted: "Sequence[FittedParameter]",
    confidence: float,
) -> OutputWriter:
    """Writes the section `vary` of a study document.

    It then only has to be published; `stack` discards it otherwise.

    Each parameter that an override can set by itself has the normal distribution whose interval is that of the fit,
    within the bounds of the fit.

    Raises:
      UsageError: the file does not end in .yaml.
      FileError: it cannot be written.
    """
    from scipy import special

    check_ranges_name(path)
    width = 2 * float(special.ndtri((1 + confidence) / 2))
    lines = ["vary:"]
    for parameter, result in zip(free, fitted, strict=True):
        if (varied := parameter.override_path) is None:
            continue
        spread = max((result.high - result.low) / width, 1e-12 * abs(result.value), 1e-300)
        numbers = ", ".join(repr(float(n)) for n in (result.value, spread, parameter.low, parameter.high))
        lines.append(f"  {json.dumps(varied)}: {{truncnormal: [{numbers}]}}")
    return stack.enter_context(written_file(Path(path), ("\n".join(lines) + "\n").encode()))


def check_ranges_name(path: str) -> None:
    """Raises UsageError if no ranges are called `path`."""
    if not is_yaml(path):
        raise UsageError(f"{option('ranges')} {clean(path)}: ranges are written as .yaml")
