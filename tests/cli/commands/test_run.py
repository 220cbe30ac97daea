"""`mjrun run` and what the other commands say to documents and recordings, from outside."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from mjrun.cli.commands.image import image
from mjrun.cli.commands.trace import trace
from mjrun.cli.commands.video import video
from mjrun.document.json_schema import json_schema

if TYPE_CHECKING:
    import click

    from tests.conftest import Command

STUDY = """
model: swing.xml
duration: 0.1
qvel: {hinge: 3}
traces:
  - {output: run.csv, probe: [qpos, energy], assert: ["max(time) < 1"]}
plots:
  - {output: deep/down/energy.png, probe: [energy], size: 320x240}
recordings: [run.npz]
"""


@pytest.fixture
def study(swing: Path) -> Path:
    """A run document that draws nothing in OpenGL."""
    path = swing.with_name("study.yaml")
    path.write_text(STUDY)
    return path


def paths_told(stdout: bytes) -> list[str]:
    """What each line is about, but for the indented ones about its assertions."""
    return [line.partition(":")[0] for line in stdout.decode().splitlines() if not line.startswith(" ")]


@pytest.mark.parametrize("model", ["scene:dominos", "swing.xml"])
def test_a_model_in_the_place_of_a_document_is_named_with_what_to_do(
    study: Path, mjrun_here: Command, model: str
) -> None:
    done = mjrun_here("run", model)
    assert done.returncode == 2
    assert f"{model} is a model, not a document\n  `mjrun video {model}` makes a video of it".encode() in done.stderr


def test_a_run_makes_everything_and_says_a_line_of_each(mjrun_here: Command, study: Path) -> None:
    done = mjrun_here("run", study, "-o", "out")
    assert (done.returncode, done.stderr) == (0, b"")
    made = sorted(str(path.relative_to(mjrun_here.folder)) for path in mjrun_here.folder.rglob("*") if path.is_file())
    assert made == ["out/deep/down/energy.png", "out/run.csv", "out/run.npz"]
    assert paths_told(done.stdout) == [
        "out/run.csv",
        "out/deep/down/energy.png",
        "out/run.npz",
    ]


def test_a_page_is_made_where_the_document_says_unless_the_command_line_says_where(
    mjrun_here: Command, study: Path
) -> None:
    study.write_text(STUDY + "html: pages/study.html\n")
    assert mjrun_here("run", study, "-o", "out", "-q").returncode == 0
    assert "max(time) &lt; 1" in (mjrun_here.folder / "out/pages/study.html").read_text()
    assert mjrun_here("run", study, "-o", "more", "-q", "--html", "mine.html").returncode == 0
    pages = sorted(str(path.relative_to(mjrun_here.folder)) for path in mjrun_here.folder.rglob("*.html"))
    assert pages == ["mine.html", "out/pages/study.html"]
    study.write_text(STUDY + "exports: [replay.html]\n")
    clash = mjrun_here("run", study, "-o", "more", "--html", "more/replay.html")
    assert clash.returncode == 2
    assert b"more/replay.html clashes with --html; each output needs a separate file" in clash.stderr


def test_json_holds_every_result(mjrun_here: Command, study: Path) -> None:
    results = json.loads(mjrun_here("run", study, "--json").stdout)["results"]
    assert [(found["kind"], found["path"]) for found in results] == [
        ("Trace", "run.csv"),
        ("Plot", "deep/down/energy.png"),
        ("Recording", "run.npz"),
    ]
    assert results[0]["rows"] == results[2]["states"] == 51


def test_a_dry_run_counts_and_makes_nothing(mjrun_here: Command, study: Path) -> None:
    done = mjrun_here("run", study, "duration=0.2", "--dry-run")
    assert done.stdout.decode().splitlines() == [
        "simulation: 0.2 s in 100 steps of 0.002 s",
        "trace: run.csv: 101 rows; csv, 13 columns",
        "plot: deep/down/energy.png: 101 samples, 320x240; png, energy [J]",
        "recording: run.npz: 101 states; 48 numbers each",
    ]
    assert list(mjrun_here.folder.iterdir()) == []
    assert json.loads(mjrun_here("run", study, "--dry-run", "--json").stdout)["steps"] == 50


def test_mistakes_are_reported_at_once_with_their_places(mjrun_here: Command, study: Path) -> None:
    study.write_text(STUDY.replace("qvel", "qvle").replace("duration: 0.1", "duration: no"))
    done = mjrun_here("run", study)
    first, second, *_ = done.stderr.decode().splitlines()
    assert done.returncode == 2
    assert first == f"mjrun: error: {study}:3:11: duration: expected a positive number, got 'no'"
    assert second.startswith(f"  {study}:4:1: unknown key 'qvle' (did you mean 'qvel'?); keys: model, ")


def test_an_assertion_of_a_document_is_exit_code_1(mjrun_here: Command, study: Path) -> None:
    done = mjrun_here("run", study, "traces[0].assert=[time < 0.05]")
    assert (done.returncode, done.stderr.decode().partition(":")[0]) == (1, "mjrun")
    assert (mjrun_here.folder / "run.csv").exists()


def test_a_workflow_gets_an_annotation_for_each_assertion_that_fails(mjrun_here: Command, study: Path) -> None:
    done = mjrun_here("run", study, "--github", "traces[0].assert=[time < 0.05, time < 1]")
    (line,) = done.stdout.decode().splitlines()
    assert done.returncode == 1
    assert line.startswith("::error title=mjrun run%3A run.csv::time < 0.05")
    assert mjrun_here("run", study, "--github").stdout == b""


def test_what_was_made_has_its_lines_when_another_output_fails(mjrun_here: Command, study: Path) -> None:
    study.write_text(f"{STUDY}images: [{{output: never.png, time: {{when: time > 9}}, size: 32x24}}]\n")
    done = mjrun_here("run", study)
    made = ["run.csv", "deep/down/energy.png", "run.npz"]
    assert done.returncode == 8
    assert paths_told(done.stdout) == made
    assert "never.png could not be made: " in done.stderr.decode()
    assert all((mjrun_here.folder / path).exists() for path in made)
    assert mjrun_here("run", study, "-q").stdout == b""


def test_a_controller_comes_from_the_command_line_only(mjrun_here: Command, study: Path) -> None:
    study.with_name("kick.py").write_text("def kick(model, data):\n    data.qfrc_applied[0] = 5\n")
    assert mjrun_here("run", study, "controller=kick.py:kick").returncode == 2
    assert mjrun_here("run", study, "-o", "a", "-q").returncode == 0
    assert (
        mjrun_here("run", study, "-o", "b", "-q", "--controller", f"{study.with_name('kick.py')}:kick").returncode == 0
    )
    assert (mjrun_here.folder / "a/run.csv").read_bytes() != (mjrun_here.folder / "b/run.csv").read_bytes()


def test_a_command_prints_itself_as_a_document_that_does_the_same(mjrun_here: Command, swing: Path) -> None:
    options = ["--qvel", "hinge=3", "--steps", "20", "--every", "2", "--probe", "energy", "-o", "a.csv"]
    printed = mjrun_here("trace", swing, *options, "--print-document")
    assert (printed.returncode, printed.stderr) == (0, b"")
    assert list(mjrun_here.folder.iterdir()) == []
    (mjrun_here.folder / "a.yaml").write_bytes(printed.stdout)
    assert mjrun_here("trace", swing, *options, "-q").returncode == 0
    assert mjrun_here("run", "a.yaml", "-o", "again", "-q").returncode == 0
    assert (mjrun_here.folder / "again/a.csv").read_bytes() == (mjrun_here.folder / "a.csv").read_bytes()


def test_a_recording_of_one_command_is_replayed_by_another(mjrun_here: Command, swing: Path) -> None:
    kept = mjrun_here("trace", swing, "--qvel", "hinge=3", "--steps", "20", "--recording", "r.npz", "-o", "a.csv", "-q")
    assert (kept.returncode, kept.stderr) == (0, b"")
    assert np.load(mjrun_here.folder / "r.npz")["states"].shape == (21, 48)
    again = mjrun_here("trace", swing, "--replay", "r.npz")
    assert again.stdout == (mjrun_here.folder / "a.csv").read_bytes()
    late = mjrun_here("trace", swing, "--replay", "r.npz", "--steps", "21")
    assert (late.returncode, b"the recording ends at step 20" in late.stderr) == (2, True)
    assert mjrun_here("trace", swing, "--replay", "none.npz").returncode == 7


def test_a_camera_document_is_a_camera(mjrun_here: Command, swing: Path) -> None:
    path = mjrun_here.folder / "camera.yaml"
    path.write_text("shots: [{orbit: {lookat: nobody}}]")
    done = mjrun_here("video", swing, "--camera", path)
    assert (done.returncode, done.stderr.splitlines()[0]) == (2, b"mjrun: error: no object 'nobody'")
    path.write_text("shots: [{orbit: {lokat: box}}]")
    done = mjrun_here("video", swing, "--camera", path)
    assert done.returncode == 2
    assert done.stderr.decode().startswith(f"mjrun: error: {path}:1:18: shots[0].orbit: unknown key 'lokat'")


# Options that documents do not have: of the terminal, of the machine that draws, and code, which no document may name.
TERMINAL = {"json", "quiet", "verbose", "debug", "print_document", "recording", "save_key", "if_changed", "depfile"}
TERMINAL |= {"open", "list", "all", "csv", "verify", "update"}
MACHINE = {"gl", "require_gpu"}
CONFINEMENT = {"untrusted", "root", "limit"}  # which no document may loosen
CODE = {"controller", "control_dt", "trust"}
LISTS = {"videos", "images", "traces", "plots", "recordings", "keyframes", "exports"}
PAGE = {"html", "embed_up_to"}  # about all outputs of a document


@pytest.mark.parametrize(
    ("command", "definition", "others"),
    [(video, "VideoOptions", set()), (image, "ImageOptions", {"duration", "steps"}), (trace, "TraceOptions", set())],
)
def test_every_option_of_a_command_is_a_key_of_documents_and_the_other_way_round(
    command: click.Command, definition: str, others: set[str]
) -> None:
    schema = json_schema("run")
    output = next(keys for name, keys in schema["$defs"].items() if name in (definition, definition[: -len("Options")]))
    keys = {*output["properties"], *schema["properties"]} - LISTS - PAGE - {"model", "vars", "defaults"}
    names = {param.name for param in command.params if param.param_type_name == "option"}
    assert names - keys == (TERMINAL | MACHINE | CONFINEMENT | CODE) & names
    assert keys - names == others


def test_folders_that_stay_empty_are_taken_back(mjrun_here: Command, study: Path) -> None:
    study.write_text(STUDY.replace("probe: [energy]", "probe: [enrgy]"))
    done = mjrun_here("run", study, "-o", "out/a/b")
    assert done.returncode == 2
    assert [*mjrun_here.folder.iterdir()] == []
    (mjrun_here.folder / "out").mkdir()
    done = mjrun_here("run", study, "-o", "out/a/b")
    assert [*mjrun_here.folder.rglob("*")] == [mjrun_here.folder / "out"]


def test_with_json_a_failure_is_reported_beside_what_was_made(mjrun_here: Command, study: Path) -> None:
    study.write_text(STUDY.replace("max(time) < 1", "max(time) < 0"))
    done = mjrun_here("run", study, "--json")
    told = json.loads(done.stdout)
    assert done.returncode == told["error"]["exit_code"] == 1
    assert told["error"]["messages"] == ["max(time) < 0: it is 0.1, at row 50, time 0.1 s"]
    assert [result["kind"] for result in told["results"]] == ["Trace", "Plot", "Recording"]
    done = mjrun_here(
        "trace", study.with_name("swing.xml"), "--duration", ".1", "-o", "a.csv", "--assert", "max(time) < 0", "--json"
    )
    told = json.loads(done.stdout)
    assert (done.returncode, told["path"], told["error"]["kind"]) == (1, "a.csv", "FailedAssertionError")
    assert [verdict["passed"] for verdict in told["assertions"]] == [False]
    done = mjrun_here("trace", study.with_name("swing.xml"), "-o", "/dev/null/a.csv", "--json")
    assert (done.returncode, [*json.loads(done.stdout)]) == (7, ["error"])


LOG = "t,swing [deg]\n0,0\n0.02,9\n0.04,\n0.06,-9\n"
HINGE = "qpos/hinge='swing [deg]'*pi/180"


def test_a_log_is_replayed_by_a_map_from_every_front_end_to_the_same_numbers(mjrun_here: Command, swing: Path) -> None:
    (mjrun_here.folder / "log.csv").write_text(LOG)
    (mjrun_here.folder / "names.map").write_text(f"time=t\n{HINGE}\n")
    (mjrun_here.folder / "study.yaml").write_text(
        f"model: {swing}\nreplay: log.csv\nmap: {{time: t, qpos/hinge: \"'swing [deg]'*pi/180\"}}\n"
        "traces: [{output: c.csv, probe: [qpos, qvel]}]\n"
    )
    replay = ("trace", swing, "--replay", "log.csv", "--probe", "qpos,qvel")
    by_line = mjrun_here(*replay, "--map", "time=t", "--map", HINGE, "-o", "a.csv")
    by_file = mjrun_here(*replay, "--map", "@names.map", "-o", "b.csv")
    by_document = mjrun_here("run", "study.yaml", "-o", ".")
    for done in (by_line, by_file, by_document):
        assert done.returncode == 0, done.stderr
        assert b"a gap in qpos/hinge of 0.04 s from 0.02 s on; interpolated" in done.stderr
    tables = {(mjrun_here.folder / f"{name}.csv").read_bytes() for name in "abc"}
    assert len(tables) == 1
    printed = mjrun_here(*replay, "--map", "time=t", "--map", HINGE, "-o", "d.csv", "--print-document").stdout
    (mjrun_here.folder / "printed.yaml").write_bytes(printed)
    assert mjrun_here("run", "printed.yaml", "-o", ".").returncode == 0
    assert {(mjrun_here.folder / "d.csv").read_bytes()} == tables


@pytest.mark.parametrize(
    ("options", "code", "message"),
    [
        ((), 2, b"log.csv has no positions of this model\n  it has t, swing [deg]\n"),
        (("--map", "qpos/hinge=swin"), 2, b"no column 'swin'"),
        (("--map", "qpos/hing=t"), 2, b"no column 'qpos/hing' in --map of this model (did you mean 'qpos/hinge' "),
        (
            ("--map", HINGE),
            2,
            b"log.csv has no column 'time'\n  --map specifies the time, as in time=t,",
        ),
        (("--map", "time=t", "--map", HINGE, "--steps", "31"), 2, b"the table ends at step 30, time 0.06 s"),
        (("--map", "time=1-t", "--map", HINGE), 2, b"log.csv, row 1: time 0.98 follows 1; times must ascend"),
        (("--map", "@none.map"), 7, b"none.map: no such file"),
        (("--ctrl-noise", "1"), 2, b"--replay and --ctrl-noise exclude each other"),
        (("--replay-mode", "controls", "--map", "time=t", "--map", HINGE), 2, b"log.csv has no controls to replay"),
    ],
)
def test_a_table_that_cannot_be_replayed_is_reported_and_nothing_is_written(
    mjrun_here: Command, swing: Path, options: tuple[str, ...], code: int, message: bytes
) -> None:
    (mjrun_here.folder / "log.csv").write_text(LOG)
    before = sorted(mjrun_here.folder.iterdir())
    done = mjrun_here("trace", swing, "--replay", "log.csv", *options, "-o", "out.csv")
    assert (done.returncode, done.stdout) == (code, b"")
    assert message in done.stderr, done.stderr
    assert sorted(mjrun_here.folder.iterdir()) == before
