"""Theorems about files that a model refers to."""

from pathlib import Path

import pytest

from mjrun.errors import ModelError
from mjrun.model.sources import load
from tests.check.models import FINE, LFS, MESH, Case, lint, lint_file, mjcf

CASES = [
    Case(
        "MJ107",
        mjcf("", '<asset>\n<mesh file="no.obj"/></asset>', '<compiler meshdir="m"/>'),
        7,
        "no file 'no.obj' for <mesh>; tried m/no.obj",
        mjcf("", '<asset><mesh file="yes.obj"/></asset>'),
    ),
    Case("MJ107", mjcf("", '<include file="no.xml"/>'), 6, "no file 'no.xml' for <include>; tried no.xml", FINE),
]


@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_rule_finds_what_it_is_for_at_its_line_and_nothing_in_a_correct_model(case: Case) -> None:
    case.check()


CASED = "Meshes/Base.obj exists: names of files and folders are case-sensitive"


FORMATS = "MuJoCo reads meshes in STL, OBJ and MSH; convert it to one of them, as Blender does"


POINTS = "is a Git LFS pointer, not the file itself"


PULLED = "fetch the file itself: git lfs pull"


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


@pytest.mark.parametrize(
    ("filename", "compiler", "tried"),
    [
        ("meshes/part.stl", "", "meshes/part.stl"),
        ("meshes/part.stl", 'meshdir="mm"', "mm/meshes/part.stl"),
        ("meshes/part.stl", 'meshdir="mm" strippath="true"', "mm/part.stl"),
        ("package://pkg/part.stl", 'meshdir="mm"', "package:/pkg/part.stl"),
        ("package://pkg/part.stl", 'meshdir="mm" strippath="true"', "mm/part.stl"),
    ],
)
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


@pytest.mark.parametrize(
    ("asset", "code", "message", "remedy"),
    [
        ("lfs.obj", "MJ107", f"'lfs.obj' of <mesh> {POINTS}", PULLED),
        ("lfs.stl", "MJ107", f"'lfs.stl' of <mesh> {POINTS}", PULLED),
        ("meshes/base.obj", "MJ107", "no file 'meshes/base.obj' for <mesh>; tried meshes/base.obj", CASED),
        ("Meshes/base.OBJ", "MJ107", "no file 'Meshes/base.OBJ' for <mesh>; tried Meshes/base.OBJ", CASED),
        ("meshes\\Base.obj", "MJ107", r"no file 'meshes\Base.obj' for <mesh>; tried meshes/Base.obj", CASED),
        ("arm.dae", "MJ100", "the model does not load: no decoder found for mesh file 'arm.dae'", FORMATS),
    ],
)
def test_a_mesh_that_is_no_mesh_is_told_with_what_to_do(asset: str, code: str, message: str, remedy: str) -> None:
    Path("Meshes").mkdir()
    texts = {"lfs.obj": LFS, "lfs.stl": LFS, "Meshes/Base.obj": MESH, "arm.dae": "<COLLADA/>"}
    for name, text in texts.items():
        Path(name).write_text(text)
    (finding,) = lint(mjcf("", f'<asset>\n<mesh file="{asset}"/></asset>'))
    assert (finding.code, finding.file, finding.line) == (code, "model.xml", 7)
    assert (finding.message, finding.remedy) == (message, remedy)


def test_backslashes_part_folders_for_mujoco_and_for_the_rules() -> None:
    Path("sub").mkdir()
    part = '<mujocoinclude>\n<body name="p"><joint name="p" range="2 1"/>{}</body></mujocoinclude>'
    Path("sub/part.obj").write_text(MESH)
    text = mjcf('<include file="sub\\part.xml"/>', '<asset><mesh name="m" file="sub\\part.obj"/></asset>')
    for geom, code in (('<geom type="mesh" mesh="m"/>', "MJ302"), ("", "MJ202")):
        Path("sub/part.xml").write_text(part.format(geom))
        assert [(f.code, f.file, f.line) for f in lint(text)] == [(code, "sub/part.xml", 2)]
