"""`mjrun diff --golden`, `mjrun trace --golden` and `golden:` in run documents."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import Command
from tests.diff.models import xml

Run = Callable[..., "subprocess.CompletedProcess[str]"]
GRAM = "8.908"  # [kg] instead of 8.907
MODEL = ["rig.xml", "--steps", "40"]


@pytest.fixture
def model(tmp_path: Path) -> Path:
    (tmp_path / "rig.xml").write_text(xml())
    return tmp_path / "rig.xml"


@pytest.fixture
def run(model: Path, mjrun_here: Command, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs a command line in the folder of the model; its output is text."""
    monkeypatch.chdir(model.parent)

    def runs(*arguments: str) -> subprocess.CompletedProcess[str]:
        done = mjrun_here(*arguments)
        return subprocess.CompletedProcess(done.args, done.returncode, done.stdout.decode(), done.stderr.decode())

    return runs


def test_a_regression_test_in_one_line(model: Path, run: Run) -> None:
    missing = run("diff", "--golden", "g.csv", *MODEL)
    assert (missing.returncode, missing.stdout) == (7, "")
    assert "--update creates it from this simulation" in missing.stderr
    made = run("diff", *MODEL, "--golden=g.csv", "--update")
    assert (made.returncode, made.stdout) == (0, "g.csv: made\n")

    same = run("diff", "--golden", "g.csv", *MODEL)
    assert (same.returncode, same.stderr) == (0, "")
    assert same.stdout.startswith("g.csv and rig.xml agree: 41 rows, ")
    assert "bit for bit; both were made by mjrun " in same.stdout

    model.write_text(xml().replace("8.907", GRAM))
    other = run("diff", "--golden", "g.csv", *MODEL)
    assert (other.returncode, other.stderr) == (1, "")
    assert "g.csv and rig.xml differ; both were made by mjrun" in other.stdout
    assert "columns that differ" in other.stdout

    report = json.loads(run("diff", "--golden", "g.csv", *MODEL, "--json").stdout)
    assert (report["kind"], report["equal"], report["golden"]["updated"]) == ("golden", False, False)

    updated = run("diff", "--golden", "g.csv", *MODEL, "--update")
    assert updated.returncode == 0
    assert updated.stdout.startswith("g.csv: updated; both were made by mjrun")
    assert "differs in" in updated.stdout
    assert sorted(path.name for path in model.parent.iterdir()) == ["g.csv", "g.csv.json", "rig.xml", "work"]


def test_help_is_that_of_a_trace(run: Run) -> None:
    for arguments in (["--golden", "--help"], ["--golden", "g.csv", "-h"]):
        shown = run("diff", *arguments)
        assert shown.returncode == 0
        assert "--probe" in shown.stdout
        assert "--output" not in shown.stdout
    assert "mjrun diff --golden --help" in run("diff", "--help").stdout


def test_a_trace_is_written_and_compared(model: Path, run: Run) -> None:
    assert run("trace", *MODEL, "-o", "a.csv", "--golden", "g.npz", "--update").returncode == 0
    same = run("trace", *MODEL, "-o", "a.csv", "--golden", "g.npz")
    assert same.returncode == 0
    assert same.stdout.splitlines()[1].startswith("g.npz: agrees; both were made by mjrun")
    model.write_text(xml().replace("8.907", GRAM))
    piped = run("trace", *MODEL, "--golden", "g.npz")
    assert piped.returncode == 1
    assert piped.stdout.count("\n") == 42
    assert "rig.xml differs from the golden table g.npz" in piped.stderr
    assert "--update replaces the golden table by this result" in piped.stderr


def test_documents_have_golden_tables(model: Path, run: Run) -> None:
    document = Path("study/run.yaml")
    document.parent.mkdir()
    text = "model: ../rig.xml\nsteps: 40\ntraces:\n  - {output: a.csv, golden: g.csv, tol: {'qvel/*': 1e-9}}\n"
    document.write_text(text)
    made = run("run", str(document), "-o", "out", "--update")
    assert made.returncode == 0
    assert "study/g.csv: made" in made.stdout
    model.write_text(xml().replace("8.907", GRAM))
    assert run("run", str(document), "-o", "out").returncode == 1


def test_a_document_updates_nothing_outside_its_folder(run: Run) -> None:
    document = Path("study/run.yaml")
    document.parent.mkdir()
    document.write_text("model: ../rig.xml\nsteps: 40\ntraces:\n  - {output: a.csv, golden: ../g.csv}\n")
    refused = run("run", str(document), "-o", "out", "--update")
    assert refused.returncode == 2
    assert "run.yaml:4:29: traces[0].golden: study/../g.csv leads out of the folder of the document" in refused.stderr
    assert not Path("g.csv").exists()
