"""Defaults of `mjrun check` in configuration files: the nearest applies, the command line takes precedence."""

from pathlib import Path

import pytest

from mjrun.cli.commands.check import configured
from mjrun.errors import FileError
from tests.cases import cases


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Path(tmp_path, "sub").mkdir()
    monkeypatch.chdir(tmp_path)


def test_the_nearest_file_with_a_section_applies(monkeypatch: pytest.MonkeyPatch) -> None:
    Path("pyproject.toml").write_text('[tool.mjrun.check]\nselect = ["MJ3", "MJ5"]\nfail-on = "warning"\n')
    assert configured(None) == {"select": ("MJ3", "MJ5"), "fail_on": "warning"}

    monkeypatch.chdir("sub")
    Path("pyproject.toml").write_text("[tool.other]\n")
    assert configured(None)["fail_on"] == "warning"
    Path("mjrun.toml").write_text("[check]\nsteps = 5\n")
    assert configured(None) == {"steps": 5}
    assert configured("../pyproject.toml")["fail_on"] == "warning"


def test_paths_and_patterns_are_relative_to_the_file(monkeypatch: pytest.MonkeyPatch) -> None:
    Path("mjrun.toml").write_text('[check]\nbaseline = "known.json"\n[check.ignore-in]\n"parts/*" = ["MJ2", "MJ301"]\n')
    monkeypatch.chdir("sub")
    assert configured(None) == {"baseline": "../known.json", "ignore_in": (("../parts/*", "MJ2,MJ301"),)}


def test_a_baseline_is_inside_the_folder_of_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir("sub")
    Path("link.json").symlink_to("../known.json")
    for name in ("../known.json", str(tmp_path / "known.json"), "link.json"):
        Path("mjrun.toml").write_text(f'[check]\nbaseline = "{name}"\nupdate-baseline = true\n')
        with pytest.raises(FileError, match=r"mjrun\.toml: .*\.json is outside the folder of mjrun\.toml"):
            configured(None)


@cases("text, message")
def test_a_mistake_is_reported_with_its_file(text: str, message: str) -> None:
    Path("mjrun.toml").write_text(text)
    with pytest.raises(FileError, match=rf"mjrun\.toml: .*{message}"):
        configured(None)


def test_a_file_without_a_section_is_an_error_only_if_it_is_named() -> None:
    Path("pyproject.toml").write_text("[project]\nname = 'robot'\n")
    assert configured(None) == {}
    with pytest.raises(FileError, match="has no section"):
        configured("pyproject.toml")
