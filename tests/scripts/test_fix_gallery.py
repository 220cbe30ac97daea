"""The page of fixes has each rule that can be fixed, and what it shows is what `--fix` does."""

import re
import sys
from pathlib import Path

import pytest

from mjrun.check.rule_runner import RULES
from tests.conftest import Command

sys.path.append(str(Path(__file__).parents[2]))

from scripts import fix_gallery


def test_every_rule_with_a_fix_has_a_part() -> None:
    shown = re.findall(r"(?m)^## (MJ\d+): (.+)$", fix_gallery.PAGE.read_text("utf-8"))
    expected = {code: rule.title for code, rule in RULES.items() if rule.fix}
    assert dict(shown) == expected
    assert [case.rule for case in fix_gallery.CASES] == sorted(expected)


@pytest.mark.parametrize("rule", ["MJ303", "MJ403"])
def test_a_part_is_what_the_command_does_now(rule: str, mjrun_here: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fix_gallery, "mjrun", lambda *arguments: mjrun_here(*arguments).stdout.decode())
    (case,) = (case for case in fix_gallery.CASES if case.rule == rule)
    assert fix_gallery.part(case).strip() in fix_gallery.PAGE.read_text("utf-8")
