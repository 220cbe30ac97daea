"""The lowest versions that are tested are the bounds of pyproject.toml, and constraints.txt satisfies all of them."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

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
