"""Theorems about the rules together."""

from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from types import ModuleType

import mjrun.check.rules
from mjrun.check.rule import MAX_OBJECTS, Finding, Rule
from mjrun.check.rule_table import MAX_FINDINGS, RULES, capped, explain
from mjrun.errors import ModelError, flag, option, spelled
from mjrun.model.xml_source import read_xml
from tests.check.models import ROOT, lint, lint_file, mjcf


def modules(package: ModuleType) -> list[ModuleType]:
    return [import_module(f"{package.__name__}.{module.name}") for module in iter_modules(package.__path__)]


def test_no_two_rules_share_a_code_and_titles_name_no_options() -> None:
    rules = {
        value for module in modules(mjrun.check.rules) for value in vars(module).values() if isinstance(value, Rule)
    }
    assert rules == set(RULES.values())
    assert list(RULES) == sorted(rule.code for rule in rules)
    assert not any("--" in rule.title for rule in rules)


def test_options_in_the_reason_why_a_model_does_not_load_can_still_be_spelled() -> None:
    source = read_xml(Path("model.xml"))
    (finding,) = explain(ModelError(f"model.xml: out of reach\n{option('root')} sets the folder"), source)
    assert (finding.message, spelled(finding.remedy, flag)) == ("out of reach", "--root sets the folder")


def test_scenes_of_mjrun_hold_no_errors() -> None:
    for scene in sorted((ROOT / "scenes").glob("*.xml")):
        assert [finding for finding in lint_file(scene) if finding.severity == "error"] == [], scene


def test_what_is_replicated_is_told_once_at_the_line_that_says_it() -> None:
    body = '<body name="b"><joint name="j" range="2 1"/><geom size="1"/></body>'
    findings = lint(mjcf(f'<replicate count="5" offset="0 0 3">\n{body}</replicate>'))
    assert [(f.code, f.line) for f in findings] == [("MJ302", 5)]
    assert findings[0].text.endswith("(and 4 more: joint 'j1', joint 'j2', joint 'j3', joint 'j4')")


def test_findings_that_say_the_same_of_several_objects_are_one_with_their_names() -> None:
    feet = [Finding("MJ203", "note", "it has no mass", "a.xml", line, f"geom '{line}'") for line in range(1, 9)]
    (merged,) = capped(feet)
    names = ", ".join(f"geom '{line}'" for line in range(2, 2 + MAX_OBJECTS))
    assert (merged.line, merged.object) == (1, "geom '1'")
    assert merged.text == f"it has no mass (and 7 more: {names}, …)"

    (unnamed,) = capped([Finding("MJ115", "warning", "it warns", "a.xml")] * 3)
    assert unnamed.text == "it warns (and 2 more like it)"
    other_file = [feet[0], Finding("MJ203", "note", "it has no mass", "b.xml", 1, "geom '1'")]
    assert capped(other_file) == other_file


def test_findings_of_one_code_are_counted_when_there_are_many() -> None:
    many = [Finding("MJ301", "note", f"number {i}", "a.xml") for i in range(MAX_FINDINGS + 5)]
    shown = capped(many)
    assert shown[:-1] == many[: MAX_FINDINGS - 1]
    assert shown[-1].message == "… and 6 more like it"
    assert capped(many[:MAX_FINDINGS]) == many[:MAX_FINDINGS]
