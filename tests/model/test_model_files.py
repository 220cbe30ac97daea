"""What a model names is looked at before MuJoCo opens it, wherever MuJoCo would look for it."""

import itertools
import os
import zipfile
from pathlib import Path, PurePath, PurePosixPath, PureWindowsPath
from typing import Any

import pytest

from mjrun.errors import BrokenModelError
from mjrun.model import model_files
from mjrun.model.model_files import (
    file_content,
    file_size,
    main_mjcf,
    require_regular_files,
    unpacked_size,
    with_absolute_paths,
)
from mjrun.model.sources import load, source_of

MESH = '<asset><mesh name="m" file="{}"/></asset><worldbody><geom type="mesh" mesh="m"/></worldbody>'
NAMING = {
    "mesh": MESH.format("pipe"),
    "mesh by an entity": MESH.format("p&#105;pe"),
    "mesh in a folder": f'<compiler meshdir="sub"/>{MESH.format("inner.stl")}',
    "mesh in a folder, by a backslash": f'<compiler assetdir="sub"/>{MESH.format("..&#92;pipe")}',
    "mesh in single quotes": MESH.replace('"{}"', "'pipe'"),
    "texture": '<asset><texture type="2d" name="t" file="pipe"/></asset>',
    "face of a cube": '<asset><texture type="cube" name="t" fileup="pipe"/></asset>',
    "height field": '<asset><hfield name="h" size="1 1 1 1" file="pipe"/></asset>',
    "skin": '<asset><skin name="s" file="pipe"/></asset>',
    "flexcomp": '<worldbody><flexcomp name="f" type="mesh" file="pipe"/></worldbody>',
    "include": '<include file="pipe"/>',
    "attached model": '<asset><model file="pipe"/></asset>',
    "included mesh": '<include file="included.xml"/>',
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "sub").mkdir()
    os.mkfifo(tmp_path / "pipe")
    os.mkfifo(tmp_path / "sub" / "inner.stl")
    (tmp_path / "included.xml").write_text(f"<mujoco>{MESH.format('pipe')}</mujoco>")
    return tmp_path


@pytest.mark.parametrize("body", NAMING.values(), ids=NAMING)
def test_a_named_pipe_is_refused_with_the_line_that_names_it(folder: Path, body: str) -> None:
    model = folder / "model.xml"
    model.write_text(f"<mujoco>\n{body}\n</mujoco>")
    with pytest.raises(BrokenModelError, match="is a named pipe; a model is read from regular files") as caught:
        load(model)
    assert (caught.value.path, caught.value.line) in ((model, 2), (folder / "included.xml", 1))
    assert caught.value.exit_code == 3


def test_so_is_one_in_urdf_whose_package_mujoco_drops(folder: Path) -> None:
    model = folder / "model.urdf"
    mesh = '<geometry><mesh filename="package://robot/pipe"/></geometry>'
    model.write_text(f'<robot name="r"><link name="a"><collision>{mesh}</collision></link></robot>')
    with pytest.raises(BrokenModelError, match="named pipe"):
        load(model)


def test_so_is_one_that_an_archive_names_outside_of_itself(folder: Path) -> None:
    model = folder / "model.mjz"
    with zipfile.ZipFile(model, "w") as archive:
        archive.writestr("model.xml", f"<mujoco>{MESH.format(folder / 'pipe')}</mujoco>")
    with pytest.raises(BrokenModelError, match="named pipe"):
        load(model)


def test_so_is_one_that_an_attached_archive_names(folder: Path) -> None:
    with zipfile.ZipFile(folder / "part.mjz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("part.xml", f"<mujoco>{MESH.format(folder / 'pipe')}{' ' * 999}</mujoco>")
    (folder / "model.xml").write_text('<mujoco><asset><model file="part.mjz"/></asset></mujoco>')
    with pytest.raises(BrokenModelError, match="named pipe"):
        load(folder / "model.xml")


@pytest.mark.usefixtures("folder")
def test_an_archive_in_an_archive_is_refused_where_files_are_confined(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    outer = archive(tmp_path / "outer.mjz", "inner.mjz")
    text = b'<mujoco><asset><model file="inner.mjz"/></asset></mujoco>'
    assert require_regular_files(outer, text, f"{outer}/outer.xml") == {}
    monkeypatch.setattr(model_files, "confinement", lambda: True)
    with pytest.raises(BrokenModelError, match=r"'inner\.mjz' is an archive in an archive"):
        require_regular_files(outer, text, f"{outer}/outer.xml")


def test_a_device_is_refused_too(tmp_path: Path) -> None:
    with pytest.raises(BrokenModelError, match=r":1: '/dev/zero' is a device"):
        require_regular_files(tmp_path / "m.xml", b'<mujoco><asset><skin file="/dev/zero"/></asset></mujoco>')


def test_what_is_not_there_or_is_a_file_is_left_to_mujoco(tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_bytes(b"")
    names = ["a.stl", "b.stl", "", ".", "a" * 5000, "a\0b", "&#0;", "\udcff"]
    text = "".join(f'<mesh file="{name}"/>' for name in names)
    require_regular_files(tmp_path / "m.xml", text.encode(errors="surrogateescape"))
    require_regular_files(tmp_path / "m.xml", None)


def test_models_that_include_each_other_are_gone_through_once(tmp_path: Path) -> None:
    for one, other in (("a", "b"), ("b", "a")):
        (tmp_path / f"{one}.xml").write_text(f'<mujoco><include file="{other}.xml"/></mujoco>')
    require_regular_files(tmp_path / "a.xml", (tmp_path / "a.xml").read_bytes())


@pytest.mark.parametrize("naming", ['<include file="{}"/>', '<asset><model name="a" file="{}"/></asset>'])
def test_what_is_no_mjcf_beyond_the_model_s_folder_is_not_cited(tmp_path: Path, naming: str) -> None:
    (tmp_path / "robot").mkdir()
    (tmp_path / "settings.xml").write_text("<?xml version='1.0'?>\n<settings><password-of-ann/></settings>")
    model = tmp_path / "robot" / "model.xml"
    model.write_text(f"<mujoco>{naming.format('../settings.xml')}</mujoco>")
    with pytest.raises(BrokenModelError, match=r"settings\.xml, which is not MJCF$") as caught:
        load(model)
    assert "password" not in str(caught.value)


def test_mistakes_in_mjcf_are_reported_wherever_it_is(tmp_path: Path) -> None:
    (tmp_path / "robot").mkdir()
    (tmp_path / "common.xml").write_text("<!-- shared -->\n<mujocoinclude><gem/></mujocoinclude>")
    (tmp_path / "robot" / "model.xml").write_text('<mujoco><include file="../common.xml"/></mujoco>')
    with pytest.raises(BrokenModelError, match="gem"):
        load(tmp_path / "robot" / "model.xml")


def test_an_image_larger_than_any_texture_is_refused_by_its_first_bytes(tmp_path: Path) -> None:
    head = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + (30_000).to_bytes(4) * 2
    (tmp_path / "bomb.png").write_bytes(head)
    model = tmp_path / "a.xml"
    model.write_text('<mujoco><asset>\n<texture name="t" type="2d" file="bomb.png"/></asset></mujoco>')
    with pytest.raises(BrokenModelError, match=r"a\.xml:2: 'bomb.png' has 30000x30000 pixels"):
        load(model)


@pytest.mark.parametrize(
    ("system", "text", "expected"),
    [
        (PurePosixPath, """<mesh file="/a/b.obj"/>""", """<mesh file="[/a/b.obj]"/>"""),
        (PurePosixPath, """<mesh file = '/it&quot;s&amp;b.obj'/>""", """<mesh file = '[/it&quot;s&amp;b.obj]'/>"""),
        (PurePosixPath, """<mesh file="\\a\\b.obj"/>""", """<mesh file="[/a/b.obj]"/>"""),
        (PurePosixPath, """<compiler meshdir="/a/"/>""", """<compiler meshdir="[/a/]"/>"""),
        (PurePosixPath, """<mesh file="b.obj"/>""", """<mesh file="b.obj"/>"""),
        (PurePosixPath, """<mesh file="C:/b.obj"/>""", """<mesh file="C:/b.obj"/>"""),
        (PureWindowsPath, """<mesh file="C:\\a\\b.obj"/>""", """<mesh file="[C:/a/b.obj]"/>"""),
        (PureWindowsPath, """<mesh file="C:b.obj"/>""", """<mesh file="C:b.obj"/>"""),
        (PureWindowsPath, """<texture fileup="//server/a/b.png"/>""", """<texture fileup="[//server/a/b.png]"/>"""),
        (PureWindowsPath, """<mesh file="/b.obj"/>""", """<mesh file="[/b.obj]"/>"""),
    ],
)
def test_absolute_paths_are_replaced(
    monkeypatch: pytest.MonkeyPatch, system: type[PurePath], text: str, expected: str
) -> None:
    monkeypatch.setattr(model_files, "PurePath", system)
    assert with_absolute_paths(text.encode(), lambda name: f"[{name}]") == expected.encode()


def archive(path: Path, *names: str) -> Path:
    with zipfile.ZipFile(path, "w") as target:
        for name in names:
            target.writestr(name, name * 2)
    return path


@pytest.mark.parametrize("suffix", ["mjz", "zip"])
def test_a_file_in_an_archive_is_what_was_packed(tmp_path: Path, suffix: str) -> None:
    packed = archive(tmp_path / f"robot.{suffix}", "model.xml", "meshes/arm.obj")
    inner = f"{packed}/meshes/arm.obj"
    assert (file_size(inner), file_content(inner)) == (28, b"meshes/arm.objmeshes/arm.obj")
    assert (file_size(f"{packed}/no.obj"), file_content(f"{packed}/no.obj")) == (None, None)


def test_the_list_of_an_archive_is_not_read_for_each_of_its_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, text = tmp_path / "robot.zip", '<mujoco><include file="0.xml"/></mujoco>'
    with zipfile.ZipFile(path, "w") as target:
        target.writestr("model.xml", text)
        for index in range(30):
            target.writestr(f"{index}.xml", f'<mujocoinclude><include file="{index + 1}.xml"/></mujocoinclude>')
    opened = list[object]()

    class Counted(zipfile.ZipFile):
        def __init__(self, *arguments: Any) -> None:
            opened.append(arguments)
            super().__init__(*arguments)

    monkeypatch.setattr(zipfile, "ZipFile", Counted)
    assert require_regular_files(path, text.encode(), f"{path}/model.xml") == {}
    assert len(opened) < 5


def test_a_file_on_disk_is_itself_and_a_folder_is_none(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_bytes(b"v 1 2 3")
    assert (file_size(str(tmp_path / "a.obj")), file_content(str(tmp_path / "a.obj"))) == (7, b"v 1 2 3")
    assert (file_size(str(tmp_path)), file_content(str(tmp_path))) == (None, None)


def test_a_file_beyond_what_anybody_writes_by_hand_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.xml").write_bytes(b"12345678")
    monkeypatch.setattr(model_files, "MOST", 7)
    assert file_size(str(tmp_path / "a.xml")) == 8
    assert file_content(str(tmp_path / "a.xml")) is None


MEMBERS = ("robot.xml", "model.xml", "robot/robot.xml", "robot/model.xml", "./model.xml", "part.xml")


@pytest.mark.parametrize("names", [*itertools.combinations(MEMBERS, 1), *itertools.permutations(MEMBERS, 2)])
def test_the_main_mjcf_of_an_archive_is_the_one_that_mujoco_reads(tmp_path: Path, names: tuple[str, ...]) -> None:
    path = tmp_path / "robot.zip"
    with zipfile.ZipFile(path, "w") as target:
        for name in names:
            target.writestr(name, f'<mujoco model="{name}"/>')
    try:
        spec = source_of(str(path)).compile()[0]
        assert spec
    except BrokenModelError:
        assert main_mjcf(path) is None
        return
    assert main_mjcf(path) == f"{path}/{spec.modelname}"


def test_all_mjcf_in_an_archive_is_looked_at(folder: Path) -> None:
    for name in ("alone.zip", "part.mjz"):
        with zipfile.ZipFile(folder / name, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("z/../model.xml", f"<mujoco>{MESH.format(folder / 'pipe')}{' ' * 999}</mujoco>")
            archive.writestr("model.xml", f'<mujoco model="m"/>{" " * 999}')
    (folder / "attaching.xml").write_text('<mujoco><asset><model file="part.mjz"/></asset></mujoco>')
    for name in ("alone.zip", "attaching.xml"):
        with pytest.raises(BrokenModelError, match="named pipe"):
            load(folder / name)


def test_no_mjcf_has_no_main_file(tmp_path: Path) -> None:
    assert main_mjcf(archive(tmp_path / "robot.zip")) is None


def test_mjcf_is_its_own_main_file_and_nothing_else_has_one(tmp_path: Path) -> None:
    assert main_mjcf(Path("a.xml")) == "a.xml"
    assert main_mjcf(Path("a.mjb")) is None
    (tmp_path / "bad.zip").write_bytes(b"no archive")
    assert main_mjcf(tmp_path / "bad.zip") is None


def test_a_pipe_is_no_archive_and_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.zip")
    assert main_mjcf(tmp_path / "a.zip") is None


def test_the_size_of_an_archive_is_that_of_its_files(tmp_path: Path) -> None:
    assert unpacked_size(archive(tmp_path / "a.zip", "model.xml", "arm.obj")) == 2 * len("model.xml" + "arm.obj")
    (tmp_path / "b.zip").write_bytes(b"no archive")
    assert unpacked_size(tmp_path / "b.zip") == unpacked_size(tmp_path / "c.zip") == 0
