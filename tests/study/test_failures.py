"""What is told of failures: the first of each reason when it comes, all of them at the end."""

import math

from mjrun.study.design import Design
from mjrun.study.failures import TOLD, FailureNotes, point_failures
from mjrun.study.simulate import PointResult, Status

POINTS = Design(("seed", "geom/a.size"), [(str(i), f"0.{i}") for i in range(30)])


class Notes:
    def __init__(self) -> None:
        self.lines: list[str] = []

    def note(self, text: str) -> None:
        self.lines.append(text)

    ask = note

    def warn(self, text: str) -> None:
        raise AssertionError

    def progress(self, what: str, done: int, total: int) -> None:
        raise AssertionError


def result(index: int, status: Status, message: str = "") -> PointResult:
    return PointResult(index, status, (math.nan,), 0, 1, message)


def test_the_first_of_each_reason_is_told() -> None:
    notes = Notes()
    failures = FailureNotes(POINTS, notes)
    failures.add([result(0, "ok"), result(4, "unstable", "unstable at step 3"), result(1, "failed", "no\nsuch")])
    failures.add([result(2, "unstable", "unstable at step 9"), result(3, "failed", "no\nother"), result(5, "crashed")])
    assert notes.lines == [
        "point 4 (seed=4, geom/a.size=0.4): unstable at step 3",
        "point 1 (seed=1, geom/a.size=0.1): no",
        "point 5 (seed=5, geom/a.size=0.5): ",
    ]


def test_many_reasons_are_cut() -> None:
    notes = Notes()
    failures = FailureNotes(POINTS, notes, range(100, 130))
    for index in range(30):
        failures.add([result(index, "failed", f"reason {index}")])
    assert len(notes.lines) == TOLD + 1
    assert notes.lines[0] == "point 100 (seed=0, geom/a.size=0.0): reason 0"
    assert notes.lines[-1] == "points fail for more reasons; the table has all"


def test_failures_are_counted_by_reason_the_most_frequent_first() -> None:
    results = [result(i, "failed", "one") for i in range(2)] + [result(i, "unstable", f"at {i}") for i in range(2, 5)]
    found = point_failures(POINTS, results)
    assert [(each.status, each.message, each.count, each.point) for each in found] == [
        ("unstable", "at 2", 3, 2), ("failed", "one", 2, 0),
    ]  # fmt: skip
    assert found[0].values == {"seed": "2", "geom/a.size": "0.2"}
