"""Explanations of rules: complete, with examples that do what they say and links that lead somewhere."""

import re
from pathlib import Path

import mujoco
import pytest

from mjrun.check.catalogue import TOPICS, described, explanation, topic
from mjrun.check.rule_table import RULES
from mjrun.errors import UnknownNameError
from tests.check import tasks
from tests.check.fixes import fixed
from tests.check.models import MESH, checked, codes, lint, write

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
