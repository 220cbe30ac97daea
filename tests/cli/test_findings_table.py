"""Theorems about the table of the findings of many models."""

import csv
from pathlib import Path

from mjrun.check.check import CheckResult
from mjrun.check.finding import Finding, ModelCheckResult
from mjrun.cli.check_report import write_findings
from mjrun.plotting.table_and_study_plot import TablePlot


def finding(severity: str, line: int | None = None) -> Finding:
    return Finding("MJ302", severity, "a, b", "part.xml", line, "joint 'j'", "mend it")


MODELS = (
    ModelCheckResult("fine.xml", True, ()),
    ModelCheckResult("noted.xml", True, tuple(finding("note", line) for line in range(3))),
    ModelCheckResult("warned.xml", True, (finding("warning"),)),
    ModelCheckResult("broken.xml", False, (finding("error", 7), finding("note"))),
)


def test_a_row_is_a_finding_and_the_worst_models_come_first(tmp_path: Path) -> None:
    write_findings(str(tmp_path / "a.csv"), CheckResult(MODELS, 0, 3))
    with (tmp_path / "a.csv").open(newline="") as file:
        rows = [*csv.DictReader(file)]
    assert [(row["rank"], row["model"], row["severity"], row["line"]) for row in rows] == [
        ("0", "broken.xml", "error", "7"),
        ("0", "broken.xml", "note", "0"),
        ("1", "warned.xml", "warning", "0"),
        *(("2", "noted.xml", "note", str(line)) for line in range(3)),
        ("3", "fine.xml", "", "0"),
    ]
    assert {name: rows[0][name] for name in ("loads", "errors", "warnings", "notes", "object", "message")} == {
        "loads": "0",
        "errors": "1",
        "warnings": "0",
        "notes": "1",
        "object": "joint 'j'",
        "message": "a, b",
    }


def test_plots_read_its_numbers_in_every_format(tmp_path: Path) -> None:
    for name in ("a.parquet", "a.csv"):
        write_findings(str(tmp_path / name), CheckResult(MODELS, 0, 3))
        plot = tmp_path / "a.svg"
        result = TablePlot(str(tmp_path / name), str(plot), x="rank", y=["errors"]).run()
        assert (result.rows, plot.stat().st_size > 0) == ([7], True)
