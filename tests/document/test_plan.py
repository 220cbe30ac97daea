"""A plan is read as it was written, from wherever it lies, and no other file is taken for one."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mjrun.document.study import portable_document, read_folder, read_plan, write_plan
from mjrun.errors import DocumentError, FileError, UsageError
from mjrun.simulation.simulation import Simulation
from mjrun.study.job_plan import JobPlan, plan
from mjrun.study.study import Study
from tests.cases import cases
from tests.study.models import BALL


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("ball.xml").write_text(BALL)
    return tmp_path


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
    Path("study/study.json").write_text("{}")
    with pytest.raises(FileError, match="does not contain a study"):
        read_folder("study")


def test_what_no_document_can_hold_is_in_no_plan(made: JobPlan) -> None:
    stdin = replace(made, study=replace(made.study, simulation=Simulation("-")))
    with pytest.raises(UsageError, match="resumed with a model from standard input"):
        write_plan("plan.jsonl", stdin)
    code = replace(made, study=replace(made.study, simulation=Simulation("ball.xml", controller=print)))
    with pytest.raises(UsageError, match="a document cannot contain code"):
        write_plan("plan.jsonl", code)


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
