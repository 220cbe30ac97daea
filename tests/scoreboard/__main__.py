"""Runs the scoreboard and writes `SCORE.md`.

python -m tests.scoreboard                        all measures, whole
python -m tests.scoreboard every_model pipelines  some of them; the other rows stay unchanged
python -m tests.scoreboard --quick                the small part that the tests run; writes nothing
"""

import argparse
import sys
import time
from importlib import import_module
from pathlib import Path

from tests.scoreboard.measure import Measure, notes_of, rows_of, whole_page

SCORE = Path(__file__).resolve().parents[2] / "SCORE.md"
# The measures in the order of their rows, each with its module in this folder.
MEASURES = {
    "every_model": "every_model",
    "hostile_models": "hostile_models",
    "documents": "documents",
    "structural_fuzz": "structural_fuzz",
    "outside_files": "outside_files",
    "inside_sandbox": "inside_sandbox",
    "io_faults": "io_faults",
    "kills": "io_faults",
    "signals": "signals",
    "determinism": "determinism",
    "exploding": "exploding",
    "memory": "leaks",
    "leaks": "leaks",
    "exit_codes": "exit_codes",
    "crowds": "crowds",
    "pipelines": "pipelines",
}


def measure(name: str) -> Measure:
    """Returns a measure by name."""
    return getattr(import_module(f"tests.scoreboard.{MEASURES[name]}"), name)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("measures", nargs="*", metavar="MEASURE", help=f"one of {', '.join(MEASURES)}")
    parser.add_argument("--quick", action="store_true", help="run the part that the tests run, and write nothing")
    options = parser.parse_args()
    if unknown := sorted(set(options.measures) - set(MEASURES)):
        parser.error(f"unknown measure: {', '.join(unknown)}; choose from {', '.join(MEASURES)}")

    page = SCORE.read_text() if SCORE.exists() else ""
    rows, sections = rows_of(page), notes_of(page)
    missed = 0
    for name in options.measures or MEASURES:
        each = measure(name)
        began = time.monotonic()
        tally = each.run(options.quick)
        short = not options.quick and tally.tried < each.least
        missed += len(tally.failures) + short
        print(f"{each.name}: {tally.passed:,} of {tally.tried:,} passed, {time.monotonic() - began:.0f} s", flush=True)
        print(each.notes(tally), end="", flush=True)
        rows[each.name], sections[each.name] = each.row(tally), each.notes(tally)
        if not options.quick:
            page = whole_page(map(measure, MEASURES), rows, sections)
            SCORE.write_text(page, "utf-8", "backslashreplace")  # file names may not be UTF-8
    sys.exit(bool(missed))


if __name__ == "__main__":
    main()
