"""Scripts of the repository."""

import gzip
import re
import runpy
import sys
from pathlib import Path

import pytest

from mjrun.check.rule_runner import RULES
from mjrun.outputs.exports.html import VIEWER
from tests.conftest import Command

sys.path.append(str(Path(__file__).parents[2]))

import subprocess
import sys
import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from scripts import fix_gallery

SCRIPT = Path(__file__).parents[2] / "scripts" / "bundle_replay.py"


def test_the_viewer_is_made_from_its_present_source_and_has_the_licence_of_three() -> None:
    script = runpy.run_path(str(SCRIPT))
    notice = gzip.decompress((VIEWER / "viewer.js.gz").read_bytes()).decode().partition("*/")[0]
    assert f"sha256 {script['source_hash']()}\n" in notice, "run scripts/bundle_replay.py"
    assert (VIEWER / "LICENSE-three").read_text("utf-8").strip() in notice


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


ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
TEXTS = [*PROJECT["dependencies"], *(text for extra in PROJECT["optional-dependencies"].values() for text in extra)]
REQUIREMENTS = [each for each in map(Requirement, TEXTS) if each.name != "mjrun"]


def test_each_library_is_tested_at_its_bound() -> None:
    command = [sys.executable, str(ROOT / "scripts/lowest_versions.py")]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    lowest = {each.name: next(s.version for s in each.specifier if s.operator == ">=") for each in REQUIREMENTS}
    assert printed == sorted(f"{name}=={version}" for name, version in lowest.items())


def test_the_tests_of_the_lowest_versions_exist() -> None:
    paths = re.search(r"^LOWEST = ((?:.*\\\n)*.*)$", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)
    assert paths
    for path in paths[1].replace("\\\n", " ").split():
        assert (ROOT / path).exists(), path


def test_the_constraints_satisfy_every_requirement_and_have_hashes_but_no_address() -> None:
    text = (ROOT / "constraints.txt").read_text("utf-8")
    pins = re.findall(r"^([\w.-]+)==(\S+)((?: \\\n    --hash=sha256:[0-9a-f]{64})+)$", text, re.MULTILINE)
    assert len(pins) == len(re.findall(r"^\w", text, re.MULTILINE))
    versions = {canonicalize_name(name): version for name, version, _ in pins}
    for each in REQUIREMENTS:
        assert each.specifier.contains(versions[canonicalize_name(each.name)]), each
    assert "://" not in text
