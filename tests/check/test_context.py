"""Theorems about the places of objects in XML, and about thresholds that a repository sets."""

from dataclasses import Field, fields
from pathlib import Path

import pytest

from mjrun.check.check import ModelCheck
from mjrun.check.context import CheckContext
from mjrun.check.finding import Finding
from mjrun.check.rule_catalogue import Thresholds, threshold_values
from mjrun.check.rule_runner import RULES, apply
from mjrun.errors import UsageError
from mjrun.model.xml_source import read_xml
from tests.check.models import MESH, arms, attaching, hinged, lint, mjcf, write
from tests.check.rules.test_cases import CASES, built


def test_lines_are_those_of_included_files_too() -> None:
    Path("parts").mkdir()
    Path("parts/arm.xml").write_text(
        '<mujocoinclude>\n<body name="b">\n<joint name="j" range="2 1"/>\n<geom size="1"/></body>\n</mujocoinclude>'
    )
    findings = lint(mjcf('<include file="parts/arm.xml"/>'))
    assert [(f.code, f.file, f.line) for f in findings] == [("MJ302", "parts/arm.xml", 3)]


def test_a_mesh_without_a_name_is_at_the_line_of_its_file_in_an_included_model() -> None:
    Path("part.xml").write_text('<mujocoinclude><asset>\n<mesh file="yes.obj"/></asset></mujocoinclude>')
    write("yes.obj", MESH)
    geom = '<geom type="mesh" mesh="yes"/>'
    path = Path(write("model.xml", mjcf(f"<body><joint/>{geom}</body>", before='<include file="part.xml"/>')))
    place = CheckContext.load(path, read_xml(path)).place("mesh", 0)
    assert (place.file, place.line) == (Path("part.xml"), 2)


def test_objects_without_names_on_one_line_are_told_apart_by_their_order() -> None:
    joints = '<joint range="0 1"/><joint axis="1 0 0" range="0 2"/>'
    path = Path(write("model.xml", mjcf(f'<body>{joints}<geom size="1"/><body>{joints}<geom size="1"/></body></body>')))
    context = CheckContext.load(path, read_xml(path))
    elements = [context.element("joint", i) for i in range(context.model.njnt)]
    assert [each and each.attributes["range"].split()[1] for each in elements] == ["1", "2"] * 2
    assert len({id(each) for each in elements}) == 4


def reversed_ranges(text: str) -> list[Finding]:
    """All findings of MJ302, which a check merges."""
    path = Path(write("model.xml", text))
    return list(RULES["MJ302"].findings(CheckContext.load(path, read_xml(path))))


def test_what_is_attached_is_told_where_the_model_attaches_it_with_its_origin() -> None:
    findings = reversed_ranges(arms(f"{attaching('l_')}\n{attaching('right_')}"))
    assert [(f.object, f.file, f.line) for f in findings] == [
        ("joint 'l_j'", "model.xml", 5),
        ("joint 'right_j'", "model.xml", 7),
    ]
    assert [f.message.rpartition(" (")[2] for f in findings] == ["attached from arm.xml:5)"] * 2


def test_where_it_is_not_clear_what_attached_an_object_only_the_file_is_told() -> None:
    text = arms(f"{attaching('l_')}\n{attaching('right_')}").replace('name="arm"', "")
    Path("arm.xml").write_text(
        Path("arm.xml").read_text().replace('name="j" ', "").replace("<mujoco", '<mujoco model="arm"')
    )
    assert [(f.file, f.line) for f in reversed_ranges(text)] == [("model.xml", None)] * 2


def test_the_origin_of_what_is_attached_is_the_element_whose_name_is_closest() -> None:
    keys = '<keyframe>\n<key name="k"/>\n<key name="k2" qpos="2"/>\n<key qpos="3"/></keyframe>'
    text = arms(attaching("l_"), keys, 'range="-1 1"', '<compiler angle="radian"/>')
    origins = {f.object: f.message.rpartition(" from ")[2] for f in lint(text)}
    assert origins == {"keyframe 'l_k2'": "arm.xml:9)", "keyframe 'l_'": "arm.xml:10)"}


OVERLAP = hinged(world='<body pos=".195 0 0"><freejoint/><geom size=".1"/></body>')


def test_a_rule_reports_what_exceeds_its_threshold() -> None:
    path = Path(write("a.xml", OVERLAP))  # spheres of radius 0.1 m that overlap by 5 mm
    source = read_xml(path)

    def is_reported(depth: float) -> bool:
        thresholds = Thresholds(penetration=depth, penetration_share=0.01)
        return bool(apply("MJ501", CheckContext.load(path, source, thresholds), iter))

    assert [is_reported(depth) for depth in (0.0049, 0.0051)] == [True, False]


@pytest.mark.parametrize("each", [each for each in fields(Thresholds) if each.metadata["code"] != "MJ702"])
def test_every_threshold_decides_about_a_case_of_its_rule(each: "Field[float]") -> None:
    code, default = each.metadata["code"], getattr(Thresholds(), each.name)

    def found(value: float) -> list[tuple[str, str]]:
        context = CheckContext.load(path, read_xml(path), Thresholds(**{each.name: value}))
        return [(finding.message, finding.severity) for finding in apply(code, context)]

    for case in (case for case in CASES if case["rule"] == code):
        for name, text in case.get("files", {}).items():
            write(name, text)
        path = Path(write("model.xml", built(case["model"])))
        if any(found(factor * default) != found(default) for factor in (1e9, 1e-9)):
            return
    pytest.fail(f"no case of {code} depends on it")


def test_thresholds_reach_the_process_that_checks() -> None:
    write("a.xml", OVERLAP)
    write("mjrun.toml", "[check.threshold]\npenetration-share = 0.01\npenetration = 0.004\n")
    for threshold, count in (({}, 0), ({"penetration-share": 0.01}, 1)):
        (model,) = ModelCheck(["a.xml"], select=["MJ501"], threshold=threshold, steps=0).run().models
        assert len(model.findings) == count


def test_values_have_either_spelling_and_mistakes_suggest_what_is_valid() -> None:
    assert threshold_values([("energy-gain", "0.5"), ("energy_gain", "1")]) == {"energy_gain": 1}
    for value in ("0", "-1", "inf", "nan", "x"):
        with pytest.raises(UsageError, match="is not a positive number"):
            ModelCheck(["a.xml"], threshold={"energy-gain": value})
    with pytest.raises(UsageError, match=r"no threshold 'energy-gian' \(did you mean 'energy-gain'\?\)\nthresholds: "):
        ModelCheck(["a.xml"], threshold={"energy-gian": 1})
