"""Copies of files give the same model as the files when they were copied, despite later edits."""

import errno
import hashlib
import os
import pickle
import shutil
import tempfile
import zipfile
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.errors import FileError, ModelNotFoundError, UsageError
from mjrun.model.source import ModelSource, content_fingerprint
from mjrun.model.sources import source_of
from mjrun.simulation.input_snapshot import InputSnapshot
from mjrun.simulation.simulation import Simulation
from tests.processes import largest_file

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
BODY = '<mujoco><worldbody><body name="{}"><freejoint/><geom size="{}"/></body></worldbody></mujoco>'


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """A model in four files: an include, an attached model, a mesh by an absolute path, and one by a path with `..`."""
    parts, meshes = tmp_path / "parts", tmp_path / "a & b"
    for folder in (parts, meshes, tmp_path / "robot"):
        folder.mkdir()
    (parts / "floor.xml").write_text('<mujocoinclude><worldbody><geom size="9"/></worldbody></mujocoinclude>')
    (parts / "hand.xml").write_text(BODY.format("hand", 0.1))
    for name in ("a.obj", "b.obj"):
        (meshes / name).write_text(TETRAHEDRON)
    absolute = str(meshes / "a.obj").replace("&", "&amp;")
    path = tmp_path / "robot" / "robot.xml"
    path.write_text(f"""<mujoco>
      <include file="../parts/floor.xml"/>
      <asset>
        <model name="hand" file="../parts/hand.xml"/>
        <mesh file="{absolute}"/>
        <mesh file="nowhere/../../a &amp; b/b.obj"/>
      </asset>
      <worldbody>
        <body><freejoint/><geom type="mesh" mesh="a"/><geom type="mesh" mesh="b"/></body>
        <attach model="hand" prefix="left/"/>
      </worldbody>
    </mujoco>""")
    (tmp_path / "robot" / "nowhere").mkdir()
    return path


def copied(source: ModelSource) -> tuple[InputSnapshot, ModelSource]:
    snapshot = InputSnapshot.empty().with_files(source.files)
    return snapshot, source.stored_at(snapshot.place)


def test_the_copies_give_the_model_of_the_files_when_those_are_gone(robot: Path, tmp_path: Path) -> None:
    original = content_fingerprint(mujoco.MjModel.from_xml_path(str(robot)))
    snapshot, source = copied(source_of(robot))
    assert len(snapshot.digests) == 5
    for folder in ("robot", "parts", "a & b"):
        shutil.rmtree(tmp_path / folder)
    assert content_fingerprint(source.load()) == original
    assert source.text == str(robot)

    elsewhere = snapshot.copied_from(snapshot.contents())
    assert elsewhere.root != snapshot.root
    assert content_fingerprint(source_of(robot).stored_at(elsewhere.place).load()) == original
    assert elsewhere.fingerprint == snapshot.fingerprint


PART = '<asset><mesh file="{}"/></asset><worldbody><body name="b"><geom type="mesh" mesh="a"/></body></worldbody>'
ATTACH = '<worldbody><attach model="part" prefix="a"/></worldbody>'
ATTACHING = f'<mujoco><asset><model name="part" file="{{}}"/></asset>{ATTACH}</mujoco>'
INCLUDING = '<mujoco><include file="{}"/></mujoco>'


@pytest.mark.parametrize("mesh", ["ABSOLUTE", "../../a.obj"])
@pytest.mark.parametrize(
    ("part", "model"),
    [
        ("part.inc", INCLUDING.format("part.inc")),
        ("part.mjz", ""),
        ("part.mjz", ATTACHING.format("part.mjz")),
        ("part.zip", INCLUDING.format("part.zip/part.xml")),
    ],
)
def test_so_do_copies_of_texts_that_are_in_archives_or_have_other_suffixes(
    tmp_path: Path, part: str, model: str, mesh: str
) -> None:
    names = tmp_path / "model" / part, tmp_path / "model/model.xml"
    names[0].parent.mkdir()
    (tmp_path / "a.obj").write_text(TETRAHEDRON)
    file = mesh.replace("ABSOLUTE", str(tmp_path / "a.obj"))
    if "include" in model:  # the names are relative to the model that includes them
        file = file.replace("../../", "../")
    text = f"<mujoco>{PART.format(file)}</mujoco>"
    if names[0].suffix == ".inc":
        names[0].write_text(text)
    else:
        with zipfile.ZipFile(names[0], "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("part.xml", text)
            archive.writestr("other.stl", b"solid")
    if model:
        names[1].write_text(model)
    main = str(names[1] if model else names[0])
    original = content_fingerprint(source_of(main).load())
    snapshot, source = copied(source_of(main))
    elsewhere = snapshot.copied_from(snapshot.contents())
    shutil.rmtree(tmp_path / "model")
    (tmp_path / "a.obj").write_text(TETRAHEDRON.replace("1", "2"))
    assert content_fingerprint(source.load()) == original
    assert content_fingerprint(source_of(main).stored_at(elsewhere.place).load()) == original


@pytest.mark.parametrize("text", ["scene:dominos", "gym:Ant-v5"])
def test_models_of_packages_are_copied(text: str) -> None:
    snapshot, source = copied(source_of(text))
    assert snapshot.digests
    assert source.text == text
    assert content_fingerprint(source.load()) == content_fingerprint(source_of(text).load())


def test_a_copy_is_known_by_its_content(robot: Path) -> None:
    snapshot, _ = copied(source_of(robot))
    contents = snapshot.contents()
    assert contents[str(robot)] == robot.read_bytes()
    path = next(iter(contents))
    with pytest.raises(FileError, match="its copy is damaged"):
        snapshot.copied_from({**contents, path: contents[path] + b" "})
    robot.write_bytes(robot.read_bytes() + b" ")
    assert copied(source_of(robot))[0].fingerprint != snapshot.fingerprint


def test_comments_count_in_all_files_but_models(tmp_path: Path) -> None:
    def digests(text: str) -> list[str]:
        files = [tmp_path / "ball.xml", tmp_path / "ball.txt"]
        for file in files:
            file.write_text(text)
        snapshot = InputSnapshot.empty().with_files(files)
        return [snapshot.content_digest(path) for path in (*files, tmp_path / "missing.xml")]

    plain, commented = BODY.format("ball", 1), BODY.format("ball", 1) + "<!-- red -->"
    model, *_ = digests(plain)
    assert digests(commented) == [model, hashlib.sha256(commented.encode()).hexdigest(), ""]


def test_the_folder_lasts_as_long_as_what_refers_to_it(robot: Path) -> None:
    snapshot = InputSnapshot.empty()
    root, more = snapshot.root, snapshot.with_files([robot])
    del snapshot
    assert more.place(robot).is_file()
    assert pickle.loads(pickle.dumps(more)).place(robot).is_file()
    del more
    assert not root.exists()


def test_a_copy_that_does_not_fit_is_an_error_of_the_folder_for_temporary_files(robot: Path) -> None:
    expected = f"^{tempfile.gettempdir()}: cannot hold temporary files: File too large\nset TMPDIR to another folder$"
    snapshot = InputSnapshot.empty()
    with largest_file(100), pytest.raises(FileError, match=expected):
        snapshot.with_files([robot])


def test_a_file_outside_of_a_confinement_is_not_copied_and_keeps_its_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    inside, outside = tmp_path / "inside.xml", tmp_path / "outside.xml"
    for path in (inside, outside):
        path.write_text(BODY.format("ball", 1))
    monkeypatch.setattr(f"{InputSnapshot.__module__}.is_readable", lambda path: Path(path) != outside)
    snapshot = InputSnapshot.empty().with_files([inside, outside])
    assert {*snapshot.digests} == {str(inside)}
    assert snapshot.place(outside) == outside
    assert snapshot.place(inside) != inside


def test_an_unreadable_file_is_an_error_of_the_model_or_of_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = [tmp_path / name for name in ("ball.xml", "table.csv")]
    for file in files:
        file.write_text(BODY.format("ball", 1))

    def refuse(path: Path, *_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))

    simulation = Simulation(str(files[0]), ctrl_from=str(files[1]))
    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(ModelNotFoundError, match=r"/ball\.xml: Permission denied$"):
        InputSnapshot.empty().with_files((), of_models=simulation.source.files)
    with pytest.raises(FileError, match=r"/table\.csv: cannot be read: Permission denied$"):
        simulation.with_snapshot()


def test_what_is_not_copied_is_not_read_from_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    snapshot = InputSnapshot.empty().with_files([Path("late.xml"), Path("/dev/null")])
    Path("late.xml").write_text("<mujoco/>")
    assert not snapshot.place("late.xml").exists()
    assert snapshot.digests == {}
    with pytest.raises(UsageError) as caught, snapshot.original_names_in_errors():
        raise UsageError(f"{snapshot.place('late.xml')} and {snapshot.place('/etc/x')}", (str(snapshot.root),))
    assert str(caught.value) == "late.xml and /etc/x"


@pytest.mark.skipif(not Path("/dev/shm").is_dir(), reason="there is no /dev/shm")
def test_files_in_shared_memory_are_copied() -> None:
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        model = Path(folder, "ball.xml")
        model.write_text(BODY.format("ball", 1))
        snapshot = InputSnapshot.empty().with_files([model])
        assert {*snapshot.digests} == {str(model)}
        assert snapshot.place(model).read_text() == BODY.format("ball", 1)


def test_a_simulation_of_copies_is_that_of_the_files(robot: Path, tmp_path: Path) -> None:
    table = tmp_path / "robot" / "controls.csv"
    model = robot.parent / "motor.xml"
    model.write_text(
        '<mujoco><worldbody><body><joint name="j"/><geom size="1"/></body></worldbody>'
        '<actuator><motor name="m" joint="j"/></actuator></mujoco>'
    )
    table.write_text("time,ctrl/m\n0,0.5\n0.01,1\n")
    simulation = Simulation(str(model), ctrl_from=os.path.relpath(table))
    before = simulation.stepper(simulation.load())
    before.advance(20)
    stored = simulation.with_snapshot()
    fingerprints = stored.fingerprints
    assert fingerprints == simulation.fingerprints
    model.write_text("<mujoco/>")
    table.write_text("time,ctrl/m\n0,9\n")
    assert stored.fingerprints == fingerprints
    after = stored.stepper(stored.load())
    after.advance(20)
    np.testing.assert_array_equal(before.state(), after.state())


def test_a_replayed_table_and_its_map_are_read_as_copied(tmp_path: Path) -> None:
    model, table, names = tmp_path / "m.xml", tmp_path / "log.csv", tmp_path / "names.map"
    model.write_text('<mujoco><worldbody><body><joint name="j"/><geom size="1"/></body></worldbody></mujoco>')
    table.write_text("time,a,b\n0,0.5,9\n0.01,1,9\n")
    names.write_text("qpos/j=a\n")
    replayed = Simulation(str(model), replay=str(table), map=[f"@{names}"])
    before = replayed.stepper(replayed.load())
    before.advance(3)
    stored = replayed.with_snapshot()
    names.write_text("qpos/j=b\n")
    table.write_text("time,a,b\n0,7,9\n0.01,7,9\n")
    after = stored.stepper(stored.load())
    after.advance(3)
    np.testing.assert_array_equal(before.state(), after.state())
    assert before.state()[1] == 0.8
