"""`mjrun diff` as a command."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest

from mjrun.cli.commands.schema import schema_of
from tests.cases import cases
from tests.document.schema_oracle import fits
from tests.formats.table_files import columns, write

if TYPE_CHECKING:
    from tests.conftest import Command


@pytest.fixture
def diff(mjrun_here: Command, monkeypatch: pytest.MonkeyPatch) -> Command:
    """The command in a folder with two tables: b.parquet differs from a.csv in one bit, and ends a row earlier."""
    monkeypatch.setenv("COLUMNS", "200")  # of the terminal
    table = np.array([[0.0, 1, 2], [1, 2, 3], [2, 3, 4]])
    names = columns("time", "qpos/a", "qvel/a")
    write(mjrun_here.folder / "a.csv", [table], names)
    table[1, 2] = np.nextafter(3, 4)
    write(mjrun_here.folder / "b.parquet", [table[:2]], names)
    return mjrun_here


def test_the_exit_code_is_the_verdict(diff: Command) -> None:
    same = diff("diff", "a.csv", "a.csv")
    assert (same.returncode, same.stderr) == (0, b"")
    assert same.stdout == b"a.csv and a.csv agree: 3 rows, 2 columns, bit for bit\n"
    other = diff("diff", "a.csv", "b.parquet")
    assert (other.returncode, other.stderr) == (1, b"")
    assert other.stdout.startswith(b"a.csv and b.parquet differ\n")
    for part in (b"row 2, time 2.0 s", b"3.0000000000000004", b"qvel/a", b"and 1 more column agrees"):
        assert part in other.stdout
    assert diff("diff", "a.csv", "b.parquet", "-q").stdout == b""


def test_one_of_them_may_be_piped(diff: Command) -> None:
    command = [sys.executable, "-m", "mjrun", "diff", "-", "a.csv"]
    done = subprocess.run(command, cwd=diff.folder, input=(diff.folder / "a.csv").read_bytes(), capture_output=True)
    assert (done.returncode, done.stdout) == (0, b"- and a.csv agree: 3 rows, 2 columns, bit for bit\n")


def test_what_both_tables_have_can_be_all_that_is_compared(diff: Command) -> None:
    table = (diff.folder / "a.csv").read_text().splitlines(keepends=True)
    (diff.folder / "few.csv").write_text(table[0] + table[2])
    done = diff("diff", "a.csv", "few.csv")
    assert done.returncode == 1
    assert "differ: the 1 row and 2 columns that both have agree; --common compares only these" in done.stdout.decode()
    done = diff("diff", "a.csv", "few.csv", "--common")
    assert (done.returncode, done.stdout) == (
        0,
        b"a.csv and few.csv agree: 1 row, 2 columns that both have, bit for bit\n",
    )


def test_as_json_a_report_fits_its_schema(diff: Command) -> None:
    report = json.loads(diff("diff", "a.csv", "b.parquet", "--json").stdout)
    schema = schema_of("diff")
    assert fits(report, schema, schema)
    assert report["schema"] == "mjrun-diff-1"
    assert report["equal"] is False
    assert report["table"]["only_a"] == {"count": 1, "first": 2, "at": 2.0, "key": ""}
    assert report["table"]["columns"][0]["first"]["b"] == "3.0000000000000004"


def test_a_workflow_gets_annotations(diff: Command) -> None:
    done = diff("diff", "a.csv", "b.parquet", "--github")
    lines = done.stdout.decode().splitlines()
    assert len(lines) == 2
    assert all(line.startswith("::error file=") for line in lines)
    assert lines[1].endswith("qvel/a differs in row 1, time 1.0 s: 3.0, not 3.0000000000000004")
    assert done.stderr.decode().strip().endswith("differ")


@cases("arguments, code, message")
def test_what_cannot_be_compared_is_an_error(diff: Command, arguments: list[str], code: int, message: str) -> None:
    done = diff("diff", *arguments)
    assert (done.returncode, bool(done.stdout)) == (code, "--json" in arguments)
    assert message in done.stderr.decode()
