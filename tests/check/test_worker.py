"""Theorems about checking one model."""

import json
from collections.abc import Iterator
from dataclasses import replace
from io import StringIO

import pytest

from mjrun.check.context import LintContext
from mjrun.check.rule import Violation
from mjrun.check.rule_table import RULES
from mjrun.check.worker import ModelChecker
from mjrun.check.worker_pool import WorkerTask
from tests.check.models import PASSIVE, write


def test_a_fault_of_a_rule_is_a_finding_and_the_other_rules_look_on(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def broken(context: LintContext) -> Iterator[Violation]:
        raise ZeroDivisionError("planted")

    monkeypatch.setitem(RULES, "MJ201", replace(RULES["MJ201"], violations=broken))
    channel = StringIO()
    ModelChecker(
        WorkerTask(write("a.xml", PASSIVE.format('range="2 1"')), ["MJ201", "MJ302"], 0, 60, 9999), channel
    ).run()
    messages = [json.loads(line) for line in channel.getvalue().splitlines()]
    findings = [message["finding"] for message in messages if "finding" in message]
    assert [finding["code"] for finding in findings] == ["MJ005", "MJ302"]
    assert findings[0]["message"] == "the rule MJ201 fails: ZeroDivisionError: planted"
    assert messages[-1] == {"done": True}
