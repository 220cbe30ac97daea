"""Theorems about the wheel: it holds the scenes, and works without a checkout. Nothing is downloaded."""

import gzip
import json
import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
SCENES = {path.stem for path in (ROOT / "scenes").glob("*.xml")}
BUILD = "import sys; from hatchling import build; print(getattr(build, sys.argv[1])(sys.argv[2]))"


def built(kind: str, project: Path, folder: Path) -> Path:
    """Builds the wheel or source distribution of `project`."""
    command = [sys.executable, "-c", BUILD, kind, str(folder)]
    done = subprocess.run(command, cwd=project, capture_output=True, text=True, check=True)
    return folder / done.stdout.splitlines()[-1]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the wheel installs."""
    folder = tmp_path_factory.mktemp("wheel")
    with zipfile.ZipFile(built("build_wheel", ROOT, folder)) as wheel:
        wheel.extractall(folder / "site-packages")
    return folder / "site-packages"


def run(installed: Path, *arguments: str) -> str:
    """Returns the output of the installed mjrun, run outside the checkout."""
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    command = [sys.executable, *arguments]
    done = subprocess.run(command, cwd=installed.parent, env=environment, capture_output=True, text=True, check=True)
    return done.stdout


def test_the_wheel_has_the_command_and_types_but_no_tests(installed: Path) -> None:
    assert (installed / "mjrun/py.typed").exists()
    assert not (installed / "tests").exists()
    (points,) = installed.glob("mjrun-*.dist-info/entry_points.txt")
    assert "[console_scripts]\nmjrun = mjrun.__main__:main" in points.read_text()


def test_the_scenes_in_the_wheel_are_those_of_the_checkout_without_pictures(installed: Path) -> None:
    scenes = installed / "mjrun" / "scenes"
    files = {path.relative_to(scenes) for path in scenes.rglob("*") if path.is_file()}
    assert {path.suffix for path in files} == {".xml", ".yaml", ".py", ".onnx", ".csv"}
    assert {path.stem for path in files if path.suffix == ".xml"} == SCENES
    assert all((scenes / path).read_bytes() == (ROOT / "scenes" / path).read_bytes() for path in files)
    documents = set((ROOT / "scenes").rglob("*.yaml"))
    assert {ROOT / "scenes" / path for path in files if path.suffix == ".yaml"} == documents


def test_every_scene_loads_from_the_wheel(installed: Path) -> None:
    code = (
        "import mjrun; from mjrun.model.sources import parse_source\n"
        f"for name in {sorted(SCENES)}:\n"
        "    source = parse_source(f'scene:{name}')\n"
        "    print(source.main_file, source.load().nbody > 1)\n"
    )
    expected = [f"{installed}/mjrun/scenes/{name}.xml True" for name in sorted(SCENES)]
    assert run(installed, "-c", code).splitlines() == expected


def test_the_wheel_lists_its_scenes_and_tasks(installed: Path) -> None:
    listing = json.loads(run(installed, "-m", "mjrun", "info", "scene:", "--json"))
    names = [*SCENES, "car_drive", "humanoid_stand", "pendulum_swing_up"]
    assert {model["name"] for model in listing["models"]} == {f"scene:{name}" for name in names}
    task = json.loads(run(installed, "-m", "mjrun", "info", "scene:car_drive", "actions", "--json"))
    assert [row["name"] for row in task["actions"]] == ["forward", "turn"]


def test_the_font_of_captions_is_in_the_wheel_with_its_licence(installed: Path) -> None:
    fonts = installed / "mjrun" / "rendering" / "fonts"
    assert (fonts / "Inter.ttf").stat().st_size < 200_000
    assert "SIL OPEN FONT LICENSE Version 1.1" in (fonts / "OFL.txt").read_text()
    (licences,) = installed.glob("mjrun-*.dist-info/licenses")
    assert (licences / "mjrun/rendering/fonts/OFL.txt").read_bytes() == (fonts / "OFL.txt").read_bytes()
    code = "from mjrun.rendering import text; print(text._FILE, text.letters('θ̇ ≤ 90°'))"
    assert run(installed, "-c", code).split(maxsplit=1) == [str(fonts / "Inter.ttf"), "θ̇ ≤ 90°\n"]


def test_the_viewer_of_replays_is_in_the_wheel_with_the_licence_of_three(installed: Path) -> None:
    (licences,) = installed.glob("mjrun-*.dist-info/licenses")
    licence = (licences / "mjrun/outputs/exports/replay/LICENSE-three").read_text("utf-8")
    viewer = gzip.decompress((installed / "mjrun/outputs/exports/replay/viewer.js.gz").read_bytes()).decode()
    assert licence.strip() in viewer


def test_a_source_distribution_makes_the_same_wheel(tmp_path: Path, installed: Path) -> None:
    with tarfile.open(built("build_sdist", ROOT, tmp_path)) as archive:
        archive.extractall(tmp_path, filter="data")
    (project,) = (path for path in tmp_path.iterdir() if path.is_dir())
    with zipfile.ZipFile(built("build_wheel", project, tmp_path)) as wheel:
        names = {name for name in wheel.namelist() if name.startswith("mjrun/")}
    files = (path for path in (installed / "mjrun").rglob("*") if path.is_file() and path.suffix != ".pyc")
    assert names == {path.relative_to(installed).as_posix() for path in files}
