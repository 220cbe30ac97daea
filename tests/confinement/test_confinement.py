"""What a confined process may name, and how it is told; confinement itself is tried in test_sandbox.py."""

import itertools
import json
import os
from dataclasses import asdict
from pathlib import Path

import pytest

from mjrun.confinement.confinement import (
    VARIABLE,
    Confinement,
    confinement,
    depends_on_processes,
    is_readable,
    is_writable,
    require_unconfined,
)
from mjrun.errors import UsageError
from tests.cases import cases


@pytest.fixture
def limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Confinement:
    for folder in ("model", "named", "out"):
        (tmp_path / folder).mkdir()
    places = {name: (str(tmp_path / name),) for name in ("model", "named", "out")}
    made = Confinement(places["model"], places["named"], places["out"])
    monkeypatch.setenv(VARIABLE, json.dumps(asdict(made)))
    return made


def test_nothing_is_confined_unless_somebody_asks(tmp_path: Path) -> None:
    assert confinement() is None
    assert is_readable("/etc/passwd")
    assert is_writable(tmp_path)
    require_unconfined("code")


def test_it_comes_back_from_the_environment(limits: Confinement) -> None:
    assert confinement() == limits


@cases("path, readable")
@pytest.mark.usefixtures("limits")
def test_paths_are_judged_by_where_they_lead(tmp_path: Path, path: str, readable: bool) -> None:
    (tmp_path / "model/link").symlink_to(tmp_path / "secret")
    (tmp_path / "model/inner").symlink_to(tmp_path / "model")
    assert is_readable(tmp_path / path) is readable


def test_paths_lead_where_the_system_says(tmp_path: Path) -> None:
    """All paths of three names, here and below `a`, lead where `os.path.realpath` comes to; links are of every kind."""
    (tmp_path / "a/b").mkdir(parents=True)
    (tmp_path / "file").write_text("")
    links = {"up": "..", "far": str(tmp_path), "a/near": "b/../b", "a/gone": "missing/x", "a/b/chain": "../near/.."}
    for name, target in links.items():
        (tmp_path / name).symlink_to(target)
    names = ("a", "b", "..", "file", "up", "far", "near", "gone", "chain", "", ".")
    for parts in itertools.product((str(tmp_path), f"{tmp_path}/a"), names, names, names):
        path = "/".join(parts)
        assert Confinement((os.path.realpath(path),)).allows(path), path
        assert not Confinement((f"{os.path.realpath(path)}/below",)).allows(path), path


def test_circles_of_links_and_what_is_no_path_lead_nowhere(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    everywhere = Confinement(("/",))
    assert not everywhere.allows(tmp_path / "a/x")
    assert everywhere.allows("\0")  # which no file can be called: opening it tells


@pytest.mark.skipif(not Path("/proc/self/root").exists(), reason="there is no /proc")
def test_links_of_processes_are_not_followed(tmp_path: Path) -> None:
    (tmp_path / "inside").mkdir()
    (tmp_path / "inside/link").symlink_to(f"/proc/self/root{tmp_path}/inside")
    limits = Confinement((str(tmp_path / "inside"),))
    assert limits.allows(tmp_path / "inside/x")
    for path in (f"/proc/self/root{tmp_path}/inside/x", f"/proc/1/root{tmp_path}/inside/x", "inside/link/x"):
        assert not limits.allows(tmp_path / path)
        assert depends_on_processes(tmp_path / path)
    assert not depends_on_processes(tmp_path / "inside/x")
    assert not depends_on_processes("/process")


@pytest.mark.usefixtures("limits")
def test_outputs_are_written_in_their_folders_alone(tmp_path: Path) -> None:
    assert is_writable(tmp_path / "out/a.csv")
    assert not is_writable(tmp_path / "model/a.csv")
    assert not is_writable(tmp_path / "out/../a.csv")


@pytest.mark.usefixtures("limits")
def test_code_is_refused_by_the_name_of_the_option() -> None:
    with pytest.raises(UsageError, match=r"^x\.py:f is code, which untrusted does not allow$"):
        require_unconfined("x.py:f is code")
