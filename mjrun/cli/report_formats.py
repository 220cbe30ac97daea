"""Formats of reports for CI systems: GitHub Actions annotations, JUnit XML, and Markdown for pull requests."""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence

from mjrun.cli.table_cells import ReportColumn
from mjrun.dataclass import dataclass
from mjrun.errors import clean, counted

ANNOTATIONS = {"error": "error", "warning": "warning", "note": "notice"}
FAILURES = ("error", "warning")
SYMBOLS = {"error": "❌", "warning": "⚠️", "note": "ℹ️"}  # worst first
MOST = 200  # rows; GitHub accepts summaries of up to 1 MiB, and comments of 64 KiB
SPECIAL = re.compile(r"([\\`*_{}\[\]<>#|~@&])")


@dataclass(frozen=True)
class CiVerdict:
    """A verdict of a command, as formats for CI systems report it.

    Attributes:
      name: the thing that was checked, such as a model.
      level: `error`, `warning` or `note`; empty if it passed.
      title: the name of the rule, or of the comparison.
      text: the message; empty if it passed.
      file: the file that the message is about; empty for none.
      line: line in the file, if known.
      repeats: true if an earlier case is the same but for its name, so that a list of places shows it once.
    """

    name: str
    level: str = ""
    title: str = ""
    text: str = ""
    file: str = ""
    line: int | None = None
    repeats: bool = False


def github(cases: Iterable[CiVerdict]) -> str:
    """Formats a GitHub Actions annotation for each case that did not pass: `::warning file=…,line=…,title=…::message`.

    https://docs.github.com/actions/reference/workflow-commands-for-github-actions
    """
    return "\n".join(_annotation(case) for case in cases if case.level and not case.repeats)


def _annotation(case: CiVerdict) -> str:
    place = f"file={_escaped_property(case.file)}," + (f"line={case.line}," if case.line else "") if case.file else ""
    # In one line, with escapes so that no other command can begin.
    message = "\n".join(clean(part) for part in case.text.split("\n"))
    message = message.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")
    return f"::{ANNOTATIONS[case.level]} {place}title={_escaped_property(case.title)}::{message}"


def _escaped_property(text: str) -> str:
    return clean(text).replace("%", "%25").replace(":", "%3A").replace(",", "%2C")


def junit(cases: Iterable[CiVerdict]) -> str:
    """Formats JUnit XML with a test case for each case; errors and warnings are failures, and notes are output."""
    cases = [*cases]
    failures = sum(case.level in FAILURES for case in cases)
    numbers = f'tests="{len(cases)}" failures="{failures}" errors="0"'
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', f'<testsuites name="mjrun" {numbers}>']
    lines += [f'<testsuite name="mjrun" {numbers} skipped="0">', *map(_test_case, cases), "</testsuite>"]
    return "\n".join([*lines, "</testsuites>"])


def _test_case(case: CiVerdict) -> str:
    title = case.title or "passes"
    attributes = f"classname={_quoted(case.name)} name={_quoted(title)}"
    if case.file:
        attributes += f" file={_quoted(case.file)}"
    if case.line:
        attributes += f' line="{case.line}"'
    if not case.level:
        return f"<testcase {attributes}/>"

    from xml.sax.saxutils import escape  # which loads http.client

    place = case.file + (f":{case.line}" if case.line else "")
    lines = [f"{place}: {case.text}" if place else case.text]
    content = escape("\n".join(_valid(line) for line in "\n".join(lines).split("\n")))
    if case.level not in FAILURES:
        return f"<testcase {attributes}><system-out>{content}</system-out></testcase>"
    message = _quoted(case.text.partition("\n")[0])
    return (
        f"<testcase {attributes}><failure type={_quoted(case.level)} message={message}>{content}</failure></testcase>"
    )


def _quoted(value: str) -> str:
    from xml.sax.saxutils import quoteattr

    return quoteattr(_valid(value))


def _valid(value: str) -> str:
    """Returns a line without the characters that XML excludes."""
    return clean(value).replace("\ufffe", "?").replace("\uffff", "?")


def markdown(cases: Iterable[CiVerdict]) -> str:
    """Formats the numbers of cases, and a Markdown table of those that did not pass, worst first."""
    cases = [*cases]
    shown = (case for case in cases if case.level and not case.repeats)
    failed = sorted(shown, key=lambda case: [*SYMBOLS].index(case.level))
    counts = Counter(case.level for case in failed)
    found = ", ".join(f"{SYMBOLS[level]} {counted(counts[level], level)}" for level in SYMBOLS if counts[level])
    checked = counted(len({case.name for case in cases}), "item")
    lines = [f"**{found or '✅ everything passes'}** in {checked}"]
    if failed:
        lines += ["", "| | place | finding |", "|---|---|---|", *map(_row, failed[:MOST])]
    if len(failed) > MOST:
        lines += ["", f"… and {len(failed) - MOST} more"]
    return "\n".join(lines)


def _row(case: CiVerdict) -> str:
    place = case.file + (f":{case.line}" if case.line else "") if case.file else case.name
    message, _, remedy = case.text.partition("\n")
    parts = [f"**{escaped(case.title)}**", escaped(message)]
    if remedy:
        parts.append(f"<sub>{escaped(remedy)}</sub>")
    return f"| {SYMBOLS[case.level]} | {escaped(place)} | {'<br>'.join(parts)} |"


def markdown_table(columns: Sequence[ReportColumn]) -> str:
    """Formats a table."""
    rule = ["--:" if column.right else ":--" for column in columns]
    rows = [[column.heading for column in columns], rule, *zip(*(column.cells for column in columns), strict=True)]
    cells = ([cell if row is rule else escaped(cell) for cell in row] for row in rows)
    return "\n".join(f"| {' | '.join(row)} |" for row in cells)


def markdown_report(
    title: str, last_line: str, lines: Iterable[tuple[str, str]], tables: Iterable[Sequence[ReportColumn]]
) -> str:
    """Formats a report: its title, its last line, lines with their labels, and tables; empty ones are left out."""
    labelled = "\n".join(f"- **{escaped(label)}** {escaped(text)}" for label, text in lines)
    parts = [f"### {escaped(title)}", escaped(last_line), labelled, *map(markdown_table, filter(None, tables))]
    return "\n\n".join(filter(None, parts))


def escaped(value: str) -> str:
    """Escapes Markdown and mentions of users in names from models."""
    return "<br>".join(SPECIAL.sub(r"\\\1", clean(line)) for line in value.split("\n"))


FORMATS: dict[str, Callable[[Iterable[CiVerdict]], str]] = {"github": github, "junit": junit, "markdown": markdown}
