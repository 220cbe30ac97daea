"""Suffixes are declared once, and MuJoCo loads what ends in those of models."""

import ast
import zipfile
from pathlib import Path

import mujoco
import pytest

import mjrun
from mjrun.errors import ModelNotFoundError
from mjrun.suffixes import ARCHIVES, CHECKED, COMPILED, MODELS, REFERRING, XML, YAML, is_hdf5, is_yaml, split_episode

PACKAGE = Path(mjrun.__file__).parent
MJCF = "<mujoco><worldbody><body name='a'><geom name='ball' size='.1'/></body></worldbody></mujoco>"
URDF = """<robot name='r'><link name='a'><inertial><mass value='1'/>
<inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial></link></robot>"""


def write(path: Path) -> None:
    """Writes a model in the format of its suffix, by other means than mjrun's."""
    if path.suffix in COMPILED:
        mujoco.mj_saveModel(mujoco.MjModel.from_xml_string(MJCF), str(path))
    elif path.suffix in ARCHIVES:
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("model.xml", MJCF)
    else:
        path.write_text(URDF if path.suffix == ".urdf" else MJCF)


@pytest.mark.parametrize("suffix", MODELS)
def test_a_model_of_every_suffix_loads(tmp_path: Path, suffix: str) -> None:
    write(tmp_path / f"m{suffix}")
    assert mjrun.load(tmp_path / f"m{suffix}").nbody >= 1


@pytest.mark.parametrize("suffix", [*YAML, ".txt", ".XML", ".mjcf", ""])
def test_a_file_of_any_other_suffix_is_no_model(tmp_path: Path, suffix: str) -> None:
    (tmp_path / f"m{suffix}").write_text(MJCF)
    with pytest.raises(ModelNotFoundError, match=r"model files end in \.xml, \.urdf, \.mjz, \.zip, \.mjb"):
        mjrun.load(tmp_path / f"m{suffix}")


def test_models_are_text_archives_or_compiled() -> None:
    assert sorted(MODELS) == sorted({*XML, *ARCHIVES, *COMPILED})
    assert {*XML} < {*CHECKED} < {*MODELS} < {*REFERRING}
    assert {*YAML} == {*REFERRING} - {*MODELS}


@pytest.mark.parametrize(
    ("path", "expected"),
    [("a.yaml", True), ("b/c.yml", True), ("A.YAML", True), ("a.yaml.txt", False), ("yaml", False), (".yaml", False)],
)
def test_documents_end_in_yaml_of_either_case(path: str, expected: bool) -> None:
    assert is_yaml(path) is is_yaml(Path(path)) is expected


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("a.hdf5:demo_3", ("a.hdf5", "demo_3")),
        ("b:c/A.H5:x:y", ("b:c/A.H5", "x:y")),
        ("a.hdf5", ("a.hdf5", "")),
        ("a.hdf5:", ("a.hdf5", "")),
        ("a.xml:demo", ("a.xml:demo", "")),
        ("scene:dominos", ("scene:dominos", "")),
    ],
)
def test_an_episode_follows_the_name_of_an_hdf5_file(path: str, expected: tuple[str, str]) -> None:
    assert split_episode(path) == split_episode(Path(path)) == expected
    assert is_hdf5(expected[0]) is expected[0].lower().endswith((".hdf5", ".h5"))


def test_no_other_module_lists_suffixes_of_models_or_documents() -> None:
    texts = {path: path.read_text("utf-8") for path in PACKAGE.rglob("*.py")}
    lists = [
        f"{path.relative_to(PACKAGE)}:{node.lineno}"
        for path, text in texts.items()
        if sum(f'"{suffix}"' in text for suffix in REFERRING) > 1
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Tuple | ast.List | ast.Set)
        and sum(isinstance(each, ast.Constant) and each.value in REFERRING for each in node.elts) > 1
    ]
    assert [place for place in lists if not place.startswith("suffixes.py:")] == []
