"""Files of models that were compiled on another machine."""

import importlib.util
from pathlib import Path

import pytest

from mjrun.model import model_files
from mjrun.model.model_files import AbsolutePathMjcf, installed_packages, packages_in, placed
from tests.cases import cases

MESH = "/home/someone/lib/robosuite/models/assets/arenas/../robots/arm/link.obj"


def model(*names: str) -> bytes:
    meshes = "".join(f'<mesh name="m{index}" file="{name}"/>' for index, name in enumerate(names))
    return f'<mujoco><compiler meshdir="meshes/"/><asset>{meshes}</asset></mujoco>'.encode()


def touch(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()
    return path


@cases("given, place")
def test_a_folder_is_searched_for_any_end_of_a_path(tmp_path: Path, given: str, place: str) -> None:
    file = touch(tmp_path / place)
    found = placed(model(MESH), tmp_path, [tmp_path / given])
    assert found == AbsolutePathMjcf(model(str(file)), [file], [])


def test_the_longest_end_of_a_path_counts(tmp_path: Path) -> None:
    touch(tmp_path / "link.obj")
    file = touch(tmp_path / "robots/arm/link.obj")
    assert placed(model(MESH), tmp_path / "elsewhere", [tmp_path]).files == [file]


@pytest.mark.parametrize("place", ["elsewhere/link.obj", "robots/other/link.obj", "a/b/c/d/robots/arm/link.obj"])
def test_other_files_of_the_same_name_do_not_count(tmp_path: Path, place: str) -> None:
    touch(tmp_path / place)
    assert placed(model(MESH), tmp_path, [tmp_path]) == AbsolutePathMjcf(model(MESH), [], [MESH])


def test_folders_that_are_given_come_first_then_the_path_itself_then_packages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = touch(tmp_path / "site/robosuite/__init__.py").parent
    installed = touch(package / "models/assets/robots/arm/link.obj")
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    monkeypatch.setattr(model_files, "_installed", model_files._installed.__wrapped__)
    importlib.invalidate_caches()
    assert [*installed_packages()] == ["robosuite"]
    assert placed(model(MESH), tmp_path).files == [installed]

    itself = touch(tmp_path / "home/robosuite/models/assets/robots/arm/link.obj")
    assert placed(model(str(itself)), tmp_path).files == [itself]
    given = touch(tmp_path / "given/arm/link.obj")
    assert placed(model(str(itself)), tmp_path, [tmp_path / "given"]).files == [given]


def test_packages_that_a_path_names_come_before_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for package in ("robosuite", "libero"):
        touch(tmp_path / f"{package}/__init__.py")
        touch(tmp_path / f"{package}/assets/textures/wood.png")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(model_files, "_installed", model_files._installed.__wrapped__)
    importlib.invalidate_caches()
    for path, package in [("/u/chiliocosm/assets/textures/wood.png", "libero"), ("/u/textures/wood.png", "robosuite")]:
        assert placed(model(path), tmp_path).files == [tmp_path / package / "assets/textures/wood.png"]
    assert placed(model("/u/wood.png"), tmp_path).files == []


def test_assets_that_libero_has_downloaded_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = touch(tmp_path / ".cache/libero/assets/scenes/table.msh")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr(model_files, "_installed", model_files._installed.__wrapped__)
    assert placed(model("/u/chiliocosm/assets/scenes/table.msh"), tmp_path / "elsewhere").files == [file]


def test_names_may_be_relative_escaped_or_of_windows(tmp_path: Path) -> None:
    files = [touch(tmp_path / name) for name in ("meshes/a.obj", "b&c.obj", "arm/d.obj")]
    found = placed(model("a.obj", "b&amp;c.obj", r"C:\lib\arm\d.obj"), tmp_path, [tmp_path])
    assert found.files == files
    assert found.text == model(*(str(file).replace("&", "&amp;") for file in files))


def test_comments_name_no_files(tmp_path: Path) -> None:
    text = b'<mujoco><!-- <mesh file="/u/a.obj"/> --></mujoco>'
    assert placed(text, tmp_path) == AbsolutePathMjcf(text, [], [])


@pytest.mark.parametrize(
    ("path", "packages"),
    [
        (MESH, ["robosuite"]),
        ("/u/robosuite-master/assets/a.stl", ["robosuite"]),
        ("/u/libero-dev/chiliocosm/assets/a.stl", ["libero"]),
        ("/u/robocasa/robosuite/a.stl", ["robosuite", "robocasa"]),
        ("/u/a.stl", []),
    ],
)
def test_paths_name_packages(path: str, packages: list[str]) -> None:
    assert packages_in(path) == packages
