"""Runs the scoreboard and writes `SCORE.md`.

python -m tests.scoreboard                 all measures, whole
python -m tests.scoreboard models streams  some of them; the other rows stay as they are
python -m tests.scoreboard --quick         the small part that the tests run; writes nothing
"""

import argparse
import sys
import time
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path

from tests.scoreboard.measure import Measure, Tally, versions

SCORE = Path(__file__).resolve().parents[2] / "SCORE.md"
# One module of this folder for each row, in their order: its MEASURE.
MODULES: tuple[str, ...] = (
    "every_model",
    "hostile_models",
    "documents",
    "structural_fuzz",
    "outside_files",
    "inside_sandbox",
    "io_faults",
    "kills",
    "signals",
    "determinism",
    "exploding",
    "memory",
    "leaks",
    "exit_codes",
    "crowds",
    "pipelines",
)
HEAD = """# The scoreboard

What mjrun promises of faults, hostile input and determinism, measured by `make score` (`tests/scoreboard`): a row for
each measure, with the cases that were tried, those that passed, and the bar that each case had to clear.

| measure | tried | passed | bar | date | versions |
|---|---|---|---|---|---|
"""
MOST = 20  # failures that are listed for a measure


def measure(module: str) -> Measure:
    """The measure that a module of this folder holds."""
    return import_module(f"tests.scoreboard.{module}").MEASURE


def row(of: Measure, tally: Tally) -> str:
    """A row of the table."""
    date = datetime.now(UTC).date().isoformat()
    return f"| {of.name} | {tally.tried:,} | {tally.passed:,} | {of.bar} | {date} | {versions()} |"


def notes(of: Measure, tally: Tally) -> str:
    """What missed the bar, and what could not be tried, of one measure; empty if neither."""
    lines = [f"- missed: {' '.join(case.split())}" for case in tally.failures[:MOST]]
    if len(tally.failures) > MOST:
        lines.append(f"- missed: {len(tally.failures) - MOST} more")
    lines += [f"- not tried: {' '.join(case.split())}" for case in tally.left_out]
    return f"\n## {of.name}\n\n" + "\n".join(lines) + "\n" if lines else ""


def rows_of(page: str) -> dict[str, str]:
    """The rows of an earlier page, by the name of their measure."""
    lines = [line for line in page.splitlines() if line.startswith("| ")][1:]
    return {line.split("|")[1].strip(): line for line in lines}


def notes_of(page: str) -> dict[str, str]:
    """The sections of an earlier page, by the name of their measure."""
    sections = page.split("\n## ")[1:]
    return {section.split("\n", 1)[0]: f"\n## {section.rstrip()}\n" for section in sections}


def whole_page(rows: Mapping[str, str], sections: Mapping[str, str]) -> str:
    """The page of all measures, given the rows and notes of those that were run."""
    measures = [measure(module) for module in MODULES]
    table = [rows.get(of.name) or f"| {of.name} | not yet run whole | | {of.bar} | | |" for of in measures]
    return HEAD + "\n".join(table) + "\n" + "".join(sections.get(of.name, "") for of in measures)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("measures", nargs="*", metavar="MEASURE", help=f"of: {', '.join(MODULES)}")
    parser.add_argument("--quick", action="store_true", help="the part that the tests run; write nothing")
    options = parser.parse_args()
    if unknown := sorted(set(options.measures) - set(MODULES)):
        parser.error(f"no measure is named {', '.join(unknown)}: choose from {', '.join(MODULES)}")

    page = SCORE.read_text() if SCORE.exists() else ""
    rows, sections = rows_of(page), notes_of(page)
    missed = 0
    for module in options.measures or MODULES:
        of = measure(module)
        began = time.monotonic()
        tally = of.run(options.quick)
        short = not options.quick and tally.tried < of.least
        missed += len(tally.failures) + short
        print(f"{of.name}: {tally.passed:,} of {tally.tried:,} passed, {time.monotonic() - began:.0f} s", flush=True)
        print(notes(of, tally), end="", flush=True)
        rows[of.name], sections[of.name] = row(of, tally), notes(of, tally)
        if not options.quick:
            page = whole_page(rows, sections)
            SCORE.write_text(page, "utf-8", "backslashreplace")  # of file names that are not UTF-8
    sys.exit(bool(missed))


if __name__ == "__main__":
    main()
