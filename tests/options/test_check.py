"""Options of `mjrun check`."""

import re

from mjrun.check import rule
from mjrun.check.rule_runner import RULES
from mjrun.options.check import SEVERITIES, CheckOptions
from mjrun.options.option import options_of


def test_severities_are_those_of_findings() -> None:
    assert sorted(SEVERITIES) == sorted(rule.SEVERITIES)
    assert {rule.severity for rule in RULES.values()} <= set(SEVERITIES)


def test_codes_in_help_are_codes_of_rules() -> None:
    (select,) = (each for each in options_of(CheckOptions) if each.name == "select")
    codes = re.findall(r"MJ\d+", select.help)
    assert codes
    assert all(any(code.startswith(each) for code in RULES) for each in codes)
