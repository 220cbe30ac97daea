"""Theorems about files that a model refers to."""

from pathlib import Path

import pytest

from mjrun.errors import ModelError
from mjrun.model.sources import load
from tests.cases import cases
from tests.check.fixes import fixed, fixing
from tests.check.models import MESH, lint, lint_file, mjcf, write


def test_a_missing_file_is_told_with_every_path_that_mujoco_opens_and_what_lies_near() -> None:
    Path("parts/assets").mkdir(parents=True)
    Path("parts/assets/part.obj").write_text(MESH)
    Path("parts/arm.xml").write_text('<mujocoinclude><asset>\n<mesh file="part.obj"/></asset></mujocoinclude>')
    text = mjcf("", '<include file="parts/arm.xml"/>', '<compiler meshdir="meshes"/>')
    (missing,) = lint(text)
    assert (missing.code, missing.file, missing.line) == ("MJ107", "parts/arm.xml", 2)
    tried = ["meshes/part.obj", "meshes/parts/part.obj"]
    assert missing.message.endswith(f"tried {', '.join(tried)}")
    assert missing.remedy.startswith("parts/assets/part.obj exists;")
    for path in map(Path, tried):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(MESH)
        assert lint(text) == []
        path.unlink()


def test_the_model_is_not_suggested_for_a_missing_file() -> None:
    Path("arm.xml").write_text(mjcf("", '<asset><mesh file="arm.msh"/></asset>'))
    Path("arms.msh").touch()
    (missing,) = lint_file(Path("arm.xml"))
    assert missing.remedy.startswith("did you mean 'arms.msh'?")
    Path("arms.msh").unlink()
    (missing,) = lint_file(Path("arm.xml"))
    assert "did you mean" not in missing.remedy


def test_an_absolute_path_to_nothing_is_better_relative() -> None:
    (missing,) = lint(mjcf("", '<asset><mesh file="/home/alice/part.obj"/></asset>', "<compiler/>"))
    assert missing.message.endswith("tried /home/alice/part.obj")
    assert missing.remedy.startswith("write the path relative to the folder of the model")


@cases("filename, compiler, tried")
def test_files_of_urdf_are_told_as_mujoco_looks_for_them(filename: str, compiler: str, tried: str) -> None:
    inertia = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    mesh = f'<collision><geometry>\n<mesh filename="{filename}"/></geometry></collision>'
    text = f'<robot name="r"><mujoco><compiler {compiler}/></mujoco><link name="a">{inertia}{mesh}</link></robot>'
    path = Path("r.urdf")
    path.write_text(text)
    with pytest.raises(ModelError, match=f"Error opening file '{tried}'"):
        load(path)
    (missing,) = lint_file(path)
    assert (missing.code, missing.line) == ("MJ107", 2)
    assert missing.message.endswith(f"tried {tried}")


def test_backslashes_part_folders_for_mujoco_and_for_the_rules() -> None:
    Path("sub").mkdir()
    part = '<mujocoinclude>\n<body name="p"><joint name="p" range="2 1"/>{}</body></mujocoinclude>'
    Path("sub/part.obj").write_text(MESH)
    text = mjcf('<include file="sub\\part.xml"/>', '<asset><mesh name="m" file="sub\\part.obj"/></asset>')
    for geom, code in (('<geom type="mesh" mesh="m"/>', "MJ302"), ("", "MJ202")):
        Path("sub/part.xml").write_text(part.format(geom))
        assert [(f.code, f.file, f.line) for f in lint(text)] == [(code, "sub/part.xml", 2)]


def test_a_name_in_the_wrong_case_is_corrected_beside_the_folder_of_the_model() -> None:
    for folder in ("Arm", "models"):
        Path(folder).mkdir()
    write("Arm/arm.xml", mjcf('<body name="b"><geom size="1"/></body>'))
    text = mjcf('<attach model="arm" body="b" prefix="l_"/>', before='<asset><model name="arm" file="../{}"/></asset>')
    model = Path(write("models/model.xml", text.format("ARM/arm.XML")))
    assert "models/../Arm/arm.xml exists" in lint_file(model)[0].remedy
    assert fixing(str(model), given=["."]).files
    assert model.read_text() == text.format("Arm/arm.xml")


@cases("name, compiler, right")
def test_a_name_that_differs_from_a_file_in_case_only_is_corrected(name: str, compiler: str, right: str | None) -> None:
    Path("meshes").mkdir(exist_ok=True)
    Path("meshes/part.OBJ").write_text(MESH)
    text = mjcf('<geom type="mesh" mesh="m"/>', before=f"<compiler {compiler}/>{{}}")
    mesh = '<asset><mesh name="m" file="{}"/></asset>'
    wrong = text.format(mesh.format(name))
    if right is None:
        assert fixed(wrong) == wrong
    else:
        assert fixed(wrong) == text.format(mesh.format(right))
        load(Path(write("model.xml", fixed(wrong))))
