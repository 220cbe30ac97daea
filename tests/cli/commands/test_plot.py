"""`mjrun plot` as a user runs it."""

from __future__ import annotations

import io
import json
import subprocess
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from PIL import Image

from mjrun.cli.commands.schema import schema_of
from tests import prepared_interpreters
from tests.cases import cases
from tests.document.schema_oracle import fits

if TYPE_CHECKING:
    from tests.conftest import Command

ROOT = Path(__file__).parents[3]
PENDULUM = ROOT / "scenes/pendulum.xml"
TABLE = "time,qpos/a,qpos/b,energy/total\n" + "".join(f"{i / 10},{i},{-i},{i * i}\n" for i in range(20))


def test_a_trace_is_piped_into_a_plot_and_the_plot_into_a_pipe(tmp_path: Path) -> None:
    mjrun = prepared_interpreters.program()
    trace = f"{mjrun} trace '{PENDULUM}' --csv --duration 0.5"
    command = f"{trace} | {mjrun} plot - -o - --size 600x900 > {tmp_path}/a.png"
    done = subprocess.run(["bash", "-o", "pipefail", "-c", command], cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    with Image.open(tmp_path / "a.png") as image:
        assert image.size == (600, 900)


def test_a_plot_in_a_file_is_reported_in_a_sentence_and_is_the_same_bytes_in_another_process(
    mjrun: Command, mjrun_here: Command
) -> None:
    (mjrun.folder / "run.csv").write_text(TABLE)
    pictures = []
    for run in (mjrun, mjrun_here):
        done = run("plot", "run.csv", "-o", "run.svg", "--y", "qpos/*", "--y", "J [J]=energy/total")
        assert (done.returncode, done.stderr) == (0, b"")
        assert done.stdout == b"run.svg: 1280x720, 3 curves in 2 panels, 20 rows\n"
        pictures.append((mjrun.folder / "run.svg").read_bytes())
    assert pictures[0] == pictures[1]
    texts = [each.text for each in ElementTree.fromstring(pictures[0]).iter() if each.tag.endswith("text")]
    assert {"qpos", "J [J]", "a", "b", "time [s]"} <= set(texts)


def test_notes_are_on_stderr_and_the_report_fits_its_schema(mjrun_here: Command) -> None:
    (mjrun_here.folder / "a.csv").write_text("u,v\n1,-1\n2,2\n")
    done = mjrun_here("plot", "a.csv", "-o", "a.png", "--log", "y", "--size", "300x200", "--json")
    report = json.loads(done.stdout)
    assert fits(report, schema_of("plot"), schema_of("plot"))
    assert (report["path"], report["size"], report["rows"]) == ("a.png", [300, 200], [2])
    assert "x is the number of the row, counted from 0; see --x" in done.stderr.decode()
    assert len(report["notes"]) == 2


CURVES = ["--y", "energy/*", "--y", "angle [deg]=qpos/hinge*180/pi", "--mark-event", "down=qpos/hinge < 0"]


@pytest.mark.parametrize(
    ("measured", "curves"),
    [(["--probe", "energy,qpos", "--every", "3"], CURVES), ([], [])],
    ids=["probes of every third step", "usual probes"],
)
def test_a_plot_of_a_model_is_that_of_its_trace(mjrun_here: Command, measured: list[str], curves: list[str]) -> None:
    simulation = [str(PENDULUM), "--key", "level", "--duration", "1", *measured]
    assert mjrun_here("trace", *simulation, "-o", "run.parquet").returncode == 0
    figures: list[list[str]] = []
    for source in (["run.parquet"], simulation):
        done = mjrun_here("plot", *source, "-o", "run.svg", *curves)
        assert (done.returncode, done.stderr) == (0, b"")
        parts = ElementTree.parse(mjrun_here.folder / "run.svg").iter()
        figures.append([path for path in (each.get("d") for each in parts) if path])
    assert figures[0] == figures[1]
    assert len(figures[0]) > 5


def test_a_plot_of_a_model_has_a_document_and_the_report_of_a_table(mjrun_here: Command) -> None:
    simulated = [str(PENDULUM), "--steps", "5"]
    report = json.loads(mjrun_here("plot", *simulated, "--y", "energy/*", "--json").stdout)
    assert fits(report, schema_of("plot"), schema_of("plot"))
    assert (report["path"], report["tables"], report["rows"], report["curves"]) == (
        "pendulum.png",
        [str(PENDULUM)],
        [6],
        4,
    )
    document = mjrun_here("plot", *simulated, "--y", "energy/*", "--print-document").stdout.decode()
    (mjrun_here.folder / "run.yaml").write_text(document)
    first = (mjrun_here.folder / "pendulum.png").read_bytes()
    assert mjrun_here("run", "run.yaml").returncode == 0
    with Image.open(io.BytesIO(first)) as one, Image.open(mjrun_here.folder / "pendulum.png") as other:
        assert one.tobytes() == other.tobytes()


def test_limits_and_labels_are_those_of_the_axes_and_the_legend(mjrun_here: Command) -> None:
    for name, factor in (("one.csv", 1), ("other.csv", 2)):
        rows = [f"{i / 1000},{factor * i}\n" for i in range(5000)]
        (mjrun_here.folder / name).write_text(f"time,qpos/a\n{''.join(rows)}")
    limits = ["--xlim", "1..1.2", "--ylim", "900..2500", "--label", "small", "--label", "large"]
    assert mjrun_here("plot", "one.csv", "other.csv", "-o", "a.svg", *limits).returncode == 0
    parts = [*ElementTree.parse(mjrun_here.folder / "a.svg").iter()]
    texts = [each.text for each in parts if each.tag.endswith("text")]
    assert {"small", "large", "1.00", "1.20"} <= set(texts)
    curves = [path for each in parts if (path := each.get("d")) and path.count("L") > 100]
    assert [path.count("L") for path in curves] == [202, 202]  # each of 201 rows, and a neighbour on either side


def test_formats_of_a_pipe(mjrun_here: Command) -> None:
    (mjrun_here.folder / "run.csv").write_text(TABLE)
    svg = mjrun_here("plot", "run.csv", "-o", "-", "--format", "svg")
    assert ElementTree.fromstring(svg.stdout).tag.endswith("svg")
    png = mjrun_here("plot", str(PENDULUM), "-o", "-", "--size", "300x900")
    assert Image.open(io.BytesIO(png.stdout)).size == (300, 900)


@cases("arguments, code, message")
def test_bad_input_has_its_exit_code_and_leaves_nothing(
    mjrun_here: Command, arguments: list[str], code: int, message: str
) -> None:
    (mjrun_here.folder / "run.csv").write_text(TABLE)
    (mjrun_here.folder / "text.csv").write_text("time,who\n0,me\n")
    done = mjrun_here("plot", *arguments)
    assert (done.returncode, bool(done.stdout)) == (code, "--json" in arguments)
    assert message in done.stderr.decode()
    assert mjrun_here.files() == ["run.csv", "text.csv"]


def test_a_page_alone_is_made_of_standard_input_which_is_read_once(
    mjrun_here: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(TABLE.encode())))
    done = mjrun_here("plot", "-", "--html", "p.html")
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.startswith(b"p.html: ")
    assert "20 rows" in (mjrun_here.folder / "p.html").read_text()


def test_a_failed_assertion_is_reported_with_what_was_made(mjrun_here: Command) -> None:
    (mjrun_here.folder / "run.csv").write_text(TABLE)
    arguments = ["plot", "run.csv", "--html", "p.html", "--assert", "max(time) < 1", "--assert", "min(time) == 0"]
    done = mjrun_here(*arguments, "--json")
    report = json.loads(done.stdout)
    assert done.returncode == 1
    assert [verdict["passed"] for verdict in report["assertions"]] == [False, True]
    assert report["error"]["kind"] == "FailedAssertionError"
    plain = mjrun_here(*arguments)
    assert (plain.returncode, plain.stdout.partition(b":")[0]) == (1, b"p.html")
    assert b"assertion failed: max(time) < 1: it is 1.9" in plain.stderr


def test_without_an_output_or_a_page_the_options_are_named(mjrun_here: Command) -> None:
    (mjrun_here.folder / "run.csv").write_text(TABLE)
    done = mjrun_here("plot", "run.csv")
    assert (done.returncode, b"'--output' or '--html'" in done.stderr) == (2, True)
