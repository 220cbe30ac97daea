"""A run is omitted exactly while everything that its outputs depend on is unchanged."""

import functools
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mjrun import packages
from mjrun.document.camera_and_ghost_forms import read_camera
from mjrun.errors import UsageError
from mjrun.formats.user_cache import VARIABLE, UserCache
from mjrun.options.output import RerunOptions
from mjrun.options.report import PageOptions
from mjrun.outputs import up_to_date_check
from mjrun.outputs.export import Export
from mjrun.outputs.image import Image
from mjrun.outputs.perform import perform
from mjrun.outputs.run_report import run_page
from mjrun.outputs.trace import Trace
from mjrun.outputs.up_to_date_check import UpToDateCheck, dependencies
from mjrun.outputs.video import Video
from mjrun.simulation.simulation import Simulation
from tests.check.models import MESH
from tests.conftest import Command

MODEL = """
<mujoco>
  <compiler meshdir="meshes"/>
  <asset><mesh name="a" file="a.obj"/></asset>
  <include file="parts/arm.xml"/>
  <worldbody><geom name="m" type="mesh" mesh="a"/></worldbody>
</mujoco>
"""
ARM = """
<mujocoinclude>
  <worldbody><body name="arm"><joint name="hinge" axis="0 1 0"/><geom size=".1" pos=".2 0 0"/></body></worldbody>
  <actuator><motor name="motor" joint="hinge"/></actuator>
</mujocoinclude>
"""
DOCUMENT = """
defaults: usual.yaml
model: model.xml
ctrl_from: controls.csv
traces:
  - {output: run.csv, probe: qpos, golden: gold.csv}
  - {output: fast.csv, probe: qvel, manifest: fast.json}
"""
metadata = functools.cache(packages._metadata)  # every run asks for that of all packages


@pytest.fixture(autouse=True)
def _files(mjrun_here: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder with a model of several files, and a cache for one test."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setattr(packages, "_metadata", metadata)
    for name, text in {
        "model.xml": MODEL,
        "parts/arm.xml": ARM,
        "meshes/a.obj": MESH,
        "meshes/unused.obj": MESH,
        "controls.csv": "time,motor\n0,1\n",
        "run.yaml": DOCUMENT,
        "usual.yaml": "duration: 0.01\n",
        "control.py": "from gains import KP\ndef act(model, data): data.ctrl[0] = KP\n",
        "gains.py": "KP = 2\n",
    }.items():
        path = mjrun_here.folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)


@pytest.fixture
def run(mjrun_here: Command) -> Callable[..., tuple[str, str]]:
    """Runs the document if something has changed; returns the reason that is told, and the answer."""

    def made(*more: str, document: str = "run.yaml") -> tuple[str, str]:
        done = mjrun_here("run", document, "-o", "out", "--if-changed", *more)
        assert done.returncode == 0, done.stderr
        reason = [line for line in done.stderr.decode().splitlines() if "made again" in line]
        return reason[0].removeprefix("mjrun: made again: ") if reason else "", done.stdout.decode()

    assert mjrun_here("run", "run.yaml", "-o", "out", "--update").returncode == 0  # makes the golden table
    return made


UP_TO_DATE = "out/run.csv, out/fast.csv and out/fast.json: up to date\n"


def test_a_second_run_does_nothing_and_gives_the_same_report(run: Callable[..., tuple[str, str]]) -> None:
    assert "rows" in run()[1]
    before = {path: path.stat().st_mtime_ns for path in Path("out").iterdir()}
    assert run() == ("", UP_TO_DATE)
    assert run("-q") == ("", "")
    assert {path: path.stat().st_mtime_ns for path in Path("out").iterdir()} == before

    answers = [run("traces[1].every=2", "--json") for _ in range(2)]
    assert [reason for reason, _ in answers] == ["the options have changed", ""]
    first, second = (json.loads(text) for _, text in answers)
    assert first == second  # even the wall times, which are those of the run that made the outputs
    assert "<testsuite" in run("traces[1].every=2", "--junit")[1]


def test_outputs_are_made_again_exactly_if_a_file_that_they_need_changes(
    run: Callable[..., tuple[str, str]], mjrun_here: Command
) -> None:
    run()
    for path in sorted(path for path in Path().rglob("*.*") if path.is_file() and path.parts[0] != "out"):
        content = path.read_bytes()
        path.unlink()
        is_needed = mjrun_here("run", "run.yaml", "-o", "other").returncode != 0
        path.write_bytes(content + b"\n")
        assert run()[0] == (f"{path} has changed" if is_needed else ""), path
        path.write_bytes(content)
        run()


@pytest.mark.parametrize("name", ["run.csv", "fast.csv", "fast.json"])
def test_outputs_that_are_missing_or_changed_are_made_again(run: Callable[..., tuple[str, str]], name: str) -> None:
    run()
    path = Path("out") / name
    content = path.read_bytes()
    path.write_bytes(content + b" ")
    assert run()[0] == f"out/{name} has changed"
    path.unlink()
    assert run()[0] == f"out/{name} is missing"
    assert run() == ("", UP_TO_DATE)
    if name != "fast.json":  # which holds wall times
        assert path.read_bytes() == content


def test_another_path_of_the_same_model_is_told(run: Callable[..., tuple[str, str]]) -> None:
    run()
    shutil.copytree("meshes", "other/meshes")
    shutil.copytree("parts", "other/parts")
    shutil.copy("model.xml", "other/model.xml")
    assert run("model=other/model.xml")[0] == "other/model.xml is read instead of model.xml"


def test_a_new_file_in_the_way_of_another_is_told(run: Callable[..., tuple[str, str]]) -> None:
    run()
    Path("a.obj").write_text(MESH)
    assert run()[0] == "a.obj may be read now"
    Path("a.obj").unlink()
    assert run()[0] == "a.obj is no longer read"


def test_other_versions_and_environments_make_outputs_again(
    run: Callable[..., tuple[str, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    run()
    installed = packages.installed_version
    monkeypatch.setattr(packages, "installed_version", lambda name: "99" if name == "pillow" else installed(name))
    assert run()[0] == f"pillow is 99 now, and was {installed('pillow')}"
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    assert run()[0] == "mjrun or its environment has changed"


def test_records_of_another_version_may_have_another_form(
    run: Callable[..., tuple[str, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as other:
        other.setattr(up_to_date_check, "__version__", "9.9")
        run()
    entries = UserCache("run")
    (entry,) = entries.folder.iterdir()
    entries.write(entry.name, ["of", "another", "form"])

    assert "rows" in run()[1]
    assert run() == ("", UP_TO_DATE)


def test_a_failed_run_is_repeated(mjrun_here: Command) -> None:
    line = ["trace", "model.xml", "--duration", "0.01", "-o", "a.csv", "--if-changed", "--assert", "max(time) < 0"]
    for _ in range(2):
        done = mjrun_here(*line)
        assert (done.returncode, b"up to date" in done.stdout + done.stderr) == (1, False)
        assert Path("a.csv").exists()


def test_the_code_of_a_controller_counts_with_what_it_imports(mjrun_here: Command) -> None:
    line = ["trace", "model.xml", "--steps", "2", "-o", "a.csv", "--if-changed", "--controller", "control.py:act"]

    def reason() -> bytes:
        done = mjrun_here(*line)
        assert done.returncode == 0
        for name in ("control", "gains"):  # the next run is one of another process
            sys.modules.pop(name, None)
        return done.stderr

    assert reason() == reason() == b""
    Path("gains.py").write_text("KP = 22\n")
    assert reason() == b"mjrun: made again: the code of the controller or policy has changed\n"
    Path("other.py").write_text("KP = 22\n")
    assert reason() == b""


def test_a_file_that_changes_during_the_run_leaves_no_record() -> None:
    job = Trace(Simulation("model.xml", steps=1), "a.csv", probe=["qpos"])

    def up_to_date(*, edited: bool) -> bool:
        with UpToDateCheck([job], RerunOptions(if_changed=True)) as last:
            if last.up_to_date():
                return True
            job.run()
            if edited:
                Path("meshes/a.obj").write_text(f"{MESH}\n")
            last.finish([], dict[str, object])
        return False

    assert not up_to_date(edited=True)
    assert not up_to_date(edited=False)
    assert up_to_date(edited=False)


def test_an_input_that_is_restored_before_the_end_leaves_no_record() -> None:
    model = Path("model.xml")
    job = Trace(Simulation("model.xml", steps=1), "a.csv", probe=["qpos"])
    with UpToDateCheck([job], RerunOptions(if_changed=True)) as last:
        assert last.up_to_date() is None
        model.rename("kept.xml")
        model.write_text(MODEL.replace('mesh="a"', 'mesh="a" pos="0 0 2"'))
        job.run()
        Path("kept.xml").replace(model)
        assert last.finish([], dict[str, object]) == "model.xml was replaced or changed during the run"
    with UpToDateCheck([job], RerunOptions(if_changed=True)) as last:
        assert last.up_to_date() is None


@pytest.mark.parametrize("name", ["a.csv", "a.json", "page.html"])
def test_an_output_that_another_run_replaced_is_not_recorded(name: str) -> None:
    def made(steps: int, meanwhile: Callable[[], object]) -> str | None:
        job = Trace(Simulation("model.xml", steps=steps), "a.csv", probe=["qpos"], manifest="a.json")
        with UpToDateCheck([job], RerunOptions(if_changed=True), page="page.html") as last:
            if last.up_to_date():
                return None
            with run_page(PageOptions(html="page.html"), "t", [job]) as published:
                perform([job], None, published)
            meanwhile()
            return last.finish(published, dict[str, object])

    made(3, lambda: shutil.copy(name, "other"))
    replaced = f"{name} was replaced or changed by another process"
    assert made(2, lambda: Path("other").replace(name)) == replaced  # the files of a run with other options
    assert made(2, Path(name).unlink) == replaced
    assert made(2, lambda: None) == ""
    assert made(2, lambda: None) is None


def test_what_changed_during_a_run_is_reported(
    mjrun_here: Command, monkeypatch: pytest.MonkeyPatch, run: Callable[..., tuple[str, str]]
) -> None:
    def performed(*args: Any) -> Any:
        results = perform(*args)
        os.utime("model.xml")
        return results

    monkeypatch.setattr("mjrun.outputs.perform.perform", performed)
    for line in (["trace", "model.xml", "--steps", "1", "-o", "a.csv"], ["run", "run.yaml", "-o", "out"]):
        done = mjrun_here(*line, "--if-changed")
        reason = "model.xml was replaced or changed during the run"
        warning = f"mjrun: warning: {reason}: the next run makes the outputs again\n"
        assert (done.returncode, done.stderr.decode()) == (0, warning)


@pytest.mark.parametrize("variable", ["GALLIUM_DRIVER", "LIBGL_ALWAYS_SOFTWARE", "DISPLAY"])
def test_variables_that_choose_a_renderer_make_outputs_again(
    run: Callable[..., tuple[str, str]], monkeypatch: pytest.MonkeyPatch, variable: str
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    run()
    monkeypatch.setenv(variable, ":1")
    assert run()[0] == "mjrun or its environment has changed"
    monkeypatch.setenv(variable, ":2")
    assert bool(run()[0]) is (variable != "DISPLAY")  # another number of a display does not select another backend


def test_cameras_and_ghosts_depend_on_their_files() -> None:
    Path("script.yaml").write_text("shots: [{camera: side}]\n")
    ghosts = ["trace=a.csv,map=b.txt,offset=0/1/0", "recording=c.npz", "trace=d.csv,map=none", "key=home"]
    job = Video(Simulation("model.xml"), "a.mp4", camera=[read_camera("script.yaml"), "side"], ghost=ghosts)
    assert [path for _, path in job.inputs] == ["script.yaml", "a.csv", "b.txt", "c.npz", "d.csv"]


@pytest.mark.parametrize(
    ("options", "output", "message"),
    [
        ({"if_changed": True}, "-", "if_changed requires files"),
        ({"depfile": "a.d"}, "-", "depfile requires files"),
        ({"depfile": "a.csv"}, "a.csv", "depfile a.csv is another file"),
        ({"depfile": "meshes/../meshes/a.obj"}, "a.csv", "is another file"),
    ],
)
def test_impossible_requests_are_refused(options: dict, output: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        UpToDateCheck([Trace(Simulation("model.xml"), output, probe=["qpos"])], RerunOptions(**options))


def test_outputs_of_every_kind_to_standard_output_are_refused() -> None:
    simulation = Simulation("model.xml")
    for job in [Video(simulation, "-"), Image(simulation, "-"), Export(simulation, "-")]:
        with pytest.raises(UsageError, match="if_changed requires files, not standard output"):
            UpToDateCheck([job], RerunOptions(if_changed=True))


def test_make_knows_what_the_outputs_depend_on(run: Callable[..., tuple[str, str]]) -> None:
    Path("Makefile").write_text("all: out/run.csv\nout/run.csv out/fast.csv out/fast.json:\n\tfalse\n-include out.d\n")

    def is_up_to_date() -> bool:
        done = subprocess.run(["make", "-q"], capture_output=True, text=True)
        assert "No rule" not in done.stderr
        return done.returncode == 0

    run("--depfile", "out.d")
    inputs = {"run.yaml", "usual.yaml", "model.xml", "parts/arm.xml", "meshes/a.obj", "controls.csv", "gold.csv"}
    later = max(path.stat().st_mtime_ns for path in Path("out").iterdir()) + 10**9
    for path in [path for path in Path().rglob("*.*") if path.is_file() and path.parts[0] != "out"]:
        os.utime(path, ns=(0, 0))
    for path in [path for path in Path().rglob("*.*") if path.is_file() and path.parts[0] != "out"]:
        assert is_up_to_date()
        os.utime(path, ns=(later, later))
        assert is_up_to_date() is (str(path) not in inputs), path
        os.utime(path, ns=(0, 0))
    Path("meshes/a.obj").unlink()
    assert not is_up_to_date()


def test_a_depfile_is_left_alone_while_it_is_right_and_restored_if_not(run: Callable[..., tuple[str, str]]) -> None:
    run("--depfile", "out.d")
    content = Path("out.d").read_text()
    os.utime("out.d", (1, 1))
    assert run("--depfile", "out.d") == ("", UP_TO_DATE)
    assert Path("out.d").stat().st_mtime == 1
    Path("out.d").unlink()
    assert run("--depfile", "out.d") == ("", UP_TO_DATE)
    assert Path("out.d").read_text() == content


def test_make_reads_names_with_special_characters(tmp_path: Path) -> None:
    names = ["a b.xml", "c#d.xml", "e$f.xml", "ü.xml"]
    for name in names:
        Path(name).touch()
    Path("m.mk").write_text("all: out\\ 1.csv\nout\\ 1.csv:\n\tfalse\ninclude out.d\n")
    Path("out.d").write_text(dependencies(["out 1.csv"], names))
    Path("out 1.csv").touch()
    os.utime("out 1.csv", (10**9, 10**9))
    for newer in [None, *names]:
        for name in names:
            os.utime(name, (2 * 10**9, 2 * 10**9) if name == newer else (1, 1))
        done = subprocess.run(["make", "-q", "-f", "m.mk"], capture_output=True)
        assert done.returncode == (0 if newer is None else 1), newer
