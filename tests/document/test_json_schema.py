"""JSON Schemas take what documents may say and refuse what they may not; reports fit theirs."""

import json
from dataclasses import asdict
from functools import cache, partial
from pathlib import Path
from typing import Any

import pytest
import yaml

from mjrun.bench.bench import Bench
from mjrun.bench.results import BenchResult
from mjrun.camera.rigs.rig import BLENDS, EASINGS
from mjrun.camera.script import RIGS, ShotMappingKind
from mjrun.document import camera_and_ghost_forms
from mjrun.document.json_schema import DOCUMENTS, VARIABLE_KEYS, json_schema, report_schema
from mjrun.document.run import RUN
from mjrun.errors import UnknownNameError
from mjrun.options.kinds import ReadingContext
from mjrun.options.schema_validation import InvalidValueError, SchemaViolationError
from tests.cases import cases
from tests.document.schema_oracle import fits, rules

schema_of = cache(json_schema)


def is_valid(value: object, kind: str) -> bool:
    """Returns whether a value is a document of a kind."""
    return fits(value, schema_of(kind), schema_of(kind))


@cases("text")
def test_what_is_read_fits_the_schema(text: str) -> None:
    value = yaml.safe_load(text)
    camera_and_ghost_forms.CAMERA.read(value, ReadingContext())
    assert is_valid(value, "camera")


@pytest.mark.parametrize(
    "text",
    [
        "{}", "shots: []", "shots: [{}]", "shots: [{camera: }]", "shots: [{camera: -1}]", "shots: [{camera: 1.5}]",
        "shots: [{free: , orbit: }]", "shots: [{free: 1}]", "shots: [{free: {target: a}}]",
        "shots: [{orbit: {distance: 0}}]", "shots: [{orbit: {distance: true}}]", "shots: [{zoom: 1, free: }]",
        "shots: [{orbit: {azimuth: {from: 1}}}]",
        "shots: [{orbit: {lookat: [1, 2]}}]", "shots: [{orbit: {azimuth: {from: 1, to: 2, ease: x}}}]",
        "shots: [{track: }]", "shots: [{free: , until: {nth: 1}}]", "shots: [{free: , blend: x}]", "speed: '1'",
        "shots: [{free: , until: {when: a, else: never}}]", "shots: [{free: , fit: {target: a, margin: 0.5}}]",
    ],
)  # fmt: skip
def test_what_is_refused_does_not_fit_the_schema(text: str) -> None:
    value = yaml.safe_load(text)
    with pytest.raises((SchemaViolationError, InvalidValueError)):
        camera_and_ghost_forms.CAMERA.read(value, ReadingContext())
    assert not is_valid(value, "camera")


@pytest.mark.parametrize("kind", DOCUMENTS)
def test_a_schema_says_its_dialect_and_title_and_has_no_place_in_the_world(kind: str) -> None:
    made = json_schema(kind)
    assert made["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    assert made["title"] == f"mjrun {kind.removesuffix('-document')} document"
    assert not any("$id" in rule for rule in rules(made))


@pytest.mark.parametrize("kind", DOCUMENTS)
def test_every_mapping_and_every_key_is_described_and_every_reference_leads_somewhere(kind: str) -> None:
    made = json_schema(kind)
    for rule in rules(made):
        assert "$ref" not in rule or rule["$ref"].removeprefix("#/$defs/") in made["$defs"]
        if rule.get("type") == "object":
            assert rule["description"]
            assert rule["additionalProperties"] is False or "properties" not in rule
            assert all(inner.get("description") for inner in rule.get("properties", {}).values())
        assert "default" not in rule or rule["default"] is not None


def test_keys_and_choices_are_those_of_the_forms() -> None:
    made = json_schema("camera")
    assert [*made["properties"]] == ["speed", "shots"]
    shot = made["$defs"]["Shot"]
    assert [*shot["properties"]] == ShotMappingKind().keys
    assert [rule["required"] for rule in shot["oneOf"]] == [[rig] for rig in RIGS]
    assert made["$defs"]["ShotBlend"]["properties"]["shape"]["enum"] == [*BLENDS]
    assert made["$defs"]["RampOptions"]["properties"]["ease"]["enum"] == [*EASINGS]


def test_a_document_with_a_preamble_may_have_vars_and_defaults() -> None:
    assert [*json_schema("run")["properties"]] == [*VARIABLE_KEYS, *RUN.keys]
    assert [*json_schema("camera")["properties"]] == ["speed", "shots"]


HEAD = "model: m.xml\nvideos:\n- output: a.mp4\n  "


@cases("text")
def test_run_documents_fit_the_schema(text: str) -> None:
    assert is_valid(yaml.safe_load(text), "run")


@pytest.mark.parametrize(
    "text",
    [
        "{}", "{model: m.xml}", "{recordings: [a.npz]}", "{model: m.xml, recording: [a]}", "{defaults: 1}",
        "{model: m.xml, recordings: [a.npz], duraton: 1}", "{model: m.xml, recordings: [a.npz], duration: 0}",
        "{model: m.xml, recordings: [a.npz], duration: soon}", "{model: m.xml, recordings: [a.npz], qpos: {a: up}}",
        "{model: m.xml, recordings: [a.npz], vars: {x y: 1}}", "{model: m.xml, recordings: [a.npz], steps: '${x'}",
        "{model: m.xml, traces: [{probe: qpos}]}", "{model: m.xml, plots: [{probe: energy}]}",
        HEAD + "size: 64", HEAD + "size: [64]", HEAD + "view: rbg", HEAD + "show: nothing", HEAD + "geomgroup: [6]",
        HEAD + "camera: true", HEAD + "camera: {shots: []}", HEAD + "jobs: all", HEAD + "captions: 'true'",
        HEAD + "ghost: {opacity: 2}", HEAD + "gl: egl", HEAD + "crf: 1.5",
    ],
)  # fmt: skip
def test_what_is_no_run_document_does_not_fit_the_schema(text: str) -> None:
    assert not is_valid(yaml.safe_load(text), "run")


def test_a_kind_that_there_is_not_is_reported() -> None:
    with pytest.raises(
        UnknownNameError,
        match=r"^no schema 'camra' \(did you mean 'camera'\?\)\n"
        r"schemas: camera, run, study, fit-document, eval-document, task$",
    ):
        json_schema("camra")


def test_the_example_in_the_module_is_a_document(tmp_path: Path) -> None:
    example = (camera_and_ghost_forms.__doc__ or "").split("```yaml")[1].split("```")[0]
    (tmp_path / "c.yaml").write_text(example)
    assert len(camera_and_ghost_forms.read_camera(tmp_path / "c.yaml").shots) == 2
    assert is_valid(yaml.safe_load(example), "camera")


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
    made = report_schema("bench", "mjrun bench", BenchResult)
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
