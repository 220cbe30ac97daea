"""Options of `mjrun check`."""

import re

import pytest

from mjrun.check import rule
from mjrun.check.rule_table import RULES
from mjrun.errors import BadValueError, UsageError
from mjrun.options.check import SEVERITIES, CheckOptions, CheckReportOptions
from mjrun.options.option import options_of


def test_severities_are_those_of_findings() -> None:
    assert sorted(SEVERITIES) == sorted(rule.SEVERITIES)
    assert {rule.severity for rule in RULES.values()} <= set(SEVERITIES)


def test_codes_in_help_are_codes_of_rules() -> None:
    (select,) = (each for each in options_of(CheckOptions) if each.name == "select")
    codes = re.findall(r"MJ\d+", select.help)
    assert codes
    assert all(any(code.startswith(each) for code in RULES) for each in codes)


def test_codes_are_a_list_and_memory_is_positive() -> None:
    assert CheckOptions(select="MJ1, MJ301").select == ("MJ1", "MJ301")
    with pytest.raises(BadValueError, match=r"^memory: '0' is not a whole number from 1 on"):
        CheckOptions(memory=0)


def test_one_report_goes_to_standard_output() -> None:
    with pytest.raises(UsageError, match=r"^sarif and github exclude each other"):
        CheckReportOptions(sarif=True, github=True)
