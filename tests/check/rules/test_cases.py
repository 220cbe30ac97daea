"""Rules and the models in `cases.yaml`, in which they find something, next to correct models."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from mjrun.check.finding import SEVERITIES
from mjrun.check.rule_runner import RULES
from mjrun.check.rules import simulation
from tests.check.models import FINE, hinged, keyed, lint, mjcf

CASES = yaml.safe_load((Path(__file__).parent / "cases.yaml").read_text("utf-8"))
BUILDERS = {"mjcf": mjcf, "hinged": hinged, "keyed": keyed}


def built(model: str | dict[str, dict[str, str]]) -> str:
    """The text of a model, which is given whole or as the parts for a builder."""
    return model if isinstance(model, str) else "".join(BUILDERS[name](**parts) for name, parts in model.items())


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case['rule']} {case['findings'][:1]}"[:60])
def test_a_rule_finds_what_it_is_for_and_nothing_in_a_correct_model(case: dict[str, Any]) -> None:
    for name, text in case.get("files", {}).items():
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_text(text)
    findings = [f for f in lint(built(case["model"])) if case.get("alone") or f.code == case["rule"]]
    expected = case["findings"]
    assert [(f.code, f.file, f.line) for f in findings] == [
        (case["rule"], each.get("file", "model.xml"), each["line"]) for each in expected
    ]
    for finding, each in zip(findings, expected, strict=True):
        assert each["message"] in finding.message
        assert finding.severity in SEVERITIES
        assert finding.remedy
        assert finding.remedy == each.get("remedy", finding.remedy)
    assert case["rule"] not in [finding.code for finding in lint(built(case.get("good", FINE)))]


# Rules that only a process, a simulation, a task or several files can violate, which have tests elsewhere.
ELSEWHERE = {
    "MJ001",
    "MJ002",
    "MJ003",
    "MJ004",
    "MJ005",
    "MJ006",
    "MJ007",
    "MJ113",
    "MJ115",
    *("MJ116", "MJ117", "MJ118"),
    *simulation.CODES,
}


def test_every_other_rule_has_a_case() -> None:
    assert {case["rule"] for case in CASES} == {code for code in RULES if not code.startswith("MJ8")} - ELSEWHERE
    modules = ("mjrun.check.rules.bodies", "mjrun.check.rules.style")
    assert {RULES[code].violations.__module__ for code in ("MJ203", "MJ201")} == set(modules)
