"""The commands that messages name work where mjrun is installed; each was run by hand in such an environment."""

import shutil
import subprocess
import sys
import venv
from pathlib import Path

import pytest

from mjrun.platform import installation
from mjrun.platform.installation import as_root, install_command, pip
from tests.cases import cases

OURS = Path(sys.executable)


def test_an_activated_environment_has_its_pip(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(OURS.parent))
    assert install_command("mjrun[plot]") == "pip install 'mjrun[plot]'"
    assert install_command("torch") == "pip install torch"


def test_the_pip_of_another_python_is_not_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "pip").write_text("#!/bin/sh\n")
    (tmp_path / "pip").chmod(0o755)
    for folder in (tmp_path, tmp_path / "nowhere"):
        monkeypatch.setenv("PATH", str(folder))
        assert install_command("torch") == f"{OURS} -m pip install torch"


def test_the_command_installs_into_the_environment_of_the_process(tmp_path: Path) -> None:
    home = tmp_path / "my env"
    venv.create(home, with_pip=False, symlinks=True)
    program = home / "bin/python"
    paths = [str(Path(installation.__file__).parents[2]), *filter(lambda path: "site-packages" in path, sys.path)]
    code = f"import sys; sys.path += {paths}\nfrom mjrun.platform.installation import pip; print(pip('list'))"
    done = subprocess.run([program, "-S", "-c", code], env={}, capture_output=True, text=True, check=True)
    assert done.stdout == f"'{program}' -m pip list\n"


@cases("prefix, file, extra, library")
def test_tools_install_into_their_own_environments(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, prefix: str, file: str, extra: str, library: str
) -> None:
    folder = tmp_path / prefix
    folder.mkdir(parents=True)
    (folder / file).touch()
    monkeypatch.setattr(sys, "prefix", str(folder))
    assert install_command("mjrun[plot]") == extra
    assert install_command("torch") == library


def test_an_environment_without_pip_is_that_of_uv(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.machinery.PathFinder.find_spec", lambda name: None)
    assert pip("install") == f"uv pip install --python {sys.prefix}"


@pytest.mark.parametrize(
    ("user", "sudo", "command"),
    [
        (0, "/usr/bin/sudo", "apt-get update && apt-get install libegl1"),
        (1000, "/usr/bin/sudo", "sudo apt-get update && sudo apt-get install libegl1"),
        (1000, None, "as root: apt-get update && apt-get install libegl1"),
    ],
)
def test_packages_of_the_system_are_installed_by_root(
    monkeypatch: pytest.MonkeyPatch, user: int, sudo: str | None, command: str
) -> None:
    monkeypatch.setattr(installation.system, "effective_user", lambda: user)
    monkeypatch.setattr(shutil, "which", lambda name: sudo)
    assert as_root("apt-get update && apt-get install libegl1") == command
