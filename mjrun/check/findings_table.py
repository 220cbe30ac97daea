"""The findings of many models as a table, for data frames and `mjrun plot`."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from mjrun.check.check import CheckResult, worst_first
from mjrun.check.rule import SEVERITIES, Finding
from mjrun.formats.table_writer import TableWriter
from mjrun.formats.tables import output_format
from mjrun.model.table_column import Column

TEXTS: dict[str, Callable[[Finding], str]] = {
    "code": lambda finding: finding.code,
    "severity": lambda finding: finding.severity,
    "file": lambda finding: finding.file,
    "object": lambda finding: finding.object,
    "message": lambda finding: finding.text,
    "remedy": lambda finding: finding.remedy,
}
NONE = Finding("", "", "", "")  # of a model without findings


def write_findings(path: str, result: CheckResult) -> None:
    """Writes a row for each finding, and one for each model without any; the worst models come first.

    Raises:
      UnknownNameError: no table has this suffix.
      FileError: it cannot be written.
    """
    models = worst_first(result.models)
    rows = [(rank, model, finding) for rank, model in enumerate(models) for finding in model.findings or (NONE,)]
    found = [finding for _, _, finding in rows]
    columns: list[Column] = []
    values: list[Sequence[float]] = []

    def add(name: str, meaning: str, numbers: Sequence[float]) -> None:
        columns.append(Column(name, meaning=meaning, integer=True))
        values.append(numbers)

    def add_texts(name: str, texts: Sequence[str]) -> None:
        labels = tuple(dict.fromkeys(filter(None, texts))) or ("",)
        place = {label: index for index, label in enumerate(labels)}
        columns.append(Column(name, labels=labels))
        values.append([place[text] if text else -1 for text in texts])

    add("rank", "position of the model, 0 for the worst", [rank for rank, _, _ in rows])
    add_texts("model", [model.model for _, model, _ in rows])
    add("loads", "1 if the model loads", [model.loads for _, model, _ in rows])
    for severity in reversed(SEVERITIES):
        numbers = [model.count(severity) for _, model, _ in rows]
        add(f"{severity}s", f"findings of this severity in the model: {severity}", numbers)
    add("line", "line in the file, 0 if unknown", [finding.line or 0 for finding in found])
    for name, text in TEXTS.items():
        add_texts(name, [text(finding) for finding in found])

    table = np.array(values, float).reshape(len(columns), len(rows)).T
    with TableWriter(str(Path(path)), output_format(path).name, columns) as writer:
        writer.write(table)
        writer.publish()
