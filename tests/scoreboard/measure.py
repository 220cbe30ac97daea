"""Measures of the scoreboard: their cases, results, and the page that shows them."""

import platform
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from typing import TypeVar

HEAD = """# The scoreboard

What mjrun promises about faults, hostile input and determinism, measured by `make score` (`tests/scoreboard`). There is
a row for each measure, with the number of cases tried and passed, and the bar that each case must clear.

| measure | tried | passed | bar | date | versions |
|---|---|---|---|---|---|
"""
MOST = 20  # failures listed for a measure
Part = TypeVar("Part")
Result = TypeVar("Result")


@dataclass
class Tally:
    """The cases tried for one measure.

    Attributes:
      tried: number of cases that ran.
      failures: a line for each case that missed the bar: the case, and its result.
      left_out: a line for each kind of case that could not be tried here, with the reason. Nothing is skipped silently.
    """

    tried: int = 0
    failures: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    @property
    def passed(self) -> int:
        return self.tried - len(self.failures)

    def add(self, other: "Tally") -> None:
        """Adds the cases of another tally."""
        self.tried += other.tried
        self.failures += other.failures
        for reason in other.left_out:
            self.leave_out(reason)

    def expect(self, holds: bool, case: str) -> None:
        """Counts one case, which fails unless it holds."""
        self.tried += 1
        if not holds:
            self.failures.append(case)

    def leave_out(self, reason: str) -> None:
        """Notes a kind of case that cannot be tried here, once."""
        if reason not in self.left_out:
            self.left_out.append(reason)


@dataclass(frozen=True)
class Measure:
    """One row of the scoreboard.

    Attributes:
      name: its first column, in a few words.
      bar: the condition that each case must meet.
      least: number of cases that a whole run must try.
      run: tries them; with True, only the small part that `make test` runs: a few seconds, always the same cases.
    """

    name: str
    bar: str
    least: int
    run: Callable[[bool], Tally]

    def row(self, tally: Tally) -> str:
        """Returns its row of the table."""
        date = datetime.now(UTC).date().isoformat()
        return f"| {self.name} | {tally.tried:,} | {tally.passed:,} | {self.bar} | {date} | {versions()} |"

    def notes(self, tally: Tally) -> str:
        """Returns the section with the failures and the cases left out; empty if there are neither."""
        lines = [f"- missed: {' '.join(case.split())}" for case in tally.failures[:MOST]]
        if len(tally.failures) > MOST:
            lines.append(f"- missed: {len(tally.failures) - MOST} more")
        lines += [f"- not tried: {' '.join(case.split())}" for case in tally.left_out]
        return f"\n## {self.name}\n\n" + "\n".join(lines) + "\n" if lines else ""


def measured(name: str, bar: str, least: int) -> Callable[[Callable[[bool], Tally]], Measure]:
    """Makes a function the measure of this name; the arguments are those of `Measure`."""
    return lambda run: Measure(name, bar, least, run)


def side_by_side(work: Callable[[Part], Iterable[Result]], parts: Sequence[Part]) -> Iterator[Result]:
    """Yields the results of all parts, each worked on in a thread, in the order of the parts."""
    with ThreadPoolExecutor(len(parts)) as threads:
        for results in threads.map(lambda part: list(work(part)), parts):
            yield from results


def lanes(cases: Sequence[Part], quick: bool) -> list[Sequence[Part]]:
    """Returns the cases for two servers that work at once, or for one."""
    return [cases] if quick else [cases[::2], cases[1::2]]


def versions() -> str:
    """Returns the versions that the figures depend on."""
    return f"mjrun {version('mjrun')}, MuJoCo {version('mujoco')}, Python {platform.python_version()}, {sys.platform}"


def rows_of(page: str) -> dict[str, str]:
    """Returns the rows of an earlier page by the name of their measure."""
    lines = [line for line in page.splitlines() if line.startswith("| ")][1:]
    return {line.split("|")[1].strip(): line for line in lines}


def notes_of(page: str) -> dict[str, str]:
    """Returns the sections of an earlier page by the name of their measure."""
    sections = page.split("\n## ")[1:]
    return {section.split("\n", 1)[0]: f"\n## {section.rstrip()}\n" for section in sections}


def whole_page(measures: Iterable[Measure], rows: Mapping[str, str], sections: Mapping[str, str]) -> str:
    """Returns the page of all measures, given the rows and sections of those that were run."""
    measures = list(measures)
    table = [rows.get(each.name) or f"| {each.name} | not yet run whole | | {each.bar} | | |" for each in measures]
    return HEAD + "\n".join(table) + "\n" + "".join(sections.get(each.name, "") for each in measures)
