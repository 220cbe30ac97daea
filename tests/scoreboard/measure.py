"""What a measure of the scoreboard is, and what it has found."""

import platform
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.metadata import version


@dataclass
class Tally:
    """What was tried for one measure.

    Attributes:
      tried: cases that ran.
      failures: a line for each case that missed the bar: what was done, what came of it.
      left_out: a line for each kind of case that could not be tried here, with the reason. Nothing is skipped silently.
    """

    tried: int = 0
    failures: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    @property
    def passed(self) -> int:
        return self.tried - len(self.failures)

    def add(self, other: "Tally") -> None:
        """Counts the cases of another tally, too."""
        self.tried += other.tried
        self.failures += other.failures
        self.left_out += [line for line in other.left_out if line not in self.left_out]

    def expect(self, holds: bool, case: str) -> None:
        """Counts one case, which failed unless it holds."""
        self.tried += 1
        if not holds:
            self.failures.append(case)


@dataclass(frozen=True)
class Measure:
    """One row of the scoreboard.

    Attributes:
      name: its first column, in a few words.
      bar: what must hold for each case.
      least: how many cases a whole run must try.
      run: tries them. `quick` asks for the small part that `make test` runs: a few seconds, always the same cases.
    """

    name: str
    bar: str
    least: int
    run: Callable[[bool], Tally]


def versions() -> str:
    """Of what the figures depend on."""
    return f"mjrun {version('mjrun')}, MuJoCo {version('mujoco')}, Python {platform.python_version()}, {sys.platform}"
