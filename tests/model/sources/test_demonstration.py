"""Models of demonstrations as sources, and what they say about missing files."""

import json
import os
import pickle
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import mujoco
import pytest

from mjrun.confinement.confinement import VARIABLE, Confinement
from mjrun.errors import BrokenModelError, FileError, ModelError, UsageError
from mjrun.model.override import Override
from mjrun.model.sources import demonstration_in, is_file, is_model_name, parse_source, source_of
from mjrun.model.sources.demonstration import (
    HIDDEN_IN_ROBOSUITE,
    DemonstrationSource,
    is_demonstration_file,
    list_demonstrations,
    model_text,
    open_demonstrations,
)
from tests.cases import cases
from tests.demonstration_files import MODEL, PLAIN, recorded_states, write_assets, write_demonstrations
from tests.model.model_files import content


def test_a_source_names_a_file_and_an_episode(tmp_path: Path) -> None:
    path = tmp_path / "d.hdf5"
    for given in (f"{path}:demo_1", Path(f"{path}:demo_1"), DemonstrationSource(path, "demo_1")):
        source = source_of(given)
        assert source == DemonstrationSource(path, "demo_1")
        assert (source.text, source.stem, demonstration_in(given)) == (f"{path}:demo_1", "d_demo_1", f"{path}:demo_1")
    assert parse_source("a.h5") == DemonstrationSource(Path("a.h5"))
    assert demonstration_in("a.xml") is demonstration_in(mujoco.MjModel.from_xml_string("<mujoco/>")) is None


@pytest.mark.parametrize(
    ("text", "file", "model"),
    [("d.hdf5:demo_1", True, True), ("d.h5", True, False), ("d.xml:a", True, False), ("scene:dominos", False, True)],
)
def test_a_file_alone_may_be_a_table(text: str, file: bool, model: bool) -> None:
    assert (is_file(text), is_model_name(text)) == (file, model)


def test_the_model_is_the_text_within_the_file(tmp_path: Path) -> None:
    path = write_demonstrations(tmp_path / "d.hdf5")
    (tmp_path / "m.xml").write_text(PLAIN)
    source = DemonstrationSource(path, "demo_2")
    assert content(source.load()) == content(mujoco.MjModel.from_xml_path(str(tmp_path / "m.xml")))
    assert source.files == (path, tmp_path / "meshes/link.obj")
    assert source.hidden_groups == HIDDEN_IN_ROBOSUITE


def test_the_text_of_a_model_has_the_paths_of_its_assets_here(tmp_path: Path) -> None:
    path = write_demonstrations(tmp_path / "d.hdf5")
    assert DemonstrationSource(path, "demo_1").mjcf() == PLAIN.replace("link.obj", f"{tmp_path}/meshes/link.obj")
    write_demonstrations(path, model=MODEL)
    assert DemonstrationSource(path, "demo_1").mjcf() == MODEL


def test_overrides_apply_and_a_source_is_a_value(tmp_path: Path) -> None:
    path = write_demonstrations(tmp_path / "d.hdf5", {"demo": recorded_states()}, attributes={})
    source = DemonstrationSource(path, overrides=(Override("opt.timestep", "0.01"),))
    assert pickle.loads(pickle.dumps(source)).load().opt.timestep == 0.01
    assert source.hidden_groups == {}
    copy = tmp_path / "copy.hdf5"
    path.rename(copy)
    moved = source.stored_at(lambda place: copy if place == path else place)
    assert (moved.load().opt.timestep, moved.text) == (0.01, str(path))


def test_assets_are_found_by_the_end_of_their_paths(tmp_path: Path) -> None:
    write_assets(tmp_path / "packages")
    path = write_demonstrations(tmp_path / "d.hdf5", model=MODEL)
    with pytest.raises(BrokenModelError) as caught:
        DemonstrationSource(path, "demo_1").load()
    assert caught.value.spelled(lambda name: f"--{name}").splitlines() == [
        f"{path}:demo_1: 1 of the 1 file that its model names are missing here: "
        "/home/someone/robosuite-dev/robosuite/models/assets/robots/arm",
        "  .: link.obj",
        "to get those of robosuite: pip install --no-deps --target assets robosuite==1.4.1, then --assets assets",
        "--assets DIR finds them by any end of their paths, as in DIR/arm/link.obj",
    ]
    assets = Override("", str(tmp_path / "packages"), "assets")
    assert DemonstrationSource(path, "demo_1", overrides=(assets,)).load().nmesh == 1


def test_many_missing_files_are_listed_by_folder(tmp_path: Path) -> None:
    names = [f"/u/chiliocosm/assets/f{folder}/m{index}.obj" for folder in range(6) for index in range(5)]
    meshes = "".join(f'<mesh file="{name}"/>' for name in names)
    path = write_demonstrations(tmp_path / "d.hdf5", model=f"<mujoco><asset>{meshes}</asset></mujoco>")
    with pytest.raises(BrokenModelError) as caught:
        DemonstrationSource(path, "demo_1").load()
    lines = str(caught.value).splitlines()
    assert lines[0].endswith("30 of the 30 files that its model names are missing here: /u/chiliocosm/assets")
    assert lines[1] == "  f0: m0.obj, m1.obj, m2.obj, … (5 in all)"
    assert lines[5] == "  and in 2 other folders"
    assert "to get those of libero: git clone https://github.com/Lifelong-Robot-Learning/LIBERO assets" in lines[6]


def test_other_models_have_no_assets_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "m.xml").write_text("<mujoco/>")
    source = replace(parse_source(str(tmp_path / "m.xml")), overrides=(Override("", "a", "assets"),))
    with pytest.raises(UsageError, match=r"assets applies only to the models of demonstrations"):
        source.load()


@cases("model, message")
def test_models_that_do_not_load_are_errors_about_the_demonstration(tmp_path: Path, model: str, message: str) -> None:
    path = write_demonstrations(tmp_path / "d.hdf5", model=model)
    with pytest.raises(BrokenModelError, match=message) as caught:
        DemonstrationSource(path, "demo_1").load()
    assert "\x1b" not in str(caught.value)


def test_files_without_demonstrations_are_errors_about_a_model(tmp_path: Path) -> None:
    path = write_demonstrations(tmp_path / "d.hdf5", model=None)
    with pytest.raises(ModelError, match="contains no model"):
        DemonstrationSource(path, "demo_1").load()
    with pytest.raises(ModelError, match="has 2 demonstrations; select one"):
        DemonstrationSource(path).load()
    missing = DemonstrationSource(tmp_path / "missing.hdf5", "demo_1")
    assert missing.files == (tmp_path / "missing.hdf5",)
    assert missing.hidden_groups == {}
    with pytest.raises(ModelError, match="no such file"):
        missing.load()


@pytest.mark.parametrize("outside", [lambda path: str(path), lambda path: f"../{path.name}"], ids=["absolute", "above"])
def test_a_confined_process_finds_no_file_outside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, outside: Callable[[Path], str]
) -> None:
    (tmp_path / "inside").mkdir()
    path = write_demonstrations(tmp_path / "inside/d.hdf5", model=PLAIN)
    secret = tmp_path / "secret.obj"
    secret.write_bytes((tmp_path / "inside/meshes/link.obj").read_bytes())
    monkeypatch.setenv(VARIABLE, json.dumps(asdict(Confinement((os.path.realpath(tmp_path / "inside"),)))))
    monkeypatch.setattr("mjrun.confinement.self_confinement.confined_load", lambda load: load())
    assert DemonstrationSource(path, "demo_1").load().nmesh == 1
    write_demonstrations(path, model=PLAIN.replace("link.obj", outside(secret)))
    with pytest.raises(BrokenModelError, match="1 of the 1 file that its model names are missing here"):
        DemonstrationSource(path, "demo_1").load()


def test_a_file_is_listed_with_its_episodes_and_cameras(tmp_path: Path) -> None:
    listed = list_demonstrations(write_demonstrations(tmp_path / "d.hdf5"))
    assert [(each.name, each.states, each.duration) for each in listed.demonstrations] == [
        ("demo_1", 5, pytest.approx(0.2)),
        ("demo_2", 4, pytest.approx(0.15)),
    ]
    assert (listed.path, listed.cameras, listed.origin.task) == (str(tmp_path / "d.hdf5"), ["agentview"], "Lift")


def test_files_without_models_are_listed_too(tmp_path: Path) -> None:
    path = write_demonstrations(tmp_path / "d.hdf5", model=None)
    assert list_demonstrations(path).cameras == []
    with (
        open_demonstrations(path) as file,
        pytest.raises(FileError, match=r"contains no model\nreplay .* mjrun video MODEL.xml replay .*d.hdf5:demo_1"),
    ):
        model_text(file, "demo_1")


def test_an_old_file_names_the_file_of_each_model(tmp_path: Path) -> None:
    path = write_demonstrations(tmp_path / "d.hdf5", model="model_1.xml")
    (tmp_path / "models").mkdir()
    (tmp_path / "models/model_1.xml").write_text(PLAIN)
    with open_demonstrations(path) as file:
        assert model_text(file, "demo_1") == PLAIN.encode()


@pytest.mark.parametrize("name", ["model_2.xml", "../secret.xml", "/etc/passwd", "a\0b"])
def test_only_files_in_the_folder_of_models_are_read(tmp_path: Path, name: str) -> None:
    (tmp_path / "secret.xml").write_text(PLAIN)
    (tmp_path / "models").mkdir()
    path = write_demonstrations(tmp_path / "d.hdf5", model=name.replace("\0", " "))
    with open_demonstrations(path) as file, pytest.raises(FileError, match=r"its model .* is missing in the folder"):
        model_text(file, "demo_1")


def test_files_that_are_missing_or_folders_are_refused(tmp_path: Path) -> None:
    (tmp_path / "folder.hdf5").mkdir()
    for name, reason in [("folder.hdf5", "is not a regular file"), ("missing.hdf5", "no such file")]:
        with pytest.raises(FileError, match=f"{name}: {reason}"):
            open_demonstrations(tmp_path / name)
        with pytest.raises(ModelError, match=f"{name}: {reason}"):
            list_demonstrations(tmp_path / name)
        assert not is_demonstration_file(tmp_path / name)
    assert is_demonstration_file(write_demonstrations(tmp_path / "d.hdf5", {"demo": recorded_states()}))


def test_a_confined_process_reads_only_files_inside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_demonstrations(tmp_path / "d.hdf5")
    monkeypatch.setenv(VARIABLE, json.dumps(asdict(Confinement((os.path.realpath(tmp_path / "inside"),)))))
    with pytest.raises(FileError, match="is outside the folder that files are read from"):
        open_demonstrations(path)
