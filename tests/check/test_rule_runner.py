"""Theorems about the rules together, and about their explanations: complete, with examples that do what they say."""

import re
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from types import ModuleType

import mujoco
import pytest

import mjrun.check.rules
from mjrun.check.finding import MAX_OBJECTS, Finding
from mjrun.check.rule import Rule
from mjrun.check.rule_catalogue import TOPICS, described, explanation, topic
from mjrun.check.rule_runner import MAX_FINDINGS, RULES, capped, explain
from mjrun.errors import ModelError, UnknownNameError, flag, option, spelled
from mjrun.model.xml_source import read_xml
from tests.check import tasks
from tests.check.fixes import fixed
from tests.check.models import MESH, ROOT, checked, codes, lint, lint_file, mjcf, write


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


SECTIONS = ["Why it matters", "What to do", "Fix", "Thresholds", "Example", "When to ignore it", "See also"]
OPTIONAL = {"See also"}
# Errors of MuJoCo while stepping, and bugs of single versions, are not reproducible by a small model.
WITHOUT_EXAMPLE = {"MJ704", "MJ705"}
BY_PROCESS = re.compile("MJ006|MJ115|MJ7")  # found only by the process that checks a model
FENCE = re.compile(r"^```(\w+)\n(.*?)^```", re.DOTALL | re.MULTILINE)
MANUAL = Path(mujoco.__file__).parent / "doc"
LINK = re.compile(r"\(https://mujoco\.readthedocs\.io/en/stable/([\w/]+)\.html(?:#([\w-]+))?\)")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("meshes").mkdir()
    write("meshes/hull.obj", MESH)


def found(code: str, language: str, text: str) -> list[str]:
    """The codes of the findings in an example."""
    if language == "yaml":
        return [finding.code for finding in tasks.checked(head=text)]
    if BY_PROCESS.match(code):
        return codes(checked(write("model.xml", text)).models[0])
    return [finding.code for finding in lint(text)]


def test_an_explanation_has_every_section_in_order() -> None:
    for code, rule in RULES.items():
        beginning, *parts = re.split(r"^## ", explanation(code), flags=re.MULTILINE)
        texts = dict(part.split("\n", 1) for part in parts)
        optional = OPTIONAL | (set() if rule.fix else {"Fix"}) | (set() if [*described(code)] else {"Thresholds"})
        assert ("Fix" in texts) == bool(rule.fix), code
        omitted = optional | ({"Example"} if code in WITHOUT_EXAMPLE else set())
        assert [name for name in SECTIONS if name in texts or name not in omitted] == list(texts), code
        assert beginning.strip().endswith("."), code
        assert all(text.strip() for text in texts.values()), code


@pytest.mark.parametrize("code", sorted(RULES.keys() - WITHOUT_EXAMPLE))
def test_the_rule_finds_its_example_and_nothing_in_the_corrected_one(code: str) -> None:
    examples = FENCE.findall(explanation(code))
    if examples[0][0] == "console":
        assert all(text.startswith("$ mjrun check ") for _, text in examples)
        return

    before, after = examples
    assert code in found(code, *before)
    assert found(code, *after) == []


@pytest.mark.parametrize("code", sorted(code for code, rule in RULES.items() if rule.fix))
def test_the_fix_corrects_the_example(code: str) -> None:
    if code == "MJ506":
        pytest.importorskip("coacd")
    (language, before), (_, after) = FENCE.findall(explanation(code))
    if language == "console" or code == "MJ501":  # whose ball is inside the floor
        return
    if RULES[code].fix == "safe":
        assert fixed(before) == after
        return
    assert fixed(before) == before
    assert found(code, language, fixed(before, unsafe=True)) == []


def test_links_lead_to_places_in_the_manual_of_mujoco() -> None:
    for page, anchor in {link for code in RULES for link in LINK.findall(explanation(code))}:
        text = MANUAL.joinpath(f"{page}.rst").read_text("utf-8")
        anchors = [name.lower() for name in re.findall(r"^\.\. _([\w-]+):$", text, re.MULTILINE)]
        assert not anchor or anchor.lower() in anchors, f"{page}#{anchor}"


def test_every_rule_has_a_topic_and_every_topic_a_rule() -> None:
    assert {topic(code) for code in RULES} == set(TOPICS.values())


def test_an_unknown_rule_is_refused_with_similar_codes() -> None:
    with pytest.raises(UnknownNameError, match="no rule 'MJ999'"):
        explanation("MJ999")
