"""Theorems about objects without a name."""

import pytest

from tests.check.models import FINE, Case, lint, mjcf

CASES = [
    Case("MJ201", mjcf('<camera/><geom size="1"/>'), 4, "1 camera without a name: camera:0", FINE),
    Case("MJ201", FINE.replace('name="j"', "").replace('name="b"', ""), 5, "1 joint without a name", FINE),
]


@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_rule_finds_what_it_is_for_at_its_line_and_nothing_in_a_correct_model(case: Case) -> None:
    case.check()


def test_the_only_joint_of_a_named_body_needs_no_name() -> None:
    assert lint(FINE.replace(' name="j"', "")) == []
