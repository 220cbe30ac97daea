"""Reports fit the schema that is derived from their dataclasses."""

import ast
import json
from dataclasses import asdict, fields
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import mjrun
from mjrun.bench.bench import Bench
from mjrun.document.json_schema import json_schema
from mjrun.document.report_schema import REPORTS
from tests.document.schema_oracle import fits, rules

FAILURE = {"kind": "FileError", "message": "a.csv: no such file", "exit_code": 7}


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """What `mjrun bench --json` reports of a grid with a point that fails, beside a base with another."""
    folder = tmp_path_factory.mktemp("bench")
    path, base = folder / "swing.xml", str(folder / "base.json")
    path.write_text(
        '<mujoco><worldbody><body><joint type="slide" stiffness="100"/><geom size=".1" mass="1"/></body></worldbody>'
        '<keyframe><key name="test" qpos=".3"/></keyframe></mujoco>'
    )
    job = partial(Bench, path, steps=20, repeats=2, budget=0.1)
    job(threads=(1, 2), scan={"timestep": [".01", ".02"]}, save=base).run()
    found = job(threads=(1,), scan={"timestep": [".01", "1"]}, accuracy=True, horizon=100, compare=base).run()
    return json.loads(json.dumps(asdict(found)))


def test_a_report_fits_its_schema_as_long_as_nothing_is_missing_and_nothing_is_of_another_kind(report: Any) -> None:
    made = json_schema("bench")
    assert report["rows"][1]["failure"]
    assert report["comparison"]["gone"]
    assert fits(report, made, made)
    for key, value in report.items():
        without = {name: inner for name, inner in report.items() if name != key}
        assert not fits(without, made, made)
        assert fits({**without, "error": FAILURE}, made, made)
        assert not fits({**report, key: [1] if isinstance(value, str) else "x"}, made, made)
    assert fits({**report, "new": 1}, made, made)
    del report["rows"][0]["step"]["median"]
    assert not fits(report, made, made)


def test_every_dataclass_that_names_a_schema_is_a_report_that_can_be_asked_for() -> None:
    package = Path(mjrun.__file__).parent
    named = {
        node.name
        for path in package.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.ClassDef)
        and any(isinstance(each, ast.AnnAssign) and ast.unparse(each.target) == "schema" for each in node.body)
    }
    assert named == {report.__name__ for report in REPORTS.values()}


@pytest.mark.parametrize("kind", REPORTS)
def test_every_key_of_a_report_is_described_and_required(kind: str) -> None:
    made, report = json_schema(kind), REPORTS[kind]
    assert made["properties"]["schema"]["const"] == f"mjrun-{kind}-1"
    assert [*made["properties"]] == [*(field.name for field in fields(report)), "error"]
    assert made["anyOf"] == [{"required": [field.name for field in fields(report)]}, {"required": ["error"]}]
    for rule in rules(made):
        assert "$ref" not in rule or rule["$ref"].removeprefix("#/$defs/") in made["$defs"]
        if "properties" in rule:
            assert rule["description"]
            assert rule is made or rule["required"] == [*rule["properties"]]
            assert all(inner["description"] for inner in rule["properties"].values())


def test_a_failure_alone_fits_its_schema_and_that_of_every_report() -> None:
    for kind in ("error", *REPORTS):
        made = json_schema(kind)
        assert fits({"error": {**FAILURE, "valid": ["b.csv"]}}, made, made)
        for key in FAILURE:
            assert not fits({"error": {name: value for name, value in FAILURE.items() if name != key}}, made, made)
