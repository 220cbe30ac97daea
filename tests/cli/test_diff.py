"""`mjrun diff` as a command."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mjrun.document.json_schema import json_schema
from tests.document.schema_oracle import fits
from tests.formats.table_files import columns, write


def diff(*arguments: str | Path, stdin: bytes | None = None) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "mjrun", "diff", *map(str, arguments)]
    done = subprocess.run(command, input=stdin, capture_output=True)
    return subprocess.CompletedProcess(command, done.returncode, done.stdout.decode(), done.stderr.decode())


@pytest.fixture
def pair(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    monkeypatch.setenv("COLUMNS", "200")  # of the terminal
    table = np.array([[0.0, 1, 2], [1, 2, 3], [2, 3, 4]])
    names = columns("time", "qpos/a", "qvel/a")
    a = write(tmp_path / "a.csv", [table], names)
    table[1, 2] = np.nextafter(3, 4)
    return a, write(tmp_path / "b.parquet", [table[:2]], names)


def test_the_exit_code_is_the_verdict(pair: tuple[Path, Path]) -> None:
    a, b = pair
    same = diff(a, a)
    assert (same.returncode, same.stderr) == (0, "")
    assert same.stdout == f"{a} and {a} agree: 3 rows, 2 columns, bit for bit\n"
    other = diff(a, b)
    assert (other.returncode, other.stderr) == (1, "")
    assert other.stdout.startswith(f"{a} and {b} differ\n")
    for part in ("row 3, time 2.0 s", "3.0000000000000004", "qvel/a", "and 1 more column agrees"):
        assert part in other.stdout
    assert diff(a, b, "-q").stdout == ""


def test_one_of_them_may_be_piped(pair: tuple[Path, Path]) -> None:
    a, _ = pair
    assert diff("-", a, stdin=a.read_bytes()).returncode == 0


def test_as_json_a_report_fits_its_schema(pair: tuple[Path, Path]) -> None:
    report = json.loads(diff(*pair, "--json").stdout)
    schema = json_schema("diff")
    assert fits(report, schema, schema)
    assert report["schema"] == "mjrun-diff-1"
    assert report["equal"] is False
    assert report["table"]["only_a"] == {"count": 1, "first": 3, "at": 2.0}
    assert report["table"]["columns"][0]["first"]["b"] == "3.0000000000000004"


def test_a_workflow_gets_annotations(pair: tuple[Path, Path]) -> None:
    done = diff(*pair, "--github")
    lines = done.stdout.splitlines()
    assert len(lines) == 2
    assert all(line.startswith("::error file=") for line in lines)
    assert lines[1].endswith("qvel/a differs in row 2, time 1.0 s: 3.0, not 3.0000000000000004")
    assert done.stderr.strip().endswith("differ")


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["a.csv", "none.csv"], 7, "none.csv: no such file"),
        (["a.csv", "b.png"], 2, "only two of a kind can be compared"),
        (["a.csv", "b.parquet", "--json", "--github"], 2, "--json and --github exclude each other"),
        (["a.csv", "b.parquet", "--tol", "x"], 2, "'x' is not COLUMNS=ATOL"),
        (["a.csv", "b.parquet", "--columns", "q"], 2, "no column 'q'"),
        (["a.csv"], 2, "Missing argument 'B'"),
    ],
)
def test_what_cannot_be_compared_is_an_error(
    pair: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch, arguments: list[str], code: int, message: str
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
    monkeypatch.chdir(pair[0].parent)
    done = diff(*arguments)
    assert (done.returncode, done.stdout) == (code, "")
    assert message in done.stderr
