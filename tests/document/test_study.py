"""A study document and a plan are what they say, exactly, or a list of what is wrong with them."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from hypothesis import given, settings

from mjrun.cli.console import Console
from mjrun.cli.main import group
from mjrun.document.study import (
    portable_document,
    read_folder,
    read_plan,
    read_study,
    study_document,
    study_text,
    with_document,
    write_plan,
)
from mjrun.errors import DocumentError, FileError, UsageError
from mjrun.options.sweep import StudyOptions
from mjrun.simulation.simulation import Simulation
from mjrun.study.job_plan import JobPlan, plan
from mjrun.study.study import Study
from tests.cases import cases
from tests.document.documents import put
from tests.document.option_strategies import in_python, in_quotes, options_in_documents
from tests.study.models import BALL

HEAD = "model: ball.xml\nsteps: 20\n"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("ball.xml").write_text(BALL)
    return tmp_path


def read(text: str, *assignments: str, **options: Any) -> Study:
    Path("d.yaml").write_text(HEAD + text)
    return read_study("d.yaml", assignments, **options).made


def study(**options: Any) -> Study:
    simulation = {name: options.pop(name) for name in ("set", "qpos", "seed", "key") if name in options}
    return Study(Simulation("ball.xml", steps=20, **simulation), options.pop("output", "d"), **options)


# --- what is said -------------------------------------------------------------------------------------


@cases("text, said")
def test_the_study_is_what_the_document_says(text: str, said: dict[str, Any]) -> None:
    assert read(text) == study(**said)


def test_assignments_count_instead_of_what_is_written() -> None:
    text = "vary: {opt.timestep: 0.001}\nrepeats: 3"
    made = read(text, "repeats=7", "vary.opt.timestep=[0.001, 0.002]", "vary.qpos/ball/z=1..2:2", "metrics.x=max(time)")
    vary = {"opt.timestep": "0.001,0.002", "qpos/ball/z": "1..2:2"}
    assert made == study(repeats=7, vary=vary, metric={"x": "max(time)"})


def test_what_is_given_counts_instead_of_the_document() -> None:
    made = read("output: a\ntime_limit: 1", values={"output": "/tmp/x", "time_limit": "2", "jobs": 3})
    assert made == study(output="/tmp/x", time_limit="2", jobs=3)


def test_files_are_relative_to_the_document_and_the_folder_to_the_current_one(folder: Path) -> None:
    (folder / "sub").mkdir()
    vary = "vary: {model: [a.xml, scene:car], ctrl_from: 'choice(a.csv, /b.csv)'}"
    (folder / "sub/kicks.yaml").write_text(f"{HEAD}{vary}\npoints: p.csv")
    made = read_study("sub/kicks.yaml").made
    assert (made.simulation.model, made.points, made.output) == ("sub/ball.xml", "sub/p.csv", "kicks")
    assert made.vary == (("model", "sub/a.xml,scene:car"), ("ctrl_from", "choice(sub/a.csv,/b.csv)"))


# --- what is wrong ------------------------------------------------------------------------------------


@cases("text, expected")
def test_what_is_wrong_is_reported_where_it_is(text: str, expected: str) -> None:
    with pytest.raises(DocumentError) as caught:
        read(text)
    assert str(caught.value).startswith(f"d.yaml:{expected}")


@cases("text, expected")
def test_what_is_wrong_with_the_model_at_hand_is_reported_where_it_is(text: str, expected: str) -> None:
    Path("d.yaml").write_text(HEAD + text)
    request = read_study("d.yaml")
    with pytest.raises(DocumentError) as caught, request.located():
        request.made.preview()
    assert str(caught.value).startswith(f"d.yaml:{expected}")


# --- what is printed ----------------------------------------------------------------------------------


@given(options_in_documents(StudyOptions))
@settings(max_examples=30)
def test_a_document_is_the_study_of_python_and_so_is_the_one_printed_for_it(options: dict[str, Any]) -> None:
    made = Study(Simulation("ball.xml", steps=20), "out", **in_python(StudyOptions, options))
    document = {"model": "ball.xml", "steps": 20, "output": "out", **options}
    document["metrics"] = document.pop("metric", {})
    for text in (in_quotes(document), study_text(made, "mjrun …\n")):
        assert read_study(put(text)).made == made


@cases("words")
def test_a_command_line_and_its_document_are_the_same_study(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Study] = []

    def preview(self: Study) -> None:
        made.append(replace(self, command=""))
        raise UsageError("far enough")

    monkeypatch.setattr(Study, "preview", preview)
    monkeypatch.setattr(Console, "guard_stdout", lambda self: None)
    printed = CliRunner().invoke(
        group, ["sweep", "ball.xml", "--steps", "20", *words, "--print-document"], obj=Console()
    )
    assert printed.exit_code == 0, printed.output
    Path("d.yaml").write_text(printed.stdout)
    for arguments in (["ball.xml", "--steps", "20", *words], ["d.yaml"]):
        CliRunner().invoke(group, ["sweep", *arguments, "--dry-run"], obj=Console())
    assert len(made) == 2
    assert made[0] == made[1]


def written_study(model: str = "models/a.xml") -> Study:
    vary = {"model": "models/a.xml,scene:dominos", "ctrl_from": "tables/a.csv", "seed": "1,2"}
    return Study(Simulation(model, steps=3), "study", vary=vary, metric={"low": "min(qpos/ball/z)"})


def test_it_holds_what_is_not_the_default() -> None:
    vary = {"model": "models/a.xml,scene:dominos", "ctrl_from": "tables/a.csv", "seed": [1, 2]}
    metrics = {"low": "min(qpos/ball/z)"}
    written = study_document(written_study())
    assert written == {"model": "models/a.xml", "steps": 3, "output": "study", "vary": vary, "metrics": metrics}
    assert study_text(written_study(), "mjrun …").startswith("# mjrun …\nmodel: models/a.xml\n")


def test_in_another_folder_its_files_are_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    written = portable_document(written_study(), Path("deep/er"))
    assert written["model"] == "../../models/a.xml"
    assert written["vary"] == {
        "model": "../../models/a.xml,scene:dominos", "ctrl_from": "../../tables/a.csv", "seed": [1, 2]
    }  # fmt: skip
    assert "output" not in written
    with pytest.raises(UsageError, match="resumed with a model from standard input"):
        portable_document(written_study("-"), Path("deep"))


@pytest.fixture
def made() -> JobPlan:
    vary = {"seed": "1..5:5", "model": "ball.xml,ball.xml;"}
    metric = {"low": "min(qpos/ball/z)"}
    study = Study(Simulation("ball.xml", steps=20), "study", vary={"seed": "1..5:5"}, metric=metric, chunk=2)
    return plan(replace(study, vary={**vary, "model": "ball.xml"}))


def content(path: str) -> dict[str, Any]:
    return json.loads(Path(path).read_text())


def test_what_is_written_is_read(made: JobPlan) -> None:
    write_plan("plan.jsonl", made)
    assert content("plan.jsonl")["ranges"] == [[0, 5]]
    again = read_plan("plan.jsonl", {"chunk": 2})
    assert again
    assert again == made


def test_a_plan_elsewhere_leads_to_the_same_files(made: JobPlan, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "plans").mkdir()
    write_plan("plans/plan.jsonl", made)
    assert content("plans/plan.jsonl")["study"]["model"] == "../ball.xml"
    (folder / "elsewhere").mkdir()
    monkeypatch.chdir(folder / "elsewhere")
    again = read_plan("../plans/plan.jsonl")
    assert again
    assert Path(again.study.output).resolve() == folder / "study"
    assert (again.study.simulation.model, dict(again.study.vary)["model"]) == ("../ball.xml", "../ball.xml")
    assert plan(again.study).identity == made.identity


def test_a_plan_of_nothing_is_empty(made: JobPlan) -> None:
    write_plan("plan.jsonl", replace(made, ranges=[]))
    assert read_plan("plan.jsonl") is None


@cases("change, expected")
def test_what_is_no_plan_is_refused(made: JobPlan, change: Any, expected: str) -> None:
    write_plan("plan.jsonl", made)
    text = change if isinstance(change, str) else json.dumps({**content("plan.jsonl"), **change})
    Path("plan.jsonl").write_text(text)
    with pytest.raises(DocumentError) as caught:
        read_plan("plan.jsonl")
    assert str(caught.value).startswith(expected)


def test_two_plans_in_a_file_are_refused(made: JobPlan) -> None:
    write_plan("plan.jsonl", made)
    Path("plan.jsonl").write_text(2 * Path("plan.jsonl").read_text())
    with pytest.raises(DocumentError, match=r"^plan\.jsonl:2:1: a plan is one line$"):
        read_plan("plan.jsonl")


def test_a_folder_knows_its_study(made: JobPlan) -> None:
    study = replace(made.study, document=portable_document(made.study, Path("study")))
    study.write_manifest({})
    again = read_folder("study", {"chunk": 2})
    assert again == replace(study, document=None)
    for text in ("{}", "[1]", '{"command": "mjrun sweep m.xml --controller c.py:f"}'):
        Path("study/study.json").write_text(text)
        with pytest.raises(FileError, match=r"does not contain a study\n.* repeat the command or the Python code"):
            read_folder("study")


def test_what_no_document_can_hold_is_in_no_plan(made: JobPlan) -> None:
    stdin = replace(made, study=replace(made.study, simulation=Simulation("-")))
    with pytest.raises(UsageError, match="resumed with a model from standard input"):
        write_plan("plan.jsonl", stdin)
    code = replace(made, study=replace(made.study, simulation=Simulation("ball.xml", controller=print)))
    with pytest.raises(UsageError, match="a document cannot contain code"):
        write_plan("plan.jsonl", code)
    varied = replace(made.study, vary={"controller": "c.py:f,c.py:g"}, controllers={"c.py:f": print, "c.py:g": input})
    with pytest.raises(UsageError, match="vary controller: a document cannot contain code"):
        write_plan("plan.jsonl", replace(made, study=varied))
    with pytest.raises(UsageError, match="vary controller: a document cannot contain code"):
        study_text(varied)
    assert with_document(varied).document is None  # so that the manifest does not promise a study
    assert not Path("plan.jsonl").exists()


def test_an_error_of_a_document_that_varies_code_names_the_parameter_once() -> None:
    path = put("{model: ball.xml, steps: 3, vary: {controller: 'c.py:f'}}")
    request = read_study(path)
    with (
        pytest.raises(DocumentError, match=r":1:\d+: vary\.controller: c\.py:f: only the command line"),
        request.located(),
    ):
        request.made.preview()


def test_a_plan_writes_nowhere_else_unless_there_is_its_study(made: JobPlan, tmp_path: Path) -> None:
    write_plan("plan.jsonl", made)
    text = Path("plan.jsonl").read_text()
    folder = json.loads(text.splitlines()[0])["folder"]
    Path("plan.jsonl").write_text(text.replace(f'"folder": "{folder}"', '"folder": "../../above"'))
    with pytest.raises(UsageError, match="outside of the plan's folder"):
        read_plan("plan.jsonl")
    assert read_plan("plan.jsonl", {"output": "here"}) is not None


def test_a_line_without_end_is_no_plan(tmp_path: Path) -> None:
    (tmp_path / "plan.jsonl").write_text("[" * 100_000)
    with pytest.raises(DocumentError, match="not JSON"):
        read_plan(str(tmp_path / "plan.jsonl"))
