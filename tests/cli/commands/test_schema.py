"""`mjrun schema` as a user runs it, and the reports that its schemas describe."""

from __future__ import annotations

import ast
import json
from dataclasses import fields
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING

import pytest

import mjrun
from mjrun.cli.commands.schema import kinds, schema_of
from mjrun.cli.main import COMMANDS, load_command
from mjrun.document.json_schema import DOCUMENTS
from mjrun.errors import listing
from mjrun.model.info import SECTIONS
from tests.demonstration_files import write_demonstrations
from tests.document.schema_oracle import fits, rules

if TYPE_CHECKING:
    from tests.conftest import Command


MODEL = """
<mujoco><option timestep=".005"/><worldbody><body>
<joint name="hinge" axis="0 1 0" damping=".1"/><geom type="capsule" size=".02" fromto="0 0 0 0 0 -.3"/>
</body></worldbody><actuator><motor name="motor" joint="hinge" ctrllimited="true" ctrlrange="-1 1"/></actuator></mujoco>
"""
REPORTS = {kind: report for name in COMMANDS for kind, report in load_command(name).declaration.reports.items()}
FAILURE = {"kind": "FileError", "message": "a.csv: no such file", "exit_code": 7}


@pytest.mark.parametrize("kind", [*DOCUMENTS, "bench", "error"])
def test_each_kind_is_the_schema_of_the_library_as_json(mjrun_here: Command, kind: str) -> None:
    done = mjrun_here("schema", kind)
    assert (done.returncode, done.stderr) == (0, b"")
    assert json.loads(done.stdout) == json.loads(json.dumps(schema_of(kind)))


def test_every_command_that_reports_has_a_schema() -> None:
    others = {"verify", "excite", "info-task", "info-demos", "episodes", "sweep-status"}
    assert {kind.removesuffix("-report") for kind in REPORTS} - others == {*COMMANDS} - {
        "examples",
        "schema",
        "skill",
        "completion",
    }
    assert len({*kinds()}) == len(kinds())
    assert {*kinds()} == {*DOCUMENTS, *REPORTS, "error", "options"}


def test_every_dataclass_that_names_a_schema_is_a_report_that_can_be_asked_for() -> None:
    package = Path(mjrun.__file__).parent
    named = {
        node.name
        for path in package.rglob("*.py")
        if " schema: " in (text := path.read_text("utf-8"))
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.ClassDef)
        and any(isinstance(each, ast.AnnAssign) and ast.unparse(each.target) == "schema" for each in node.body)
    }
    assert named <= {report.rpartition(":")[2] for report in REPORTS.values()}


@pytest.mark.parametrize("kind", REPORTS)
def test_every_key_of_a_report_is_described_and_required(kind: str) -> None:
    made, names = schema_of(kind), [field.name for field in fields(resolve_name(REPORTS[kind]))]
    if kind == "info":
        names = [*SECTIONS, "warnings"]
    names += [] if "schema" in names else ["schema"]
    required = {"info": ["warnings", "schema"], "info-task": ["schema"]}.get(kind, names)
    assert made["properties"]["schema"]["const"] == f"mjrun-{kind}-1"
    assert {*made["properties"]} == {*names, "error"}
    assert made["anyOf"][1] == {"required": ["error"]}
    assert sorted(made["anyOf"][0]["required"]) == sorted(required)
    for rule in rules(made):
        assert "$ref" not in rule or rule["$ref"].removeprefix("#/$defs/") in made["$defs"]
        if "description" in rule and "properties" in rule:
            assert rule is made or rule["required"] == [*rule["properties"]]
            assert all(inner["description"] for inner in rule["properties"].values())


@pytest.mark.parametrize("kind", ["error", *REPORTS])
def test_a_failure_alone_fits_its_schema_and_that_of_every_report(kind: str) -> None:
    made = schema_of(kind)
    assert fits({"error": {**FAILURE, "valid": ["b.csv"]}}, made, made)
    for key in FAILURE:
        assert not fits({"error": {name: value for name, value in FAILURE.items() if name != key}}, made, made)


LOG = "time,qpos/hinge\n" + "".join(f"{0.02 * k:g},{0.4 * 0.97**k:.9g}\n" for k in range(40))
FREE = ("--free", "joint/hinge.damping=log:1e-3..9", "--starts", "1", "--allow-unidentifiable")
RUN = """
model: one.xml
steps: 2
videos: [{output: v.mp4, size: 64x48}]
images: [{output: i.png, size: 64x48}]
traces: [{output: t.csv, assert: ["time < 9"]}]
plots: [{output: p.png, probe: qpos}]
recordings: [{output: r.npz}]
keyframes: [{output: k.xml}]
"""
TRACED = ("trace", "one.xml", "--steps", "3", "-o")
SWEPT = ("sweep", "one.xml", "--steps", "3", "--vary", "qpos/hinge=0,1", "--metric", "m=max(time)", "-o", "s")
PREPARATION: dict[str, list[tuple[str, ...]]] = {
    "diff": [(*TRACED, "a.csv"), (*TRACED, "b.csv")],
    "plot": [(*TRACED, "a.csv")],
    "verify": [(*TRACED, "a.csv", "--recording", "r.npz")],
    "trace": [(*TRACED, "t.csv", "--golden", "g.csv", "--update")],
    "sweep-status": [SWEPT],
}
PRINTED: dict[str, tuple[str, ...]] = {
    "video": ("video", "one.xml", "--steps", "2", "--size", "64x48"),
    "image": ("image", "one.xml", "--size", "64x48"),
    "trace": (*TRACED, "t.csv", "--golden", "g.csv", "--assert", "time < 9"),
    "run-report": ("run", "run.yaml"),
    "check": ("check", "one.xml", "--fail-on", "error"),
    "doctor": ("doctor",),
    "bench": ("bench", "one.xml", "--steps", "20", "--repeats", "2", "--budget", "0.1"),
    "diff": ("diff", "a.csv", "b.csv"),
    "eval": ("eval", "scene:pendulum_swing_up", "--policy", "zero", "--episodes", "2", "--jobs", "1", "-o", "e"),
    "excite": ("fit", "one.xml", *FREE[:2], "--excite", "chirp.csv", "--duration", "0.5"),
    "fit": ("fit", "one.xml", "log.csv", *FREE),
    "info": ("info", "one.xml"),
    "info-task": ("info", "scene:pendulum_swing_up", "observations"),
    "info-demos": ("info", "d.hdf5"),
    "export": ("export", "one.xml", "--steps", "2", "-o", "e.glb"),
    "episodes": ("export", "d.hdf5", "--jobs", "1", "-o", "x"),
    "plot": ("plot", "a.csv", "-o", "a.svg"),
    "dataset": ("dataset", "one.xml", "--size", "16x12", "--vary", "qpos/hinge=0,1", "--jobs", "1", "-o", "d"),
    "sweep": SWEPT,
    "sweep-status": ("sweep", "s", "--status"),
    "verify": ("trace", "one.xml", "--replay", "r.npz", "--verify"),
    "view": ("view", "one.xml", "--duration", "0.02"),
}


@pytest.mark.slow
@pytest.mark.gl
@pytest.mark.parametrize("kind", REPORTS)
def test_what_a_command_prints_as_json_fits_the_schema_of_its_kind(
    mjrun: Command, mjrun_here: Command, request: pytest.FixtureRequest, kind: str
) -> None:
    (mjrun.folder / "one.xml").write_text(MODEL)
    (mjrun.folder / "log.csv").write_text(LOG)
    write_demonstrations(mjrun.folder / "d.hdf5")
    (mjrun.folder / "run.yaml").write_text(RUN)
    for command in PREPARATION.get(kind, []):
        assert mjrun_here(*command).returncode == 0
    if kind == "view":
        done = mjrun(*PRINTED[kind], "--json", env=request.getfixturevalue("display"))
    else:
        done = mjrun_here(*PRINTED[kind], "--json")
    assert done.returncode == 0, done.stderr
    report, schema = json.loads(done.stdout), schema_of(kind)
    assert report["schema"] == f"mjrun-{kind}-1"
    assert fits(report, schema, schema)
    assert not fits({**report, "schema": "mjrun-other-1"}, schema, schema)


def test_the_help_says_what_prints_each_kind_of_report(mjrun_here: Command) -> None:
    text = " ".join(mjrun_here("schema", "--help").stdout.decode().split())
    assert all(kind in COMMANDS or kind in text for kind in kinds())


def test_options_are_a_reference_in_markdown(mjrun_here: Command) -> None:
    done = mjrun_here("schema", "options")
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.startswith(b"# Options of mjrun\n")


def test_another_kind_is_refused_with_those_there_are(mjrun_here: Command) -> None:
    done = mjrun_here("schema", "film")
    assert (done.returncode, done.stdout) == (2, b"")
    assert done.stderr == f"mjrun: error: no kind 'film'\n  kinds: {listing(kinds())}\n".encode()
