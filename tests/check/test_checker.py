"""Theorems about what all checks have in common: messages, one on a line, the last of which says that all is done."""

import json
from io import StringIO

import pytest

from mjrun.check.checker import Checker
from mjrun.check.rules.process_failures import TIMEOUT
from mjrun.check.worker_pool import WorkerTask


class Failing(Checker):
    """Finds one thing, and fails then."""

    def __init__(self, error: Exception | None) -> None:
        super().__init__(WorkerTask("a.xml", [], 0, 60, 99999), StringIO())
        self.error = error

    def check(self) -> None:
        self.write(stage="looking")
        self.write_findings([TIMEOUT.in_model(self.path, "late\u2028")])
        if self.error:
            raise self.error

    def messages(self) -> list[dict]:
        self.run()
        assert isinstance(self.channel, StringIO)
        return [json.loads(line) for line in self.channel.getvalue().splitlines()]


def test_what_was_found_is_written_before_what_follows() -> None:
    stage, finding, done = Failing(None).messages()
    assert (stage, done) == ({"stage": "looking"}, {"done": True})
    assert finding["finding"]["message"] == "late\u2028"


def test_memory_that_runs_out_is_a_finding() -> None:
    found = [message["finding"]["code"] for message in Failing(MemoryError()).messages() if "finding" in message]
    assert found == ["MJ003", "MJ004"]


def test_any_other_fault_ends_the_process() -> None:
    with pytest.raises(ZeroDivisionError):
        Failing(ZeroDivisionError()).run()
