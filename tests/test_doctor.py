"""Theorems about what the doctor makes of a machine."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

import mjrun.doctor
from mjrun.doctor import examine, extras
from mjrun.errors import UnknownNameError
from mjrun.packages import PACKAGES, PackageRequirement
from mjrun.rendering.backend import DEVICE, GL, WorkingBackend

ROOT = Path(__file__).parents[1]
GPU = WorkingBackend("egl", "NVIDIA H100", "NVIDIA", "4.6", 16384)
SOFTWARE = WorkingBackend("osmesa", "llvmpipe", "Mesa", "4.5", 8192)


@pytest.fixture(autouse=True)
def environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in (GL, DEVICE):
        monkeypatch.delenv(variable, raising=False)


@pytest.mark.usefixtures("half_a_core")
def test_cores_are_those_that_the_quota_of_a_container_feeds() -> None:
    system = next(each.value for each in mjrun.doctor._versions() if each.name == "system")
    assert system.endswith(", 1 core")


def test_the_extras_are_those_of_the_package_and_their_libraries_are_what_they_install() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    installed = {name: " ".join(packages) for name, packages in project["optional-dependencies"].items()}
    assert set(extras()) == set(installed) - {"all"}
    for extra, (libraries, uses) in extras().items():
        assert all(PACKAGES.get(library, library).replace("_", "-") in installed[extra] for library in libraries)
        assert uses


def test_every_extra_is_imported_somewhere() -> None:
    source = "".join(path.read_text() for path in (ROOT / "mjrun").rglob("*.py"))
    for library in (library for libraries, _ in extras().values() for library in libraries):
        assert f"import {library}" in source or f"from {library}" in source


def test_an_extra_that_is_not_installed_is_a_warning_with_its_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mjrun.doctor, "extras", lambda: {"parquet": (["no_such_library"], [".parquet", ".feather"])})
    (diagnostic,) = mjrun.doctor._extras()
    assert (diagnostic.status, diagnostic.value) == ("warning", "no-such-library is not installed")
    assert diagnostic.remedy == "for .parquet, .feather: pip install 'mjrun[parquet]'"


def test_a_package_of_a_wrong_version_is_marked_with_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    needed = [PackageRequirement("numpy", ">=99", ""), PackageRequirement("h5py", ">=99", "extra == 'hdf5'")]
    monkeypatch.setattr("mjrun.packages._requirements", lambda: needed)
    versions = {diagnostic.name: diagnostic for diagnostic in mjrun.doctor._versions()}
    assert (versions["numpy"].status, versions["mujoco"].status) == ("missing", "warning")
    assert versions["numpy"].value == f"numpy {np.__version__}; mjrun needs numpy>=99"
    assert versions["numpy"].remedy.endswith("pip install 'numpy>=99', although pip warns")
    extra = {diagnostic.name: diagnostic for diagnostic in mjrun.doctor._extras()}["hdf5"]
    assert extra.status == "warning"
    assert extra.value.endswith("; mjrun needs h5py>=99")


def test_the_first_backend_that_works_is_the_one_used() -> None:
    opengl = mjrun.doctor._opengl({"egl": "no device", "osmesa": SOFTWARE, "glfw": "no display"})
    assert opengl.used == "osmesa"
    by_name = {diagnostic.name: diagnostic for diagnostic in opengl.findings}
    assert by_name["osmesa"].value == "llvmpipe (software, used by default), 4.5"
    assert by_name["egl"].remedy.startswith("not needed; ")
    assert mjrun.doctor._opengl({"egl": GPU, "osmesa": SOFTWARE}).used == "egl"


def test_the_backend_that_the_environment_asks_for_is_the_only_one_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(GL, "osmesa")
    assert mjrun.doctor._opengl({"egl": GPU, "osmesa": SOFTWARE}).used == "osmesa"
    monkeypatch.setattr(mjrun.doctor.backend, "alternative", lambda tried: "")
    opengl = mjrun.doctor._opengl({"egl": GPU, "osmesa": "not installed"})
    assert opengl.used is None
    assert opengl.variables == {GL: "osmesa"}
    assert (opengl.findings[0].name, opengl.findings[0].value) == ("used", f"nothing draws with {GL}=osmesa")


def test_a_backend_that_does_not_exist_is_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    def requested() -> None:
        raise UnknownNameError("backend", "eg1", ["egl"])

    monkeypatch.setattr(mjrun.doctor.backend, "requested_backends", requested)
    monkeypatch.setattr(mjrun.doctor.backend, "alternative", lambda tried: "")
    used = mjrun.doctor._opengl({"egl": GPU}).findings[0]
    assert used.value == "nothing: no backend 'eg1' (did you mean 'egl'?)"


@pytest.mark.usefixtures("codecs_are_tried_once")
def test_options_in_remedies_are_spelled_as_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    class Failing:
        def __init__(self, name: str, **_: object) -> None:
            self.name = name

        def answer(self) -> dict:
            return {}

        def result(self) -> str:
            return "it fails"

    monkeypatch.setattr(mjrun.doctor.backend, "BackendTrialProcess", Failing)
    monkeypatch.setattr(mjrun.doctor.backend, "alternative", lambda tried: "")
    for spelling, name in ((str, "renderer"), (lambda name: f"--{name}", "--renderer")):
        report = examine(spelling)
        assert not report.can_draw
        (filament,) = [diagnostic for diagnostic in report.findings if diagnostic.name == "filament"]
        assert filament.remedy.startswith(f"not needed except for {name} filament; ")


def test_it_says_whether_a_window_opens_and_why_not(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in mjrun.doctor.DISPLAYS:
        monkeypatch.delenv(name, raising=False)
    window = mjrun.doctor._window("it needs a display")
    assert (window.status, window.value) == ("missing", "neither DISPLAY nor WAYLAND_DISPLAY is set")
    assert window.remedy.startswith("not needed; ")
    monkeypatch.setenv("DISPLAY", ":7")
    assert mjrun.doctor._window("it failed").value == "DISPLAY=:7 cannot be used: it failed"
    assert mjrun.doctor._window(SOFTWARE).status == "ok"


def test_it_says_whether_a_page_is_served(monkeypatch: pytest.MonkeyPatch) -> None:
    assert mjrun.doctor._studio().value.startswith("MuJoCo Studio ")
    monkeypatch.setattr(mjrun.doctor.importlib.util, "find_spec", lambda name: None)
    assert mjrun.doctor._studio().remedy == "pip install mujoco-studio"


def test_without_studio_filament_is_missing_for_another_reason_than_a_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mjrun.doctor.importlib.util, "find_spec", lambda name: None)
    finding = mjrun.doctor._filament("No module named 'mujoco.studio'", "egl")
    assert finding.remedy.endswith("pip install mujoco-studio")


def test_collections_of_models_are_counted_or_say_how_to_get_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MJRUN_MENAGERIE", "/no/such/folder")
    found = {diagnostic.name: diagnostic for diagnostic in mjrun.doctor._collections()}
    assert {"dm", "gym", "menagerie", "scene"} <= set(found)
    files = [path for suffix in ("xml", "yaml") for path in (ROOT / "scenes").glob(f"*.{suffix}")]
    scenes = len({path.stem for path in files if not path.stem.endswith("_fit")})
    assert (found["scene"].status, found["scene"].value) == ("ok", f"{scenes} scenes: mjrun info scene:")
    assert found["menagerie"].value == "MJRUN_MENAGERIE=/no/such/folder: is not a folder"
    assert found["menagerie"].remedy == "not needed"


def test_an_ffmpeg_that_is_not_there_is_told_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing() -> str:
        raise RuntimeError("No ffmpeg exe could be found.\nInstall it.")

    monkeypatch.setattr("imageio_ffmpeg.get_ffmpeg_exe", missing)
    (found,) = mjrun.doctor._encoder()
    assert found.status == mjrun.doctor.MISSING
    assert found.value == "ffmpeg cannot be run; reinstall imageio-ffmpeg: No ffmpeg exe could be found."
