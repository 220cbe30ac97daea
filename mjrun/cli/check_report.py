"""The report of a check: findings as text, JSON, SARIF, tables, cases for CI systems, and numbers by rule."""

import json
import os
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from urllib.parse import quote

from mjrun.check.check import CheckResult, ModelCheckResult, worst_first
from mjrun.check.finding import SEVERITIES, Finding, short_path, without_repeats
from mjrun.check.rule import Rule
from mjrun.check.rule_catalogue import explanation, local_page, published_page, topic
from mjrun.cli.console import CommandReport, linked, shows_links
from mjrun.cli.report_formats import CiVerdict
from mjrun.cli.simulation_command import import_mujoco
from mjrun.cli.terminal_layout import folded_words, terminal_width
from mjrun.errors import clean, counted
from mjrun.version import __version__

SARIF = "https://json.schemastore.org/sarif-2.1.0.json"
HOME = "https://pypi.org/project/mjrun/"
# Text columns of the table of findings, and the finding in the row of a model without findings.
TEXTS: dict[str, Callable[[Finding], str]] = {
    "code": lambda finding: finding.code,
    "severity": lambda finding: finding.severity,
    "file": lambda finding: finding.file,
    "object": lambda finding: finding.object,
    "message": lambda finding: finding.text,
    "remedy": lambda finding: finding.remedy,
}
MESSAGE, REMEDY = "  ", "    "  # before folded lines of messages, and before lines of remedies
NO_FINDING = Finding("", "", "", "")


def check_report(result: CheckResult) -> CommandReport:
    """Returns the report of a check."""
    return CommandReport(
        "check",
        result,
        text=lambda: "\n".join(lines(result, linked_code if shows_links(sys.stdout) else str)),
        summary=lambda: "\n".join(folded_words(summary(result), terminal_width(), "", MESSAGE)),
        forms={
            "sarif": lambda: sarif(result),
            "statistics": lambda: "\n".join(statistics(result)),
            "diff": lambda: "".join(fixed.diff for fixed in result.fixed).rstrip("\n"),
            "scan": lambda: "\n".join(scan_lines(result)),
            "json_lines": str,
        },
        cases=lambda: cases(result),
    )


def linked_code(code: str) -> str:
    """Returns the code of a rule as a hyperlink to its page; without one, to its file, unless that is not at hand."""
    address = published_page(code) or ("" if os.environ.get("SSH_CONNECTION") else local_page(code))
    return linked(code, address) if address else code


def lines(result: CheckResult, shown_code: Callable[[str], str] = str) -> Iterator[str]:
    """Yields a line per finding in the style of compilers, with its remedy below it, in the order of the models.

    Both are folded to the width of the terminal.
    """
    width = terminal_width()
    for finding, model in _shown(result):
        place = clean(finding.file) + (f":{finding.line}" if finding.line else "")
        text = f"{place}: {finding.severity} {finding.code}: {clean(full_message(finding, model))}"
        shown = f"{shown_code(finding.code)}:"
        yield from (line.replace(f"{finding.code}:", shown) for line in folded_words(text, width, "", MESSAGE))
        for line in finding.remedy.splitlines():
            yield from folded_words(clean(line), width, REMEDY, REMEDY)
    created, fixed, changed = "created", "fixed", "changed with it"
    if not result.written:
        created, fixed, changed = "would be created", "would fix", "would be changed with it"
    for file in result.fixed:
        counts = ", ".join(f"{count} {code}" for code, count in file.fixes.items())
        effect = f"{fixed} {counts}" if counts else created if file.is_new else changed
        yield f"{clean(file.file)}: {effect}"


def summary(result: CheckResult) -> str:
    """Formats the numbers of models and findings in one line."""
    counts = [_counted(result.count(severity), severity) for severity in reversed(SEVERITIES)]
    findings = ", ".join(count for count in counts if count) or "nothing found"
    unloaded = sum(not model.loads for model in result.models)
    parts = [f"{_counted(len(result.models), 'model') or 'no model'}: {findings}"]
    if repeated := sum(1 for _ in _all(result.models)) - sum(1 for _ in _shown(result)):
        parts.append(f"{repeated} of them in files of several models, shown once")
    if fixed := sum(sum(file.fixes.values()) for file in result.fixed):
        files = _counted(sum(not file.is_new for file in result.fixed), "file")
        parts.append(f"{fixed} {'fixed' if result.written else 'would be fixed'} in {files}")
    if created := sum(file.is_new for file in result.fixed):
        parts.append(f"{_counted(created, 'file')} {'created' if result.written else 'would be created'}")
    if fixable := sum(len(finding.fixes) for finding, _ in _all(result.models)):
        parts.append(f"{fixable} can be fixed with --fix")
    if unloaded:
        parts.append(f"{unloaded} {'does' if unloaded == 1 else 'do'} not load")
    if suppressed := sum(model.suppressed for model in result.models):
        parts.append(f"{suppressed} ignored by comments")
    if known := sum(model.known for model in result.models):
        parts.append(f"{known} known")
    if result.gone:
        parts.append(f"{result.gone} of the baseline no longer found")
    if result.unchanged:
        parts.append(f"{result.unchanged} unchanged")
    if result.skipped:
        are = "is not a model" if result.skipped == 1 else "are not models"
        parts.append(f"{_counted(result.skipped, 'file')} skipped that {are}")
    return "; ".join(parts)


def full_message(finding: Finding, model: str) -> str:
    """Returns the message with the object it concerns, and with the model if the file is another one."""
    where = "" if finding.file in (model, short_path(Path(model))) else f" (in {model})"
    if not finding.object or finding.object.startswith("<") or finding.object in finding.message:  # names elements
        return finding.text + where
    return f"{finding.object}: {finding.text}{where}"


def cases(result: CheckResult) -> Iterator[CiVerdict]:
    """Yields a case per finding, and one per model without findings; a finding in a file of several is shown once."""
    rules = rule_table()
    for model, shown in zip(result.models, without_repeats(result.models), strict=True):
        if not model.findings:
            yield CiVerdict(model.model, file=model.model)
        for finding in model.findings:
            text = "\n".join(filter(None, (full_message(finding, model.model), finding.remedy)))
            title = f"{finding.code} {rules[finding.code].title}"
            repeats = finding not in shown.findings
            yield CiVerdict(model.model, finding.severity, title, text, finding.file, finding.line, repeats)


def statistics(result: CheckResult) -> Iterator[str]:
    """Yields a line per rule and severity with the number of its findings, most frequent first."""
    rules = rule_table()
    counts = Counter((finding.code, finding.severity) for finding, _ in _all(result.models))
    width = len(str(max(counts.values(), default=0)))
    for (code, severity), count in sorted(counts.items(), key=lambda item: (-item[1], item[0])):
        yield f"{count:{width}}  {code}  {severity:7}  {rules[code].title}"


def scan_lines(result: CheckResult) -> Iterator[str]:
    """Yields a line per model with findings, worst first: its numbers of errors, warnings and notes, and its codes."""
    for model in worst_first(result.models):
        if model.findings:
            numbers = " ".join(f"{model.count(severity):4}" for severity in reversed(SEVERITIES))
            codes = " ".join(sorted({finding.code for finding in model.findings}))
            yield f"{numbers}  {clean(model.model)}  {codes}" + ("" if model.loads else "  (does not load)")


def model_line(result: ModelCheckResult) -> str:
    """Formats the result for one model as a line of JSON."""
    return json.dumps(asdict(result))


def sarif(result: CheckResult) -> dict[str, object]:
    """Returns a SARIF 2.1.0 document: https://docs.oasis-open.org/sarif/sarif/v2.1.0/sarif-v2.1.0.html."""
    rules = rule_table()
    codes = list(rules)
    driver = {
        "name": "mjrun",
        "version": __version__,
        "informationUri": HOME,
        "rules": [_rule(rule) for rule in rules.values()],
    }
    run = {
        "tool": {"driver": driver},
        "invocations": [{"executionSuccessful": True, "exitCode": result.code}],
        "results": [_result(finding, model, codes.index(finding.code)) for finding, model in _shown(result)],
    }
    return {"$schema": SARIF, "version": "2.1.0", "runs": [run]}


def rule_table() -> Mapping[str, Rule]:
    """Returns the rules by code; their modules import MuJoCo."""
    import_mujoco()
    from mjrun.check.rule_runner import RULES

    return RULES


def _rule(rule: Rule) -> dict[str, object]:
    text, page = explanation(rule.code), published_page(rule.code)
    name = "".join(word.capitalize() for word in re.findall(r"\w+", rule.title))
    return {
        "id": rule.code,
        "name": name,
        "shortDescription": {"text": rule.title},
        "fullDescription": {"text": text.partition("\n\n")[0].replace("`", "")},
        "help": {"text": text, "markdown": text},
        **({"helpUri": page} if page else {}),
        "properties": {"tags": [topic(rule.code)]},
        "defaultConfiguration": {"level": rule.severity},
    }


def _result(finding: Finding, model: str, index: int) -> dict[str, object]:
    text = "\n".join(clean(part) for part in (full_message(finding, model), finding.remedy) if part)
    region = {"startLine": finding.line or 1}  # which GitHub requires
    place = {"artifactLocation": {"uri": _uri(finding.file)}, "region": region}
    location: dict[str, object] = {"physicalLocation": place}
    if finding.object:
        location["logicalLocations"] = [{"fullyQualifiedName": clean(finding.object)}]
    return {
        "ruleId": finding.code,
        "ruleIndex": index,
        "level": finding.severity,
        "message": {"text": text},
        "locations": [location],
    }


def _shown(result: CheckResult) -> Iterator[tuple[Finding, str]]:
    """Yields the findings of all models, those in shared files once."""
    return _all(without_repeats(result.models))


def _all(models: Iterable[ModelCheckResult]) -> Iterator[tuple[Finding, str]]:
    """Yields all findings, each with its model."""
    return ((finding, model.model) for model in models for finding in model.findings)


def _counted(number: int, what: str) -> str:
    return counted(number, what) if number else ""


def _uri(path: str) -> str:
    """Converts a file name to a URI, relative unless the name is absolute."""
    place = Path(path)
    return place.as_uri() if place.is_absolute() else quote(os.fsencode(place.as_posix()))


def write_findings(path: str, result: CheckResult) -> None:
    """Writes a table with a row for each finding, and one for each model without any; the worst models come first.

    Raises:
      UnknownNameError: no table has this suffix.
      FileError: it cannot be written.
    """
    from mjrun.experiment.results_table import ResultsTable  # slow to import, as is what else writes a table
    from mjrun.model.table_column import Column

    table, models = ResultsTable(), worst_first(result.models)
    rows = [(rank, model, found) for rank, model in enumerate(models) for found in model.findings or (NO_FINDING,)]

    def add(name: str, meaning: str, numbers: list[int]) -> None:
        table.add(Column(name, meaning=meaning, integer=True), numbers)

    add("rank", "position of the model, 0 for the worst", [rank for rank, _, _ in rows])
    table.add_texts("model", [model.model for _, model, _ in rows])
    add("loads", "1 if the model loads", [int(model.loads) for _, model, _ in rows])
    for severity in reversed(SEVERITIES):
        numbers = [model.count(severity) for _, model, _ in rows]
        add(f"{severity}s", f"findings of this severity in the model: {severity}", numbers)
    add("line", "line in the file, 0 if unknown", [found.line or 0 for _, _, found in rows])
    for name, text in TEXTS.items():
        table.add_texts(name, [text(found) for _, _, found in rows])
    table.write(Path(path).parent, {}, [Path(path).name])
