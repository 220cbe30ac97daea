"""Theorems about models that have changed since a commit."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from mjrun.check.baseline import ChangedModels
from mjrun.check.check import ModelCheck
from mjrun.errors import UsageError
from tests.check.models import MESH, hinged, mjcf, write

pytestmark = pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
MODELS = ["meshed.xml", "including.xml", "plain.xml"]


def git(*arguments: str) -> None:
    settings = ("-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false")
    subprocess.run(["git", *settings, *arguments], check=True, capture_output=True)


@pytest.fixture(autouse=True)
def repository(workplace: Path) -> Path:
    """A repository in a subfolder, with a model that has a mesh, one that includes a part, and a plain one."""
    (workplace / "repo" / "models" / "sub").mkdir(parents=True)
    os.chdir(workplace / "repo" / "models")
    write("sub/mesh ü.obj", MESH)
    write("part.xml", "<mujocoinclude/>")
    write("meshed.xml", mjcf(before='<asset><mesh name="m" file="sub/mesh ü.obj"/></asset>'))
    write("including.xml", mjcf('<include file="part.xml"/>'))
    write("plain.xml", hinged())
    write(".gitignore", "ignored*")
    git("init", "--quiet", "--initial-branch=main", "..")
    git("add", ".")
    git("commit", "--quiet", "--message=first")
    return workplace / "repo"


def changed(ref: str = "main") -> list[str]:
    return ChangedModels(ref).of(MODELS)


def test_a_model_changes_with_its_files_wherever_and_however_they_change() -> None:
    assert changed() == []
    write("sub/mesh ü.obj", MESH + "#")
    assert changed() == ["meshed.xml"]
    Path("sub/mesh ü.obj").unlink()
    assert changed() == ["meshed.xml"]
    git("checkout", "--quiet", ".")
    write("part.xml", "<mujocoinclude> </mujocoinclude>")
    git("commit", "--quiet", "--all", "--message=second")
    assert changed() == []
    assert changed("HEAD~1") == ["including.xml"]


def test_a_program_that_observes_the_files_of_a_repository_is_not_run(repository: Path) -> None:
    monitor = repository / "monitor.sh"
    monitor.write_text(f"#!/bin/sh\ntouch '{repository}/ran'\n")
    monitor.chmod(0o755)
    git("config", "core.fsmonitor", str(monitor))
    write("plain.xml", hinged() + "\n")
    assert changed() == ["plain.xml"]
    assert not (repository / "ran").exists()


def test_files_that_git_does_not_know_count_unless_it_ignores_them() -> None:
    for name in ("new.xml", "ignored.xml"):
        write(name, hinged())
    assert ChangedModels("main").of(["ignored.xml", "new.xml"]) == ["new.xml"]


def test_changes_of_the_other_branch_do_not_count() -> None:
    git("checkout", "--quiet", "-b", "work")
    git("checkout", "--quiet", "main")
    write("plain.xml", mjcf())
    git("commit", "--quiet", "--all", "--message=theirs")
    git("checkout", "--quiet", "work")
    write("meshed.xml", mjcf())
    assert changed() == ["meshed.xml"]


@pytest.mark.skipif(os.name == "nt", reason="needs links")
def test_a_model_changes_with_the_target_of_a_link() -> None:
    Path("linked.xml").symlink_to("plain.xml")
    git("add", ".")
    git("commit", "--quiet", "--message=link")
    write("plain.xml", mjcf())
    assert ChangedModels("main").of(["linked.xml"]) == ["linked.xml"]


def test_models_that_have_not_changed_are_counted_and_not_checked() -> None:
    result = ModelCheck(["."], changed_since="main").run()
    assert (result.models, result.unchanged, result.code) == ((), 3, 0)


def test_what_git_does_not_know_is_refused(repository: Path) -> None:
    with pytest.raises(UsageError, match="'nowhere' is not a branch, tag or commit"):
        changed("nowhere")
    with pytest.raises(UsageError, match="is not a branch"):
        changed("--help")
    write("../../outside.xml", mjcf())
    with pytest.raises(UsageError, match=r"outside\.xml is not in the repository"):
        ChangedModels("main").of(["../../outside.xml"])
    os.chdir(repository.parent)
    with pytest.raises(UsageError, match="requires a git repository"):
        changed()
