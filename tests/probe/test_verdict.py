from dataclasses import asdict

import numpy as np

from mjrun.probe.assertion import parse


def test_a_verdict_says_in_plain_values_what_was_asserted_and_why_it_fails() -> None:
    checker = parse("max(x) < 2", ["x"]).checker()
    checker.feed(np.array([[1.0], [3.0]]), 0)
    verdict = asdict(checker.verdict())
    assert (verdict["text"], verdict["passed"]) == ("max(x) < 2", False)
    assert "it is 3, at row 1" in verdict["message"]
