"""`mjrun check` as a user and a pipeline run it."""

from __future__ import annotations

import csv
import json
import re
import signal
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from mjrun.check.finding import SEVERITIES
from mjrun.check.rule_catalogue import TOPICS, explanation
from mjrun.check.rule_runner import RULES
from mjrun.formats.user_cache import VARIABLE
from mjrun.version import __version__
from tests.processes import PATIENCE, children, command_line_of, wait_until, worker

if TYPE_CHECKING:
    from tests.conftest import Command

ROOT = Path(__file__).parents[3]
FINE = (
    '<mujoco>\n<worldbody>\n<body name="b"><joint name="j"/><geom name="g" size="1"/></body>\n</worldbody>\n</mujoco>'
)
WARNED = FINE.replace('<joint name="j"', '\n<joint name="j" type="slide" range="2 1"')
NOTED = FINE.replace("</body>", '</body><camera pos="0 -5 0" zaxis="0 -1 0"/>')
BROKEN = FINE.replace("</body>", "</body><actuator/>")
REMEDY = 'write range="1 2" (angles in the unit of <compiler angle=…>), or remove it'
TOLD = "joint 'j': its range 2 1 is reversed and has no effect"


@pytest.fixture
def models(mjrun_here: Command) -> Command:
    """The command, in a folder with models."""
    for name, text in {"fine": FINE, "warned": WARNED, "noted": NOTED, "broken": BROKEN}.items():
        (mjrun_here.folder / f"{name}.xml").write_text(text)
    return mjrun_here


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["fine.xml"], 0),
        (["noted.xml"], 0),
        (["noted.xml", "--fail-on", "note"], 1),
        (["noted.xml", "--fail-on", "note", "--ignore", "mj201"], 0),
        (["warned.xml"], 0),
        (["warned.xml", "--fail-on", "warning"], 1),
        (["warned.xml", "--fail-on", "warning", "--select", "MJ4,MJ5", "--select", "MJ6"], 0),
        (["broken.xml"], 3),
        (["fine.xml", "broken.xml", "warned.xml", "--fail-on", "warning"], 3),
        (["gone.xml"], 3),
        (["fine.xml", "--timeout", "0.001", "--steps", "100000000"], 3),
        (["."], 3),
        ([], 2),
        (["fine.xml", "--select", "MJ9"], 2),
        (["fine.xml", "--json", "--sarif"], 2),
        (["fine.xml", "--steps", "-1"], 2),
        (["fine.xml", "--dry-run"], 2),
        (["fine.xml", "--diff", "--sarif"], 2),
        (["warned.xml", "--diff"], 1),
        (["warned.xml", "--fix", "--dry-run"], 1),
        (["warned.xml", "--fix", "--fail-on", "error"], 0),
        (["fine.xml", "--fail-on", "anything"], 2),
    ],
    ids=str,
)
def test_the_exit_code_is_the_answer(models: Command, arguments: list[str], code: int) -> None:
    done = models("check", *arguments)
    assert done.returncode == code
    assert b"Traceback" not in done.stderr
    assert (done.stdout == b"") == (code == 2 and "--json" not in arguments)


def test_a_finding_is_a_line_as_compilers_write_it_and_its_remedy(models: Command) -> None:
    done = models("check", "warned.xml", "fine.xml")
    first, remedy, summary = done.stdout.decode().splitlines()
    assert first == f"warned.xml:4: warning MJ302: {TOLD}"
    assert remedy == f"    {REMEDY}"
    assert summary == "2 models: 1 warning; 1 can be fixed with --fix"
    assert done.stderr == b""


@pytest.mark.slow
def test_the_summary_counts_and_quiet_leaves_it_out(models: Command) -> None:
    (models.folder / "part.xml").write_text("<mujocoinclude/>")
    last = models("check", ".").stdout.decode().splitlines()[-1]
    counts = "4 models: 1 error, 1 warning, 1 note; 1 can be fixed with --fix"
    assert last == f"{counts}; 1 does not load; 1 file skipped that is not a model"
    assert models("check", "part.xml").stdout == b"no model: nothing found; 1 file skipped that is not a model\n"
    assert models("check", "-q", "fine.xml").stdout == b""
    assert models("check", "fine.xml").stdout == b"1 model: nothing found\n"


def test_the_document_holds_all_models_in_order(models: Command) -> None:
    found = json.loads(models("check", "--json", "warned.xml", "fine.xml", "broken.xml").stdout)
    assert found["mjrun"] == __version__
    assert [(m["model"], m["loads"]) for m in found["models"]] == [
        ("warned.xml", True),
        ("fine.xml", True),
        ("broken.xml", False),
    ]
    assert (found["errors"], found["warnings"], found["notes"], found["skipped"], found["code"]) == (1, 1, 0, 0, 3)
    fixes = found["models"][0]["findings"][0].pop("fixes")
    assert [[edit["text"] for edit in fix["edits"]] for fix in fixes] == [["1", "2"]]
    assert found["models"][0]["findings"] == [
        {
            "code": "MJ302",
            "severity": "warning",
            "message": TOLD.removeprefix("joint 'j': "),
            "file": "warned.xml",
            "line": 4,
            "object": "joint 'j'",
            "remedy": REMEDY,
            "others": [],
            "unfixed": "",
        }
    ]


def test_fixes_that_are_not_made_are_not_extended(models: Command) -> None:
    done = models("check", "warned.xml", "--unsafe-fixes")
    assert done.returncode == 2
    assert b"--unsafe-fixes requires --fix, " in done.stderr
    assert models("check", "warned.xml", "--unsafe-fixes", "--diff").returncode in (0, 1)


def test_a_file_after_the_option_of_a_report_is_not_taken_for_a_model(models: Command) -> None:
    done = models("check", "warned.xml", "--sarif", "out.sarif")
    assert (done.returncode, done.stdout) == (2, b"")
    assert b"--sarif prints to standard output; write > out.sarif after the command" in done.stderr
    done = models("check", "warned.xml", "--junit", "out.xml")
    assert (done.returncode, done.stdout) == (2, b"")
    assert b"--junit prints to standard output; write > out.xml after the command" in done.stderr
    for words in (["--junit", "out.xml"], ["--junit", "warned.xml", "out.xml"]):
        assert models("check", *words).returncode == 3


def test_sarif_is_what_code_scanning_reads(models: Command) -> None:
    done = models("check", "--sarif", "warned.xml", "broken.xml")
    document = json.loads(done.stdout)
    (run,) = document["runs"]
    rules = run["tool"]["driver"]["rules"]
    assert (document["version"], done.returncode) == ("2.1.0", 3)
    assert [rule["id"] for rule in rules] == list(RULES)
    assert {rule["defaultConfiguration"]["level"] for rule in rules} == set(SEVERITIES)
    assert run["invocations"] == [{"executionSuccessful": True, "exitCode": 3}]
    for result in run["results"]:
        assert rules[result["ruleIndex"]]["id"] == result["ruleId"]
        assert result["message"]["text"]
    (first, _) = run["results"]
    assert first["level"] == "warning"
    assert first["message"]["text"] == f"{TOLD}\n{REMEDY}"
    assert first["locations"] == [
        {
            "physicalLocation": {"artifactLocation": {"uri": "warned.xml"}, "region": {"startLine": 4}},
            "logicalLocations": [{"fullyQualifiedName": "joint 'j'"}],
        }
    ]
    assert done.stderr.decode().endswith("2 models: 1 error, 1 warning; 1 can be fixed with --fix; 1 does not load\n")


def test_annotations_are_commands_that_github_reads(models: Command) -> None:
    done = models("check", "--github", "warned.xml", "noted.xml")
    warning, note = done.stdout.decode().splitlines()
    assert warning == f"::warning file=warned.xml,line=4,title=MJ302 reversed range::{TOLD}%0A{REMEDY}"
    assert note.startswith("::notice file=noted.xml,line=3,title=MJ201 object without a name::")


@pytest.mark.slow
def test_a_finding_in_another_file_names_the_model_in_every_form(models: Command) -> None:
    (models.folder / "outer.xml").write_text('<mujoco><include file="warned.xml"/></mujoco>')
    told = f"{TOLD} (in outer.xml)"
    assert models("check", "outer.xml").stdout.decode().startswith(f"warned.xml:4: warning MJ302: {told}\n")
    annotation = models("check", "--github", "outer.xml").stdout.decode()
    assert annotation == f"::warning file=warned.xml,line=4,title=MJ302 reversed range::{told}%0A{REMEDY}\n"
    (result,) = json.loads(models("check", "--sarif", "outer.xml").stdout)["runs"][0]["results"]
    assert result["message"]["text"] == f"{told}\n{REMEDY}"
    assert "(in " not in models("check", "./warned.xml").stdout.decode()


def test_the_list_names_every_code_and_needs_no_model(models: Command) -> None:
    lines = models("check", "--list").stdout.decode().splitlines()
    assert [line.split()[0] for line in lines if line.startswith("  ")] == list(RULES)
    assert [line.rstrip(":") for line in lines if line and not line.startswith(" ")] == list(TOPICS.values())
    assert "  MJ302  warning  reversed range [--fix]" in lines
    assert [rule["code"] for rule in json.loads(models("check", "--list", "--json").stdout)["rules"]] == list(RULES)


def test_a_rule_is_explained_without_a_model(models: Command) -> None:
    text = models("check", "--explain", "mj302").stdout.decode()
    assert text.startswith("# MJ302: reversed range\n\nSeverity: warning. Fixed by --fix.\n\n")
    assert text.endswith(explanation("MJ302"))
    assert json.loads(models("check", "--explain", "MJ302", "--json").stdout)["explanation"] == explanation("MJ302")

    unknown = models("check", "--explain", "MJ399")
    assert unknown.returncode == 2
    assert b"no rule 'MJ399' (did you mean" in unknown.stderr


def test_statistics_count_the_findings_of_each_rule(models: Command) -> None:
    (models.folder / "worse.xml").write_text(WARNED.replace("</body>", '</body><camera pos="0 -5 0" zaxis="0 -1 0"/>'))
    listed = models("check", "warned.xml", "worse.xml", "noted.xml")
    counted = models("check", "warned.xml", "worse.xml", "noted.xml", "--statistics")

    found = re.findall(r": (\w+) (MJ\d+): ", listed.stdout.decode())
    assert counted.stdout.decode().splitlines() == [
        f"{number}  {code}  {severity:7}  {RULES[code].title}"
        for (severity, code), number in sorted(Counter(found).items(), key=lambda item: (-item[1], item[0][::-1]))
    ]
    assert len(set(found)) == 2
    assert listed.stdout.decode().splitlines()[-1] in counted.stderr.decode()

    (models.folder / "mjrun.toml").write_text(f'[check.severity]\n{found[0][1]} = "error"\n')
    changed = models("check", "warned.xml", "worse.xml", "noted.xml", "--statistics").stdout.decode()
    assert f"{found[0][1]}  error    " in changed


def test_a_code_that_is_none_is_answered_with_one_that_is(models: Command) -> None:
    done = models("check", "fine.xml", "--ignore", "MJ3O2")
    assert re.search(rb"no code 'MJ3O2' \(did you mean .*'MJ302'.*\?\)", done.stderr)


def test_a_file_that_crashes_mujoco_is_told_beside_the_others(models: Command) -> None:
    asset = '<asset><model name="me" file="self.xml"/></asset>'
    attach = '<attach model="me" prefix="x" body="b"/>'
    text = f'<mujoco>{asset}<worldbody><body name="b">{attach}</body></worldbody></mujoco>'
    (models.folder / "self.xml").write_text(text)
    done = models("check", "self.xml", "warned.xml")
    assert done.returncode == 3
    assert b"self.xml:1: error MJ113: attaches 'self.xml', which is or attaches this model again" in done.stdout
    assert b"warned.xml:4: warning MJ302" in done.stdout
    assert models.files() == ["broken.xml", "fine.xml", "noted.xml", "self.xml", "warned.xml"]


def test_a_signal_ends_the_processes_too(models: Command) -> None:
    attributes = " ".join(f'a{i}="1"' for i in range(100_000))  # which take MuJoCo twenty seconds
    (models.folder / "slow.xml").write_text(f"<mujoco><worldbody><geom {attributes}/></worldbody></mujoco>")
    command = models.start("check", "slow.xml")
    working = worker(command)
    wait_until(lambda: children(working), command)
    processes = children(working)
    command.send_signal(signal.SIGTERM)
    _, err = command.communicate(timeout=PATIENCE)
    assert command.returncode == 143
    assert b"Traceback" not in err
    wait_until(lambda: not any(map(command_line_of, (working, *processes))))


@pytest.mark.slow
def test_models_of_others_are_checked_without_a_traceback(mjrun_here: Command, shared_models: Path) -> None:
    # tests/test_readme.py checks the scenes, tests/scoreboard/every_model.py all of these.
    some = [shared_models / name for name in ("car", "cube", "flex", "malformed", "replicate", "slider_crank")]
    done = mjrun_here("check", *some, "--json", "--steps", "20")
    found = json.loads(done.stdout)
    assert done.returncode == 3
    assert b"Traceback" not in done.stderr
    unloaded = {Path(model["model"]).parent.name for model in found["models"] if not model["loads"]}
    assert unloaded == {"malformed"}
    for model in found["models"]:
        errors = [finding for finding in model["findings"] if finding["severity"] == "error"]
        assert (errors == []) == model["loads"], model
        assert {finding["code"] for finding in errors}.isdisjoint(("MJ002", "MJ003", "MJ004", "MJ005"))


def test_a_scan_lists_the_worst_first_and_lines_of_json_are_the_models_of_the_report(models: Command) -> None:
    (models.folder / "other.xml").write_text("<other/>")
    done = models("check", ".", "--scan", "--table", "found.csv")
    assert done.returncode == 3
    ranked = [line.split()[3] for line in done.stdout.decode().splitlines()]
    assert ranked == ["broken.xml", "warned.xml", "noted.xml"]
    with (models.folder / "found.csv").open(newline="") as file:
        assert [row["model"] for row in csv.DictReader(file)] == [*ranked, "fine.xml"]

    lines = [json.loads(line) for line in models("check", ".", "--json-lines").stdout.splitlines()]
    assert sorted(lines, key=lambda line: line["model"]) == json.loads(models("check", ".", "--json").stdout)["models"]
    assert models("check", ".", "--scan", "--table", "found.txt").returncode == 2


def test_a_new_mistake_among_known_ones_fails_with_an_annotation_at_its_line(
    models: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, str(models.folder / "cache"))
    folder = models.folder / "robots"
    folder.mkdir()
    for number in range(20):
        (folder / f"robot_{number:02}.xml").write_text((FINE, WARNED, NOTED, BROKEN)[number % 4])
    options = ("check", "robots", "--baseline", "known.json", "--fail-on", "note")
    models(*options, "--update-baseline")

    def report() -> tuple[int, bytes]:
        done = models(*options, "--github")
        return done.returncode, done.stdout

    assert report() == (0, b"")
    changed = folder / "robot_08.xml"
    changed.write_text(FINE.replace("<joint", "<!-- moved -->\n<joint"))
    assert report() == (0, b"")
    changed.write_text(WARNED)
    code, annotations = report()
    (annotation,) = annotations.decode().splitlines()
    line = WARNED[: WARNED.index("<joint")].count("\n") + 1
    assert code == 1
    assert annotation.startswith(f"::warning file=robots/robot_08.xml,line={line},title=MJ302 reversed range::")
