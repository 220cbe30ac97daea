"""Markdown for the summary of a pull request: the numbers, and a table with the worst first."""

import re
from collections import Counter
from collections.abc import Iterable, Sequence

from mjrun.cli.console import Case
from mjrun.cli.table_cells import ReportColumn
from mjrun.errors import clean, counted

LEVELS = {"error": "❌", "warning": "⚠️", "note": "ℹ️"}  # worst first
MOST = 200  # rows; GitHub accepts summaries of up to 1 MiB, and comments of 64 KiB
SPECIAL = re.compile(r"([\\`*_{}\[\]<>#|~@&])")


def text(cases: Iterable[Case]) -> str:
    """Formats a table of the cases that did not pass, below their numbers."""
    cases = [*cases]
    shown = (case for case in cases if case.level and not case.repeats)
    failed = sorted(shown, key=lambda case: [*LEVELS].index(case.level))
    counts = Counter(case.level for case in failed)
    found = ", ".join(f"{LEVELS[level]} {counted(counts[level], level)}" for level in LEVELS if counts[level])
    checked = counted(len({case.name for case in cases}), "item")
    lines = [f"**{found or '✅ everything passes'}** in {checked}"]
    if failed:
        lines += ["", "| | place | finding |", "|---|---|---|", *map(_row, failed[:MOST])]
    if len(failed) > MOST:
        lines += ["", f"… and {len(failed) - MOST} more"]
    return "\n".join(lines)


def _row(case: Case) -> str:
    place = case.file + (f":{case.line}" if case.line else "") if case.file else case.name
    message, _, remedy = case.text.partition("\n")
    parts = [f"**{escaped(case.title)}**", escaped(message)]
    if remedy:
        parts.append(f"<sub>{escaped(remedy)}</sub>")
    return f"| {LEVELS[case.level]} | {escaped(place)} | {'<br>'.join(parts)} |"


def markdown_table(columns: Sequence[ReportColumn]) -> str:
    """Formats a table."""
    rule = ["--:" if column.right else ":--" for column in columns]
    rows = [[column.heading for column in columns], rule, *zip(*(column.cells for column in columns), strict=True)]
    cells = ([cell if row is rule else escaped(cell) for cell in row] for row in rows)
    return "\n".join(f"| {' | '.join(row)} |" for row in cells)


def escaped(value: str) -> str:
    """Escapes Markdown and mentions of users in names from models."""
    return "<br>".join(SPECIAL.sub(r"\\\1", clean(line)) for line in value.split("\n"))
