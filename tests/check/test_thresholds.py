"""Theorems about thresholds that a repository sets."""

from dataclasses import Field, fields
from pathlib import Path

import pytest

from mjrun.check.catalogue import Thresholds, threshold_values
from mjrun.check.check import ModelCheck
from mjrun.check.context import CheckContext
from mjrun.check.rule_table import apply
from mjrun.errors import UsageError
from mjrun.model.xml_source import read_xml
from tests.check.models import hinged, write
from tests.check.rules.test_cases import CASES, built

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
