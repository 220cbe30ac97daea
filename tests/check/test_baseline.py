"""Baselines: known findings stay silent, wherever they move to, and every other one is reported."""

import json
from contextlib import nullcontext
from pathlib import Path

import pytest

from mjrun.check.baseline import Baseline, write_baseline
from mjrun.check.check import CheckResult
from mjrun.check.finding import Finding
from mjrun.errors import FileError, UsageError
from tests.check.models import checked, codes, lint, write

MODEL = """<mujoco>
<worldbody>
<body name="a"><joint name="a" type="slide" range="2 1"/><geom size="1"/></body>
</worldbody>
</mujoco>"""
SECOND = '<body name="b" pos="9 0 0"><joint name="b" type="slide" range="4 3"/><geom size="1"/></body>'


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write("model.xml", MODEL)


def check(*models: str, baseline: str = "known.json", **options: object) -> CheckResult:
    return checked(*(models or ("model.xml",)), steps=0, fail_on="warning", baseline=baseline, **options)


def test_only_new_findings_are_reported_and_decide_the_exit_code() -> None:
    assert checked("model.xml", steps=0, fail_on="warning").code == 1
    updated = check(update_baseline=True)
    assert (updated.code, updated.models[0].known, updated.warnings) == (0, 1, 0)

    again = check()
    assert (again.code, again.models[0].known, again.gone) == (0, 1, 0)

    write("model.xml", MODEL.replace("</worldbody>", f"{SECOND}</worldbody>"))
    (finding,) = check().models[0].findings
    assert finding.object == "joint 'b'"
    assert check().code == 1


@pytest.mark.parametrize(
    ("edit", "remains_known"),
    [
        (("<worldbody>", "<worldbody>\n\n\n"), True),
        (('range="2 1"', 'range="2.5 1.25"'), True),
        (('joint name="a"', 'joint name="other"'), False),
        (('range="2 1"', 'range="3 4"'), False),
    ],
)
def test_a_finding_is_known_without_its_line_and_its_numbers(edit: tuple[str, str], remains_known: bool) -> None:
    check(update_baseline=True)
    write("model.xml", MODEL.replace(*edit))
    result = check()
    assert result.models[0].known == remains_known
    assert result.gone == (not remains_known)


def many(*names: str) -> str:
    """A model with the joints `names`, whose ranges are reversed."""
    body = '<body pos="{} 0 0"><joint name="{}" type="slide" range="2 1"/><geom size="1"/></body>'
    return (
        f"<mujoco><worldbody>{''.join(body.format(9 * i, name) for i, name in enumerate(names))}</worldbody></mujoco>"
    )


FEWER = [
    ("a1 a2 a3", "a1 a2 a3", True),
    ("a1 a2 a3", "a2 a3", True),
    ("a1 a2 a3", "a3", True),
    ("a1 a2", "a1 a2 a3", False),
    ("a1 a2 a3", "a1 a4", False),
    ("a b c d e f g h", "b c d e f g h", True),
    ("a b c d e f g h", "a b c d e f g h i", False),
    ("a b c d e f g h", "a b c d e f g other", False),
]


def test_a_finding_about_fewer_objects_is_known() -> None:
    for before, after, remains_known in FEWER:
        write_baseline(Path("known.json"), lint(many(*before.split())))
        (finding,) = lint(many(*after.split()))
        assert Baseline.read(Path("known.json")).new([finding]) == (() if remains_known else (finding,)), after


def test_objects_without_names_are_known_when_others_are_added_before_them() -> None:
    geom = '<geom size="1" pos="9 0 {}" class="{}"/>'
    hidden = '<default><default class="a"><geom mass="0"/></default><default class="b"/></default>'

    def model(*classes: str) -> str:
        geoms = "".join(geom.format(9 * i, name) for i, name in enumerate(classes))
        return f'<mujoco>{hidden}<worldbody><body name="t"><freejoint/>{geoms}</body></worldbody></mujoco>'

    write("model.xml", model("b", "a"))
    check(update_baseline=True, select="MJ203")
    write("model.xml", model("b", "b", "a"))
    assert check(select="MJ203", baseline="known.json").models[0].known == 1
    write("model.xml", model("b", "a", "a"))
    assert check(select="MJ203", baseline="known.json").models[0].known == 0


def test_as_many_findings_are_known_as_there_were() -> None:
    finding = Finding("MJ501", "warning", "it penetrates by 0.2 m", "model.xml", 3, "geom 'g'")
    write_baseline(Path("known.json"), [finding, finding])
    baseline = Baseline.read(Path("known.json"))
    assert baseline.new([finding] * 3) == (finding,)
    assert json.loads(Path("known.json").read_text())["findings"][0]["count"] == 2


def test_paths_are_relative_to_the_baseline(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    check(update_baseline=True)
    Path("sub").mkdir()
    monkeypatch.chdir("sub")
    assert check("../model.xml", baseline="../known.json").models[0].known == 1


def test_a_model_that_is_known_not_to_load_does_not_fail() -> None:
    write("broken.xml", MODEL.replace("<geom", "<goem"))
    assert check("model.xml", "broken.xml", update_baseline=True).code == 0
    assert check("broken.xml").code == 0
    write("broken.xml", MODEL.replace("<geom", "<goem").replace("<joint", "<jiont"))
    assert check("broken.xml").code == 3


def test_findings_of_other_models_and_rules_are_not_called_gone() -> None:
    write("other.xml", MODEL)
    check("model.xml", "other.xml", update_baseline=True)
    write("model.xml", MODEL.replace('range="2 1"', 'range="1 2"'))
    assert check("other.xml").gone == 0
    assert check("model.xml", select="MJ5").gone == 0
    assert check("model.xml").gone == 1


ENDLESS = '{"file": "a", "rule": "b", "message": "c", "objects": [], "count": 1e999}'


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{}",
        "[1]",
        '{"schema": "mjrun-baseline-1", "findings": [{}]}',
        f'{{"schema": "mjrun-baseline-1", "findings": [{ENDLESS}]}}',
        "[" * 100_000,
    ],
)
def test_a_file_that_is_no_baseline_is_refused_before_any_model_is_checked(text: str) -> None:
    write("known.json", text)
    with pytest.raises(FileError, match=r"known\.json: is not a baseline of mjrun check"):
        checked("missing.xml", baseline="known.json")


@pytest.mark.parametrize("text", [MODEL, "{}", "", '{"schema": "mjrun-baseline-0"}'])
def test_only_a_baseline_is_replaced(text: str) -> None:
    write("known.json", text)
    is_other = text in (MODEL, "{}")
    refused = pytest.raises(FileError, match=r"is not a baseline of mjrun check, and is not replaced")
    with refused if is_other else nullcontext():
        check(update_baseline=True)
    assert (Path("known.json").read_text() == text) == is_other


def test_a_missing_baseline_is_refused() -> None:
    with pytest.raises(FileError, match="does not exist"):
        check()
    with pytest.raises(UsageError, match="requires"):
        checked("model.xml", update_baseline=True)


def test_severities_and_ignored_files_change_what_is_reported() -> None:
    assert (
        checked("model.xml", severity={"MJ3": "warning", "MJ302": "note"}, steps=0).models[0].findings[0].severity
        == "note"
    )
    assert codes(checked("model.xml", ignore_in={"*.xml": "MJ301,MJ302"}, steps=0).models[0]) == []
    assert codes(checked("model.xml", ignore_in={"other/*": "MJ3"}, steps=0).models[0]) == ["MJ302"]
