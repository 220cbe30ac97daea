"""Theorems about checking models."""

from pathlib import Path

import pytest

from mjrun.check.check import Check, CheckResult, ModelResult, matching_codes
from mjrun.check.rule import Finding
from mjrun.check.rule_table import RULES
from mjrun.errors import UsageError
from tests.check.models import PASSIVE, checked, codes, write


def test_a_model_that_is_well_is_found_well() -> None:
    result = checked(write("fine.xml", PASSIVE.format("")))
    assert result == CheckResult((ModelResult("fine.xml", True, ()),), 0, 0)


def test_results_keep_the_order_given_however_many_are_looked_at_at_once() -> None:
    names = [f"{i}.xml" for i in range(6)]
    for name in names:
        write(name, PASSIVE.format('range="2 1"' if name in ("1.xml", "4.xml") else ""))
    one, many = checked(*names, jobs=1), checked(*names, jobs=4)
    assert one == many
    assert [model.model for model in many.models] == names
    assert [codes(model) for model in many.models] == [[], ["MJ302"], [], [], ["MJ302"], []]


def test_a_part_that_models_include_is_skipped_wherever_it_is_given() -> None:
    Path("parts").mkdir()
    part = write("parts/arm.xml", "<mujocoinclude/>")
    fine = write("fine.xml", PASSIVE.format(""))
    assert checked(part, fine) == CheckResult((ModelResult("fine.xml", True, ()),), 1, 0)
    assert checked(part) == CheckResult((), 1, 0)
    with pytest.raises(UsageError, match="no model to check"):
        checked("parts")


@pytest.mark.parametrize(
    ("fail_on", "code"),
    [("error", 0), ("warning", 1), ("note", 1)],
)
def test_the_answer_is_no_from_the_severity_asked_for_on(fail_on: str, code: int) -> None:
    assert checked(write("warned.xml", PASSIVE.format('range="2 1"')), fail_on=fail_on).code == code


def test_codes_are_chosen_by_their_beginnings() -> None:
    name = write("two.xml", PASSIVE.format('range="2 1"').replace("</worldbody>", "<camera/></worldbody>"))
    assert codes(checked(name).models[0]) == ["MJ201", "MJ302", "MJ601"]
    assert codes(checked(name, select=["mj3", "MJ201"]).models[0]) == ["MJ201", "MJ302"]
    assert codes(checked(name, ignore=["MJ2", "MJ601"]).models[0]) == ["MJ302"]
    assert codes(checked(name, select=["MJ3"], ignore=["MJ302"]).models[0]) == []


def test_what_keeps_a_model_from_loading_is_told_whatever_is_chosen() -> None:
    name = write("limit.xml", PASSIVE.format('limited="true"'))
    assert codes(checked(name, select=["MJ6"], ignore=["MJ3"]).models[0]) == ["MJ303"]


def test_all_codes_begin_with_nothing_short_of_a_letter() -> None:
    assert matching_codes(["MJ"]) == frozenset(RULES)
    assert matching_codes(["mj70"]) == {code for code in RULES if code.startswith("MJ70")}


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"select": ["MJ9"]}, "no code 'MJ9' (did you mean"),
        ({"ignore": [""]}, "ignore: '' is not a code, or how several begin"),
        ({"fail_on": "never"}, "fail_on: 'never' is not one of error, warning, note"),
        ({"steps": -1}, "steps: '-1' is not a whole number from 0 on"),
        ({"memory": 0}, "memory: '0' is not"),
        ({"timeout": 0.0}, "timeout: '0.0' is not"),
        ({"jobs": 0}, "jobs: '0' is not"),
    ],
)
def test_what_cannot_be_meant_is_refused(settings: dict, message: str) -> None:
    with pytest.raises(UsageError) as error:
        Check(["a.xml"], **settings)
    assert message in str(error.value)


def test_a_folder_without_models_is_refused(workplace: Path) -> None:
    with pytest.raises(UsageError, match="no model to check"):
        checked(str(workplace))


def test_counts_are_of_all_models() -> None:
    noted = Finding("MJ201", "note", "", "a.xml")
    result = CheckResult((ModelResult("a", True, (noted,)), ModelResult("b", True, (noted, noted))), 0, 0)
    assert (result.count("note"), result.count("error")) == (3, 0)
