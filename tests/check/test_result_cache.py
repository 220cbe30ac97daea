"""Theorems about stored results: what is stored is what a new check finds, whatever changes in between."""

from dataclasses import replace
from pathlib import Path

import mujoco
import pytest

from mjrun.check import check
from mjrun.check.result_cache import ResultCache
from mjrun.check.rules.process_failures import TIMEOUT
from mjrun.check.worker_pool import CheckProcesses, WorkerOutput, WorkerTask
from mjrun.child_process import ExitStatus
from mjrun.formats.user_cache import VARIABLE
from tests.check.models import MESH, PASSIVE, checked, codes, mjcf, write

DONE = ({"loaded": True}, {"done": True})
TASK = WorkerTask("a.xml", ["MJ302"], 0, 60, 1024)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache for one test."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


def key(task: WorkerTask = TASK) -> str:
    return ResultCache({"mujoco": "4.0.0"}).key(task)


def write_assembly() -> str:
    """Writes a model with an include, which names a mesh, and with an attached model, which names another one."""
    Path("parts/meshes").mkdir(parents=True)
    write("parts/meshes/a.obj", MESH)
    write("b.obj", MESH)
    write("parts/arm.xml", '<mujocoinclude><asset><mesh name="a" file="parts/meshes/a.obj"/></asset></mujocoinclude>')
    hand = '<asset><mesh name="b" file="b.obj"/></asset>'
    write("hand.xml", mjcf('<body name="hand"><geom type="mesh" mesh="b"/></body>', before=hand))
    world = '<geom type="mesh" mesh="a"/><attach model="hand" body="hand" prefix="l_"/>'
    before = '<include file="parts/arm.xml"/><asset><model name="hand" file="hand.xml"/></asset>'
    write("other.xml", mjcf())
    return write("a.xml", mjcf(world, before=before))


def test_a_key_depends_on_exactly_the_files_that_mujoco_needs() -> None:
    write_assembly()
    before = key()
    assert before == key()
    for path in [path for path in Path().rglob("*.*") if path.is_file()]:
        content = path.read_bytes()
        path.unlink()
        try:
            mujoco.MjModel.from_xml_path("a.xml")
            is_needed = False
        except ValueError:
            is_needed = True
        assert (key() != before) is is_needed, path
        path.write_bytes(content + b" ")
        assert (key() != before) is is_needed, path
        path.write_bytes(content)
    assert key() == before


def test_a_file_that_appears_where_mujoco_looks_first_changes_the_key() -> None:
    Path("meshes").mkdir()
    write("b.obj", MESH)
    write("a.xml", mjcf('<geom type="mesh" mesh="b"/>', before='<asset><mesh name="b" file="b.obj"/></asset>'))
    write("c.xml", '<mujocoinclude><compiler meshdir="."/></mujocoinclude>')
    before = key()
    write("meshes/b.obj", MESH)
    assert key() == before
    Path("sub").mkdir()
    write("sub/b.xml", "<mujocoinclude/>")
    write("sub/part.xml", '<mujocoinclude><include file="b.xml"/></mujocoinclude>')
    write("a.xml", '<mujoco><include file="sub/part.xml"/></mujoco>')
    before = key()
    assert before
    write("b.xml", "<mujocoinclude/>")
    assert key() not in ("", before)


def test_a_model_without_one_of_its_files_is_not_stored() -> None:
    write("a.xml", mjcf(before='<asset><mesh name="b" file="b.obj"/></asset>'))
    assert key() == ""
    write("b.obj", MESH)
    assert key()
    for plugin, is_stored in (("mujoco.elasticity.cable", True), ("acme.reader", False)):
        write("a.xml", mjcf(before=f'<extension><plugin plugin="{plugin}"/></extension>'))
        assert bool(key()) is is_stored


@pytest.mark.parametrize("change", [{"codes": ["MJ301"]}, {"steps": 1}, {"path": "./a.xml"}])
def test_a_key_depends_on_settings_and_versions_but_not_on_limits(change: dict) -> None:
    write("a.xml", mjcf())
    assert key(replace(TASK, **change)) != key()
    assert key(replace(TASK, timeout=1, memory=1)) == key()
    assert ResultCache({"mujoco": "4.0.1"}).key(TASK) != key()


def test_only_complete_results_of_unchanged_files_are_stored() -> None:
    write("a.xml", mjcf())
    cache, name = ResultCache({}), ResultCache({}).key(TASK)
    timeout = {"finding": {"code": TIMEOUT.code}}
    for messages in ([{"loaded": True}], [timeout, *DONE]):
        cache.write(name, TASK, messages)
        assert cache.read(name) is None
    write("a.xml", mjcf("<geom size='1'/>"))
    cache.write(name, TASK, DONE)
    assert cache.read(name) is None
    write("a.xml", mjcf())
    cache.write(name, TASK, [{"pid": 5}, {"stage": "x"}, *DONE])
    assert cache.read(name) == [*DONE]


def test_an_unchanged_model_is_not_checked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    write("a.xml", PASSIVE.format('range="2 1"'))
    first = checked("a.xml")

    def refuse(_: CheckProcesses, task: WorkerTask) -> WorkerOutput:
        started.append(task.path)
        return WorkerOutput(DONE, ExitStatus(0), "")

    started: list[str] = []
    monkeypatch.setattr(check.CheckProcesses, "run", refuse)
    assert checked("a.xml") == first
    assert codes(checked("a.xml", severity={"MJ302": "error"}, ignore_in={"b*": "MJ3"}).models[0]) == ["MJ302"]
    assert started == []
    assert codes(checked("a.xml", cache=False).models[0]) == []
    write("a.xml", PASSIVE.format('range="2 1" damping="1"'))
    assert codes(checked("a.xml").models[0]) == []
    assert started == ["a.xml", "a.xml"]
