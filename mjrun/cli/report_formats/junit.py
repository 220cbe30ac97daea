"""JUnit XML, which most CI systems display: a test case for each verdict; errors and warnings are failures."""

from collections.abc import Iterable
from xml.sax.saxutils import escape, quoteattr

from mjrun.cli.console import Case
from mjrun.errors import clean

FAILURES = ("error", "warning")


def text(cases: Iterable[Case]) -> str:
    """Formats a test case for each case; a note is the output of a test that passes."""
    cases = [*cases]
    failures = sum(case.level in FAILURES for case in cases)
    numbers = f'tests="{len(cases)}" failures="{failures}" errors="0"'
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', f'<testsuites name="mjrun" {numbers}>']
    lines += [f'<testsuite name="mjrun" {numbers} skipped="0">', *map(_test_case, cases), "</testsuite>"]
    return "\n".join([*lines, "</testsuites>"])


def _test_case(case: Case) -> str:
    title = case.title or "passes"
    attributes = f"classname={_quoted(case.name)} name={_quoted(title)}"
    if case.file:
        attributes += f" file={_quoted(case.file)}"
    if case.line:
        attributes += f' line="{case.line}"'
    if not case.level:
        return f"<testcase {attributes}/>"

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
    return quoteattr(_valid(value))


def _valid(value: str) -> str:
    """Returns a line without the characters that XML excludes."""
    return clean(value).replace("\ufffe", "?").replace("\uffff", "?")
