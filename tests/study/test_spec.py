"""What a process has simulated with is compared by versions, and code by its text."""

import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import pytest

from mjrun.model.sources import source_of
from mjrun.study.spec import Proof, code_hash, versions


def test_other_versions_are_named() -> None:
    here = Proof.here([source_of("scene:dominos")])
    assert here.versions["mujoco"] == mujoco.mj_versionString()
    assert here.difference(here) == ""
    other = replace(here, versions={**versions(), "mujoco": "3.9.9"}, host="elsewhere")
    assert other.difference(here) == f"mujoco 3.9.9 instead of {mujoco.mj_versionString()}"


def test_other_packages_of_an_environment_are_named() -> None:
    here = Proof.here([source_of("gym:Hopper-v5")])
    (name, code) = next(iter(here.environments.items()))
    other = replace(here, environments={name: f"{code}.dev1"})
    assert other.difference(here) == f"gym:Hopper-v5 {code}.dev1 instead of {code}"
    assert here.difference(Proof.here([])) == ""  # of a model that this study does not ask about


def test_the_hash_of_code_is_of_the_modules_that_it_imports_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    helper = tmp_path / "gains_of_a_test.py"
    helper.write_text("KP = 1")
    (tmp_path / "control_of_a_test.py").write_text(
        "import math\nfrom gains_of_a_test import KP\ndef act(model, data): return KP\n"
    )
    import control_of_a_test  # type: ignore[import-not-found]

    act = control_of_a_test.act
    before = code_hash([act])
    assert before == code_hash([act]) == code_hash([act, act])
    helper.write_text("KP = 2")
    assert code_hash([act]) != before
    assert code_hash([]) == code_hash([print]) == code_hash([Path]) == ""
    del sys.modules["control_of_a_test"], sys.modules["gains_of_a_test"]
