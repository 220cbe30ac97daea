"""Theorems about described assets: they are the files that the model is made of."""

import os
import shutil
import zipfile
from pathlib import Path

import mujoco
import pytest

from mjrun.model.info import ModelDescription, referenced_files

CUBE = """<texture name="box" type="cube" fileright="{0}" fileleft="{0}" fileup="{0}" filedown="{0}" filefront="{0}"
    fileback="{1}"/>"""


def picture(path: Path, size: int) -> None:
    from PIL import Image

    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", (size, size)).save(path)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A model of many files: an include in an include, an attached model with a texture, a mesh, faces of a cube."""
    faces = CUBE.format("a.png", "b.png")
    (tmp_path / "part").mkdir()
    texts = {
        "main.xml": f"""<mujoco><compiler texturedir="tex" meshdir="shapes"/><include file="part/one.xml"/><asset>
            <mesh file="tetra.obj"/><texture name="plain" type="2d" builtin="flat" width="8" height="4"/>{faces}
            <model name="child" file="part/child.xml"/></asset><worldbody><geom type="mesh" mesh="tetra"/>
            <attach model="child" body="b" prefix="c_"/></worldbody></mujoco>""",
        "part/one.xml": '<mujocoinclude><include file="two.xml"/></mujocoinclude>',
        "part/two.xml": '<mujocoinclude><worldbody><geom size="1"/></worldbody></mujocoinclude>',
        "part/child.xml": """<mujoco><asset><texture name="t" type="2d" file="c.png"/></asset><worldbody>
            <body name="b"><geom size="1"/></body></worldbody></mujoco>""",
        "part/shapes.txt": "not a part of the model",
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    for name, size in {"tex/a.png": 8, "tex/b.png": 8, "part/c.png": 16}.items():
        picture(tmp_path / name, size)
    (tmp_path / "shapes").mkdir()
    vertices = "\n".join(f"v {x}" for x in ("0 0 0", "1 0 0", "0 1 0", "0 0 1"))
    (tmp_path / "shapes/tetra.obj").write_text(f"{vertices}\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    return tmp_path


EXPECTED = {
    ("model", "main.xml"),
    ("include", "part/one.xml"),
    ("include", "part/two.xml"),
    ("attached model", "part/child.xml"),
    ("mesh", "shapes/tetra.obj"),
    ("texture", "tex/a.png"),
    ("texture", "tex/b.png"),
    ("texture", "part/c.png"),
}


def test_every_file_of_a_model_is_found_with_its_size_on_disk(project: Path) -> None:
    path = project / "main.xml"
    found = ModelDescription(mujoco.MjModel.from_xml_path(str(path)), path).assets
    files = [asset for asset in found if asset.path]
    assert {(asset.kind, os.path.relpath(asset.path or "", project)) for asset in files} == EXPECTED
    assert all(asset.bytes == Path(asset.path or "").stat().st_size for asset in files)
    mesh = next(asset for asset in found if asset.kind == "mesh")
    assert mesh.content == {"vertices": 4, "faces": 4}
    (built,) = (asset for asset in found if asset.path is None)
    assert (built.name, built.bytes, built.content) == ("plain", None, {"width": 8, "height": 4, "channels": 3})


def test_files_are_found_from_another_working_directory_and_from_the_models_own(
    project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for folder in (project, project.parent):
        monkeypatch.chdir(folder)
        path = (project / "main.xml").relative_to(folder)
        found = ModelDescription(mujoco.MjModel.from_xml_path(str(path)), path).assets
        assert {
            (asset.kind, os.path.relpath(asset.path, project.relative_to(folder))) for asset in found if asset.path
        } == EXPECTED


def test_files_in_an_archive_are_found_with_their_sizes(tmp_path: Path) -> None:
    picture(tmp_path / "red.png", 8)
    text = """<mujoco><include file="more.xml"/><asset><texture name="t" type="2d" file="red.png"/></asset></mujoco>"""
    more = "<mujocoinclude><worldbody><geom size='1'/></worldbody></mujocoinclude>"
    path = tmp_path / "robot.mjz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("robot.xml", text)
        archive.writestr("more.xml", more)
        archive.write(tmp_path / "red.png", "red.png")
    found = ModelDescription(mujoco.MjSpec.from_file(str(path)).compile(), path).assets
    assert [(asset.kind, asset.path and os.path.relpath(asset.path, path), asset.bytes) for asset in found] == [
        ("model", ".", path.stat().st_size),
        ("include", "more.xml", len(more)),
        ("texture", "red.png", (tmp_path / "red.png").stat().st_size),
    ]


def test_a_compiled_model_remembers_its_files_and_says_when_they_are_gone(project: Path) -> None:
    path = project / "main.mjb"
    mujoco.mj_saveModel(mujoco.MjModel.from_xml_path(str(project / "main.xml")), str(path))
    shutil.rmtree(project / "shapes")
    found = {asset.kind: asset for asset in ModelDescription(mujoco.MjModel.from_binary_path(str(path)), path).assets}
    assert (found["model"].path, found["model"].bytes) == (str(path), path.stat().st_size)
    assert (found["mesh"].path, found["mesh"].bytes) == (str(project / "shapes/tetra.obj"), None)


def test_a_source_that_is_not_xml_or_gone_names_nothing(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    broken = tmp_path / "broken.xml"
    broken.write_text('<mujoco><include file="broken.xml"/><asset></mujoco>')
    assert [asset.kind for asset in ModelDescription(model, broken).assets] == ["model", "include"]
    (asset,) = ModelDescription(model, tmp_path / "gone.xml").assets
    assert (asset.kind, asset.bytes) == ("model", None)


def write(folder: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)


def relative(folder: Path, main: str) -> list[tuple[str, str]]:
    return [(file.kind, os.path.relpath(file.path, folder)) for file in referenced_files(str(folder / main))]


def test_includes_are_followed_and_each_must_be_there_for_mujoco(tmp_path: Path) -> None:
    files = {
        "main.xml": '<mujoco><include file="parts/a.xml"/></mujoco>',
        "parts/a.xml": '<mujocoinclude><include file="b.xml"/></mujocoinclude>',
        "parts/b.xml": '<mujocoinclude><worldbody><geom size="1"/></worldbody></mujocoinclude>',
    }
    write(tmp_path, files)
    assert relative(tmp_path, "main.xml") == [("include", "parts/a.xml"), ("include", "parts/b.xml")]
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "main.xml")).ngeom == 1
    for _, name in relative(tmp_path, "main.xml"):
        (tmp_path / name).rename(tmp_path / "away")
        with pytest.raises(ValueError, match=Path(name).name):
            mujoco.MjModel.from_xml_path(str(tmp_path / "main.xml"))
        (tmp_path / "away").rename(tmp_path / name)


def test_a_circle_of_includes_ends(tmp_path: Path) -> None:
    write(tmp_path, {"main.xml": '<mujoco><include file="main.xml"/></mujoco>'})
    assert relative(tmp_path, "main.xml") == [("include", "main.xml")]


ENCODED = '<?xml version="1.0" encoding="{}"?><mujoco><include file="no.xml"/></mujoco>'


@pytest.mark.parametrize(
    "text",
    [
        *('<mujoco><include file="no.xml"/></mujoco>', "hello"),
        *(ENCODED.format(encoding) for encoding in ("rot13", "zlib", "nobody", "x" * 5000)),
    ],
)
def test_what_is_missing_or_not_xml_names_nothing(tmp_path: Path, text: str) -> None:
    write(tmp_path, {"main.xml": text})
    assert relative(tmp_path, "main.xml") == relative(tmp_path, "gone.xml") == []
