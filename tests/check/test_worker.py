"""Theorems about checking one model: messages, the last of which reports that the check is complete."""

from collections.abc import Iterator
from dataclasses import replace

import pytest

from mjrun.check.context import CheckContext
from mjrun.check.finding import Violation
from mjrun.check.rule_runner import RULES
from mjrun.check.rules.check_itself import TIMEOUT
from mjrun.check.worker import Checker, ModelChecker
from mjrun.check.worker_pool import CheckRequest
from tests.check.models import PASSIVE, write
from tests.processes import memory_limit_restored


class Failing(Checker):
    """Finds one thing, and fails then."""

    def __init__(self, error: Exception | None) -> None:
        self.messages: list[dict] = []
        super().__init__(CheckRequest("a.xml", [], 0, 60, 99999), self.messages.append)
        self.error = error

    def check(self) -> None:
        self.write(stage="looking")
        self.write_findings([TIMEOUT.in_model(self.path, "late\u2028")])
        if self.error:
            raise self.error

    def ran(self) -> list[dict]:
        self.run()
        return self.messages


def test_what_was_found_is_written_before_what_follows() -> None:
    stage, finding, done = Failing(None).ran()
    assert (stage, done) == ({"stage": "looking"}, {"done": True})
    assert finding["finding"]["message"] == "late\u2028"


def test_memory_that_runs_out_is_a_finding() -> None:
    found = [message["finding"]["code"] for message in Failing(MemoryError()).ran() if "finding" in message]
    assert found == ["MJ003", "MJ004"]


def test_any_other_fault_ends_the_process() -> None:
    with pytest.raises(ZeroDivisionError):
        Failing(ZeroDivisionError()).run()


def test_a_fault_of_a_rule_is_a_finding_and_the_other_rules_look_on(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def broken(context: CheckContext) -> Iterator[Violation]:
        raise ZeroDivisionError("planted")

    monkeypatch.setitem(RULES, "MJ201", replace(RULES["MJ201"], violations=broken))
    messages: list[dict] = []
    task = CheckRequest(write("a.xml", PASSIVE.format('range="2 1"')), ["MJ201", "MJ302"], 0, 60, 9999)
    with memory_limit_restored():
        ModelChecker(task, messages.append).run()
    findings = [message["finding"] for message in messages if "finding" in message]
    assert [finding["code"] for finding in findings] == ["MJ005", "MJ302"]
    assert findings[0]["message"] == "the rule MJ201 fails: ZeroDivisionError: planted"
    assert messages[-1] == {"done": True}
