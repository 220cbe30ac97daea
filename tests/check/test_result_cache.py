"""Theorems about stored results: what is stored is what a new check finds, whatever changes in between."""

import os
import time
import zipfile
from dataclasses import replace
from pathlib import Path

import mujoco
import pytest

from mjrun import file_version
from mjrun.check import check
from mjrun.check.result_cache import ResultCache
from mjrun.check.rules.check_itself import TIMEOUT
from mjrun.check.worker_pool import CheckProcessOutput, CheckProcessPool, CheckRequest
from mjrun.child_process import ExitStatus
from mjrun.formats.user_cache import VARIABLE, FileDigestCache
from tests.check.models import MESH, PASSIVE, checked, codes, mjcf, write

DONE = ({"loaded": True}, {"done": True})
TASK = CheckRequest("a.xml", ["MJ302"], 0, 60, 1024)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache for one test."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


def key(task: CheckRequest = TASK) -> str:
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


@pytest.mark.parametrize("before", ['<include file="sub/a.mjz/a.xml"/>', '<asset><model file="sub/a.mjz"/></asset>'])
def test_a_key_depends_on_archives_and_on_the_files_that_these_name(before: str) -> None:
    Path("sub").mkdir(exist_ok=True)
    write("sub/b.obj", MESH)
    write("a.xml", mjcf(before=before))
    keys = list[str]()
    for size in ("1", "2"):
        with zipfile.ZipFile("sub/a.mjz", "w", zipfile.ZIP_DEFLATED) as archive:
            hand = f'<asset><mesh name="b" file="{Path("sub/b.obj").absolute()}"/></asset>'
            body = f'<body name="hand"><geom type="mesh" mesh="b"/><geom size="{size}"/></body>'
            archive.writestr("a.xml", mjcf(body, before=hand))
        keys.append(key())
    write("sub/b.obj", MESH.replace("1", "2"))
    keys.append(key())
    assert "" not in keys
    assert len({*keys}) == 3


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


@pytest.mark.parametrize("place", ["bb.obj", "below/bb.obj", "meshes/bb.obj", "new/b.obj"])
@pytest.mark.parametrize("is_settled", [True, False])
def test_a_finding_about_a_missing_file_is_stored_until_a_file_comes_or_goes_where_others_are_searched(
    monkeypatch: pytest.MonkeyPatch, place: str, is_settled: bool
) -> None:
    for folder in ("model/below", "meshes"):
        Path(folder).mkdir(parents=True)
    file = str(Path(place) if place.startswith("meshes") else "model" / Path(place))
    assets = '<compiler meshdir="../meshes"/><asset><mesh name="b" file="b.obj"/></asset>'
    write("model/a.xml", mjcf(before=assets))
    if is_settled:
        monkeypatch.setattr(file_version, "COARSEST_TIME", 0)
        time.sleep(0.02)  # longer than a tick of the system's clock
    (finding,) = checked("model/a.xml").models[0].findings
    assert finding.code == "MJ107"
    runs = []
    with monkeypatch.context() as patch:
        patch.setattr(
            CheckProcessPool,
            "run",
            lambda self, task: runs.append(task) or CheckProcessOutput(DONE[:1], ExitStatus(0), ""),
        )
        checked("model/a.xml")
        assert bool(runs) is not is_settled
        Path(file).parent.mkdir(exist_ok=True)
        runs.clear()
        write(file, MESH)
        checked("model/a.xml")
        assert runs


def test_a_model_whose_plugins_may_read_any_file_is_not_stored() -> None:
    for plugin, is_stored in (("mujoco.elasticity.cable", True), ("acme.reader", False)):
        write("a.xml", mjcf(before=f'<extension><plugin plugin="{plugin}"/></extension>'))
        assert bool(key()) is is_stored


def change_a_byte(file: str) -> None:
    """Changes a byte of a file, and sets its time back."""
    before = Path(file).stat().st_mtime_ns
    write(file, Path(file).read_text().replace("\n", " ", 1))
    os.utime(file, ns=(before, before))


def replace_by_another_file() -> None:
    write("new.obj", f"{MESH} ")
    Path("new.obj").replace("b.obj")


def lead_to_another_folder() -> None:
    Path("link").unlink()
    Path("link").symlink_to("other")


CHANGES = {
    "byte": lambda: change_a_byte("b.obj"),
    "model": lambda: change_a_byte("a.xml"),
    "file": replace_by_another_file,
    "link": lead_to_another_folder,
    "removed": lambda: Path("b.obj").unlink(),
    "added": lambda: write("meshes/b.obj", MESH),
}


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("is_settled", [True, False])
def test_untouched_files_are_not_read_again_and_no_change_is_missed(
    monkeypatch: pytest.MonkeyPatch, change: str, is_settled: bool
) -> None:
    for folder in ("meshes", "parts", "other"):
        Path(folder).mkdir()
    Path("link").symlink_to("parts")
    write("b.obj", MESH)
    write("parts/c.obj", MESH)
    write("other/c.obj", f"{MESH} ")
    assets = '<mesh name="b" file="b.obj"/><mesh name="c" file="link/c.obj"/>'
    write("a.xml", mjcf(before=f'<compiler meshdir="meshes"/><asset>{assets}</asset>'))
    if is_settled:
        monkeypatch.setattr(file_version, "COARSEST_TIME", 0)
        time.sleep(0.02)  # longer than a tick of the system's clock
    before = key()
    with monkeypatch.context() as patch:
        patch.setattr(FileDigestCache, "of", lambda self, place: "read")
        assert (key() == before) is is_settled
    CHANGES[change]()
    assert key() != before


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
        cache.write(name, TASK, messages, 0)
        assert cache.read(name) is None
    write("a.xml", mjcf("<geom size='1'/>"))
    cache.write(name, TASK, DONE, 0)
    assert cache.read(name) is None
    write("a.xml", mjcf())
    cache.write(name, TASK, [{"pid": 5}, {"stage": "x"}, *DONE], 0)
    assert cache.read(name) == [*DONE]


def test_an_unchanged_model_is_not_checked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    write("a.xml", PASSIVE.format('range="2 1"'))
    first = checked("a.xml")

    def refuse(_: CheckProcessPool, task: CheckRequest) -> CheckProcessOutput:
        started.append(task.path)
        return CheckProcessOutput(DONE, ExitStatus(0), "")

    started: list[str] = []
    monkeypatch.setattr(check.CheckProcessPool, "run", refuse)
    assert checked("a.xml") == first
    assert codes(checked("a.xml", severity={"MJ302": "error"}, ignore_in={"b*": "MJ3"}).models[0]) == ["MJ302"]
    assert started == []
    assert codes(checked("a.xml", cache=False).models[0]) == []
    write("a.xml", PASSIVE.format('range="2 1" damping="1"'))
    assert codes(checked("a.xml").models[0]) == []
    assert started == ["a.xml", "a.xml"]


def test_a_file_that_appears_where_a_missing_one_is_named_in_other_letters_changes_the_finding(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(file_version, "COARSEST_TIME", 0)
    for folder in ("Arm", "models"):
        Path(folder).mkdir()
    model = write("models/model.xml", mjcf(before='<include file="../ARM/arm.xml"/>'))
    time.sleep(0.02)  # longer than a tick of the system's clock
    for name in (None, "Arm/arm.xml"):
        if name:
            write(name, "<mujocoinclude/>")
        (finding,) = checked(model, steps=0).models[0].findings
        assert ("Arm/arm.xml exists" in finding.remedy) == bool(name)
