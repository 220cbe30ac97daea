"""Theorems about model files: every kind loads as MuJoCo loads it, and every bad one is refused in words."""

import contextlib
import os
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun import file_version
from mjrun.errors import BrokenModelError, CompiledOverrideError, ModelError, ModelNotFoundError, clean
from mjrun.model import mujoco_globals
from mjrun.model.override import Override
from mjrun.model.sources import load
from mjrun.model.sources.file import FileSource
from tests.model.model_files import MODEL, compiled, content, refusal, write
from tests.processes import PATIENCE

URDF = """<robot name="r"><link name="base"/>
<link name="arm"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="elbow" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
MESH = (
    '<mujoco><asset><mesh name="m" file="m.obj"/></asset><worldbody><geom type="mesh" mesh="m"/></worldbody></mujoco>'
)
ROOT = Path(__file__).parents[3]
MALFORMED = ROOT / "../shared/models/malformed"


def archive(path: Path, files: dict[str, str]) -> Path:
    with zipfile.ZipFile(path, "w") as target:
        for name, text in files.items():
            target.writestr(name, text)
    return path


@pytest.mark.parametrize("name", ["a.xml", "a b.xml", "modèle.xml", "a.b.xml"])
def test_an_xml_file_is_what_mujoco_makes_of_it(tmp_path: Path, name: str) -> None:
    path = write(tmp_path / name, MODEL)
    assert content(load(path)) == content(load(str(path))) == content(mujoco.MjModel.from_xml_string(MODEL))


def test_a_urdf_file_is_what_mujoco_makes_of_it(tmp_path: Path) -> None:
    path = write(tmp_path / "r.urdf", URDF)
    assert content(load(path)) == content(mujoco.MjModel.from_xml_path(str(path)))
    assert load(path).joint("elbow").range.tolist() == [-1, 1]


def test_a_compiled_model_is_the_model_that_was_compiled(tmp_path: Path) -> None:
    assert content(load(compiled(tmp_path / "a.mjb"))) == content(mujoco.MjModel.from_xml_string(MODEL))


@pytest.mark.parametrize("suffix", [".zip", ".mjz"])
@pytest.mark.parametrize(
    "files",
    [
        {"model.xml": MODEL},
        {"a.xml": MODEL, "other.xml": "<mujoco/>"},
        {"anything.xml": MODEL},
        {"MuJoCo Model.xml": MODEL},
        {"model.xml": MESH, "m.obj": CORNERS},
    ],
)
def test_an_archive_holds_its_model_as_model_xml_as_its_own_name_or_alone(
    tmp_path: Path, suffix: str, files: dict[str, str]
) -> None:
    model = load(archive(tmp_path / f"a{suffix}", files))
    assert (model.ngeom, model.nmesh) == (1, "m.obj" in files)


@pytest.mark.parametrize("suffix", [".zip", ".mjz"])
def test_what_mujoco_packs_loads_with_its_meshes(tmp_path: Path, suffix: str) -> None:
    spec = mujoco.MjSpec.from_string(MESH, assets={"m.obj": CORNERS.encode()})
    expected = spec.compile()
    packed = tmp_path / f"a{suffix}"
    with packed.open("wb") as file:
        spec.to_zip(file)
    assert load(packed).mesh_vert == pytest.approx(expected.mesh_vert)


@pytest.mark.parametrize("compiles_alone", [True, False])
def test_a_mesh_that_is_written_again_within_a_second_is_read_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compiles_alone: bool
) -> None:
    monkeypatch.setattr(mujoco_globals, "_compiles_alone", compiles_alone)
    model, mesh = write(tmp_path / "m.xml", MESH), tmp_path / "m.obj"
    for edge in (1, 3, 2):
        mesh.write_text(CORNERS.replace("1 0 0", f"{edge} 0 0", 1))
        os.utime(mesh, (1e9, 1e9))
        corners = load(model).mesh_vert
        longest = np.linalg.norm(corners[:, None] - corners, axis=2).max()
        assert longest == pytest.approx(np.hypot(edge, 1), rel=1e-6)


@pytest.mark.parametrize("compiles_alone", [True, False])
def test_meshes_of_earlier_models_are_kept_only_where_nothing_else_compiles_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compiles_alone: bool
) -> None:
    monkeypatch.setattr(mujoco_globals, "_compiles_alone", compiles_alone)
    monkeypatch.setattr(file_version, "COARSEST_TIME", 0)
    cache, sizes = mujoco.mj_getCache(), list[int]()
    mujoco.mj_clearCache(cache)
    models = [tmp_path / name / "m.xml" for name in "ab"]
    for model in models:
        model.parent.mkdir()
        write(model.with_name("m.obj"), CORNERS)
        write(model, MESH)
    time.sleep(0.02)  # longer than a tick of the system's clock
    for model in models:
        load(model)
        sizes.append(mujoco.mj_getCacheSize(cache))
    assert sizes[1] == sizes[0] * (1 + compiles_alone) > 0


def test_the_bare_name_of_a_scene_suggests_the_scene() -> None:
    assert "no such model file (did you mean 'scene:dominos'?)" in str(refusal(Path("dominos")))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("https://example.org/a.xml", "no such model file; mjrun downloads nothing: save the model"),
        ("menagrie:go2", "(did you mean 'menagerie:'?)\ncollections of models: dm:, gym:, menagerie:, scene:"),
    ],
)
def test_a_url_and_an_unknown_collection_are_explained(text: str, message: str) -> None:
    assert message in str(refusal(Path(text)))


def test_a_missing_file_names_those_that_are_there_and_the_nearest(tmp_path: Path) -> None:
    for name in ("pendulum.xml", "car.mjb", "notes.txt"):
        write(tmp_path / name, "")
    error = refusal(tmp_path / "pendlum.xml")
    assert isinstance(error, ModelNotFoundError)
    first, second = str(error).splitlines()
    assert first == f"{tmp_path / 'pendlum.xml'}: no such model file (did you mean 'pendulum.xml'?)"
    assert second == f"models in {tmp_path}: car.mjb, pendulum.xml"


def test_a_pipe_is_refused_at_once_instead_of_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.xml")
    code = "import sys; from mjrun.model.sources import load; load(sys.argv[1])"
    command = [sys.executable, "-c", code, str(tmp_path / "a.xml")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.stderr.endswith("a.xml: is not a regular file\n")


@pytest.mark.parametrize("name", ["a.zip", "a.mjz", "a.mjb"])
@pytest.mark.parametrize("data", [b"", b"hello", b"PK\x03\x04 and no more"])
def test_rubbish_in_a_binary_file_is_refused(tmp_path: Path, name: str, data: bytes) -> None:
    assert isinstance(refusal(write(tmp_path / name, data)), BrokenModelError)


def test_a_cut_off_compiled_model_is_refused_with_the_version_that_would_have_to_match(tmp_path: Path) -> None:
    path = compiled(tmp_path / "a.mjb")
    path.write_bytes(path.read_bytes()[:-10])
    assert mujoco.mj_versionString() in str(refusal(path)).splitlines()[-1]


@pytest.mark.parametrize("files", [{}, {"readme.txt": "hi"}, {"b.xml": MODEL, "c.xml": MODEL}])
def test_an_archive_without_one_clear_model_is_refused(tmp_path: Path, files: dict[str, str]) -> None:
    assert "no model XML found" in str(refusal(archive(tmp_path / "a.zip", files)))


def test_a_compiled_model_with_a_bad_timestep_is_not_advised_what_cannot_be_done(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_string(MODEL)
    model.opt.timestep = 0
    mujoco.mj_saveModel(model, str(tmp_path / "a.mjb"))
    assert "overrides" not in str(refusal(tmp_path / "a.mjb"))


def test_a_compiled_model_refuses_overrides_and_names_them_as_they_were_asked(tmp_path: Path) -> None:
    path = compiled(tmp_path / "a.mjb")
    with pytest.raises(CompiledOverrideError) as caught:
        load(path, timestep=0.1, overrides={"opt.cone": "elliptic"})
    assert "set opt.cone=elliptic, timestep 0.1" in str(caught.value)
    assert caught.value.exit_code == 2


@pytest.mark.parametrize("path", sorted(MALFORMED.glob("*.xml")), ids=lambda path: path.stem)
def test_a_malformed_model_loads_or_is_refused_in_words(path: Path) -> None:
    said = str(path)
    try:
        assert load(path).nbody > 0
    except ModelError as error:
        said = str(error)
    assert said.startswith(str(path))
    assert all(line == clean(line) for line in said.splitlines())


def test_its_files_are_the_model_and_what_it_names_and_outputs_are_called_after_it(tmp_path: Path) -> None:
    (tmp_path / "part.xml").write_text("<mujocoinclude><worldbody><geom size='1'/></worldbody></mujocoinclude>")
    mesh = tmp_path / "meshes" / "a.obj"
    mesh.parent.mkdir()
    mesh.write_text("v 0 0 0\n")
    text = (
        '<compiler meshdir="meshes"/><include file="part.xml"/><asset><mesh file="a.obj"/><mesh file="b.obj"/></asset>'
    )
    path = write(tmp_path / "arm.v2.xml", f"<mujoco>{text}</mujoco>")
    source = FileSource(path)
    assert (source.text, source.stem, source.main_file) == (str(path), "arm.v2", path)
    assert source.files == (path, tmp_path / "part.xml", mesh)
    other = write(tmp_path / "meshes" / "c & d.obj", "v 0 0 0\n")
    assert source.with_overrides([Override("mesh/a.file", other.name)]).files == (
        path,
        tmp_path / "part.xml",
        mesh,
        other,
    )
    assert FileSource(tmp_path / "gone.xml").files == (tmp_path / "gone.xml",)
    assert FileSource(compiled(tmp_path / "a.mjb")).files == (tmp_path / "a.mjb",)


def test_a_path_with_a_backslash_is_refused_as_mujoco_cannot_open_it(tmp_path: Path) -> None:
    path = tmp_path / "a\\b.xml"
    path.write_text("<mujoco/>")
    with pytest.raises(ValueError, match="Error opening file"):
        mujoco.MjSpec.from_file(str(path))
    with pytest.raises(ModelNotFoundError, match="MuJoCo reads a backslash in a path"):
        FileSource(path).load()


def test_a_damaged_compiled_model_that_mujoco_would_crash_on_is_refused(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>"
    )
    model.body_treeid[1] = 12345
    mujoco.mj_saveModel(model, str(tmp_path / "a.mjb"))
    with pytest.raises(BrokenModelError, match="body_treeid refers to trees that do not exist"):
        load(tmp_path / "a.mjb")


@pytest.mark.parametrize("suffix", [".zip", ".mjz"])
def test_an_archive_that_would_fill_the_memory_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str
) -> None:
    path = tmp_path / f"a{suffix}"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as target:
        target.writestr("model.xml", MODEL)
        target.writestr("large.obj", bytes(2**23))
    assert FileSource(path).load().nbody > 0
    monkeypatch.setattr("mjrun.decompression_limits.FREE", 2**20)
    with pytest.raises(BrokenModelError, match=r"would expand to 0\.00839 GB in memory, \d{3} times its size"):
        FileSource(path).load()


NOT_A_MODEL = "is not a model file; model files end in .xml, .urdf, .mjz, .zip, .mjb"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        *((name, NOT_A_MODEL) for name in ("a.txt", "a", "a.obj", ".xml")),
        *((f"A.{suffix}", "accepts them in lower case only") for suffix in ("XML", "URDF", "MJB", "ZIP", "MJZ")),
        ("run.npz", f"{NOT_A_MODEL}\nto replay it, name its model as well: MODEL replay FOLDER/run.npz"),
        ("folder", "folder: is a folder, not a model file\nmodels in FOLDER/folder: car.xml"),
        ("no/a.xml", "a.xml: no such model file"),
        ("a\0b.xml", "embedded null"),
        ("x" * 300 + ".xml", "File name too long"),
        (os.fsdecode(b"\xff.xml"), "MuJoCo opens only paths in UTF-8"),
    ],
)
def test_a_path_that_is_no_model_file_is_refused_with_the_reason(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / "folder").mkdir()
    write(tmp_path / "folder/car.xml", MODEL)
    path = tmp_path / name
    with contextlib.suppress(OSError, ValueError):
        write(path, MODEL)
    error = refusal(path)
    assert isinstance(error, ModelNotFoundError)
    assert message.replace("FOLDER", str(tmp_path)) in str(error)
