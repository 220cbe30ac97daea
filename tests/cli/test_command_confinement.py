"""`--untrusted`: what a command line lets its process read and write, and a few runs that are confined for real."""

import json
import os
import subprocess
import sys
from pathlib import Path

import click
import pytest

from mjrun.cli.command_confinement import confinement_of
from mjrun.cli.commands.diff import diff_golden
from mjrun.cli.main import group, run
from mjrun.confinement import landlock
from tests.cases import cases
from tests.conftest import Command
from tests.demonstration_files import recorded_states, write_demonstrations
from tests.processes import PATIENCE

ROOT = Path(__file__).parents[2]
MODEL = '<mujoco><worldbody><body><joint name="j" type="slide"/><geom size=".1"/></body></worldbody></mujoco>'


# A command line that runs mjrun, and code of an attacker as soon as the process has confined itself.
TRIES_PACKAGES = """
import sys
import mjrun.cli.simulation_command as command
def work():
    import library, module
    try:
        secret = open(library.__file__.replace("library/__init__.py", "secret")).read()
    except PermissionError:
        secret = "refused"
    print(f"library {library.value}, module {module.value}, secret {secret}", file=sys.stderr)
command.import_mujoco = work
from mjrun.__main__ import main
main()
"""
TRIES_DESCRIPTORS = """
import os, sys
import mjrun.cli.simulation_command as command
def work():
    names = [name for name in os.listdir("/dev/fd") if int(name) > 2 and os.path.exists(f"/dev/fd/{name}")]
    print("inherited:", [n for n in names if "secret" in os.readlink(f"/dev/fd/{n}")], file=sys.stderr)
command.import_mujoco = work
from mjrun.__main__ import main
main()
"""


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a model in `model`, a table in `tables`, a `study` and a folder `out`, in which commands run."""
    for folder in ("model", "tables", "out", "study"):
        (tmp_path / folder).mkdir()
    (tmp_path / "model/m.xml").write_text(MODEL)
    (tmp_path / "model/doc.yaml").write_text("model: m.xml\n")
    (tmp_path / "tables/ctrl.csv").write_text("time,ctrl/a\n0,0\n")
    write_demonstrations(tmp_path / "model/d.hdf5", {"demo_1": recorded_states()})
    for file in ("tables/d.hdf5", "study/study.json", "study/results.csv"):
        (tmp_path / file).touch()
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tables/ci.md").touch()
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", "tables/ci.md")
    return tmp_path


def places(name: str, *arguments: str) -> dict[str, list[str]]:
    """The folders and files that a command line lets its process read and write, relative to the working directory."""
    command = group.get_command(click.Context(group), name)
    assert command
    made = confinement_of(command.make_context(name, [*arguments]))
    values = {"roots": made.roots, "files": made.files, "written": made.written}
    return {key: sorted(os.path.relpath(path) for path in paths) for key, paths in values.items()}


@pytest.mark.usefixtures("place")
@cases("line, roots, files, written")
def test_what_a_line_names_is_what_its_process_may_touch(
    line: str, roots: list[str], files: list[str], written: list[str]
) -> None:
    found = places(*line.split())
    beside = {f"{file}{end}" for file in files for end in (".json", ".data")}  # of a table, of a network
    assert found["roots"] == roots
    assert sorted(set(found["files"]) - beside) == files
    assert found["written"] == written


@pytest.mark.usefixtures("place")
@pytest.mark.parametrize("name", ["info", "plot"])
def test_a_name_that_is_too_long_is_that_of_no_file(name: str) -> None:
    assert places(name, "x" * 5000, *["-o", "p.png"] * (name == "plot")).get("files") == []


def mjrun(*line: str) -> subprocess.CompletedProcess[str]:
    done = Command(Path.cwd())(*line)
    return subprocess.CompletedProcess(done.args, done.returncode, done.stdout.decode(), done.stderr.decode())


def test_a_confined_process_measures_and_says_what_confined_it(place: Path) -> None:
    done = mjrun("trace", "model/m.xml", "--steps", "2", "-o", "out/t.csv", "--untrusted", "--json")
    assert done.returncode == 0, done.stderr
    by = f"Landlock {landlock.version()}" if landlock.version() else "checks of paths"
    assert json.loads(done.stdout)["untrusted"]["files"] == by
    assert f"mjrun: untrusted: files are confined by {by}" in done.stderr
    assert (place / "out/t.csv").exists()


def test_a_confined_process_replays_a_demonstration(place: Path) -> None:
    done = mjrun("trace", "model/d.hdf5:demo_1", "--rate", "20", "-o", "out/t.csv", "--untrusted")
    assert done.returncode == 0, done.stderr
    assert len((place / "out/t.csv").read_text().splitlines()) == 6


def test_packages_in_pythonpath_are_imported_and_what_lies_beside_them_is_not_read(place: Path) -> None:
    packages = place / "packages"
    (packages / "library").mkdir(parents=True)
    (packages / "library/__init__.py").write_text("value = 3\n")
    (packages / "module.py").write_text("value = 4\n")
    (packages / "secret").write_text("hunter2")
    environment = {**os.environ, "PYTHONPATH": f"{packages}{os.pathsep}{ROOT}"}
    command = [sys.executable, "-c", TRIES_PACKAGES, "info", "model/m.xml", "--untrusted"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=PATIENCE)
    assert done.returncode == 0, done.stderr
    assert "library 3, module 4, secret " + ("refused" if landlock.version() else "hunter2") in done.stderr


def test_descriptors_that_a_command_was_started_with_are_closed(place: Path) -> None:
    (place / "secret").write_text("hunter2")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with (place / "secret").open() as secret:
        line = [sys.executable, "-c", TRIES_DESCRIPTORS, "info", "model/m.xml", "--untrusted"]
        inherited = (secret.fileno(),)
        done = subprocess.run(
            line, capture_output=True, text=True, env=environment, pass_fds=inherited, timeout=PATIENCE
        )
    assert done.returncode == 0, done.stderr
    assert "inherited: []" in done.stderr


def test_a_confined_fix_changes_files_beside_the_model_and_no_others(place: Path) -> None:
    part = "<mujocoinclude><option mpr_iterations='5'/></mujocoinclude>"
    (place / "part.xml").write_text(part)
    (place / "model/link.xml").symlink_to("../part.xml")
    (place / "model/m.xml").write_text(f'<mujoco><option mpr_tolerance="1"/>{MODEL.partition(">")[2]}')
    done = mjrun("check", "model", "--fix", "--untrusted", "--steps", "0")
    assert "ccd_tolerance" in (place / "model/m.xml").read_text(), done.stderr
    (place / "model/m.xml").write_text('<mujoco><include file="link.xml"/></mujoco>')
    done = mjrun("check", "model", "--fix", "--untrusted", "--steps", "0", "--json")
    assert json.loads(done.stdout)["fixed"] == []
    assert (place / "part.xml").read_text() == part


@pytest.mark.usefixtures("place")
@pytest.mark.parametrize("name", ["root/x.xml", "cwd/x.xml", "", "status", "task/PID/root"])
@pytest.mark.slow
def test_a_model_cannot_ask_which_processes_there_are(name: str) -> None:
    messages: set[str] = set()
    for pid in (1, os.getppid(), 2**22 + 1):  # two that there are, and one that cannot be
        text = f"/proc/{pid}/{name}".replace("PID", str(pid))
        Path("model/m.xml").write_text(f'<mujoco><include file="{text}"/></mujoco>')
        done = mjrun("info", "model/m.xml", "--untrusted")
        assert done.returncode == 3
        messages.add(done.stderr.replace(text, "PATH"))
    assert len(messages) == 1, messages


def test_a_model_that_names_a_file_outside_is_refused_without_a_look_at_it(place: Path) -> None:
    (place / "secret").write_text("hunter2")
    (place / "model/m.xml").write_text('<mujoco><include file="../secret"/></mujoco>')
    done = mjrun("info", "model/m.xml", "--untrusted")
    assert done.returncode == 3
    assert "m.xml:1: '../secret' is outside the folder that files are read from" in done.stderr
    assert "hunter2" not in done.stderr


@pytest.mark.usefixtures("place", "own_signals")
@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("info model/m.xml --untrusted", "--untrusted works only for mjrun as a command"),
        ("info model/m.xml --root .", "--root requires --untrusted"),
        ("info model/m.xml --limit time=3", "--limit requires --untrusted"),
    ],
)
def test_what_cannot_be_meant_is_refused(line: str, message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(line.split()) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("name", ["time", "memory", "file"])
def test_a_limit_that_the_system_cannot_set_is_refused(place: Path, name: str) -> None:
    done = mjrun("info", "model/m.xml", "--untrusted", "--limit", f"{name}=1e13")
    assert done.returncode == 2, done.stderr
    assert f"--limit {name}: '1e+13' is not at most 1,000,000,000" in done.stderr


def test_every_command_that_reads_files_has_the_option() -> None:
    context = click.Context(group)
    commands = {name: group.get_command(context, name) for name in group.list_commands(context)}
    having = {name for name, each in commands.items() if each and "untrusted" in {param.name for param in each.params}}
    assert set(commands) - having == {"completion", "doctor", "examples", "schema", "skill"}
    assert "untrusted" in {param.name for param in diff_golden.params}


@pytest.mark.slow
def test_tables_and_studies_of_strangers_are_plotted_from_where_they_lie(place: Path) -> None:
    (place / "study/results.parquet").symlink_to("/etc/hostname")
    made = mjrun("plot", "tables/ctrl.csv", "-o", "out/p.png", "--untrusted", "--json")
    assert made.returncode == 0, made.stderr
    assert json.loads(made.stdout)["untrusted"]["roots"] == []
    assert (place / "out/p.png").exists()
    for table in ("study", "tables/missing.csv"):
        refused = mjrun("plot", table, "-o", "out/q.png", "--untrusted")
        assert refused.returncode == 7, refused.stderr
    assert [path.name for path in (place / "out").iterdir()] == ["p.png"]


@pytest.mark.slow
def test_missing_folders_of_all_outputs_are_made_and_go_if_nothing_is_published(place: Path) -> None:
    outputs = {"-o": "new/deep/t.csv", "--recording": "new/r.npz", "--manifest": "other/m.json"}
    named = [text for pair in outputs.items() for text in pair]
    line = ["trace", "model/m.xml", "--untrusted", "--duration", "0.1", *named]
    before = sorted(place.rglob("*"))
    for wrong, code in ((("--probe", "none"), 2), (("--limit", "file=0.001"), 4)):
        failed = mjrun(*line, *wrong)
        assert failed.returncode == code, failed.stderr
        assert sorted(place.rglob("*")) == before
    done = mjrun(*line)
    assert done.returncode == 0, done.stderr
    assert all((place / path).is_file() for path in outputs.values())

    (place / "gone").symlink_to("nowhere")
    for path in ("gone/t.csv", "tables/ctrl.csv/t.csv"):
        refused = mjrun("trace", "model/m.xml", "--untrusted", "-o", path)
        assert refused.returncode == 7, refused.stderr
    assert not (place / "nowhere").exists()


@pytest.mark.parametrize("line", ["trace model/m.xml -o out/t.csv", "trace model/m.xml -o out/t.npz"])
def test_a_file_beyond_its_limit_ends_the_command_as_promised(place: Path, line: str) -> None:
    done = mjrun(*line.split(), "--duration", "100", "--untrusted", "--limit", "file=1")
    assert done.returncode == 4, done.stderr
    assert "it wrote a larger file than its limit allows" in done.stderr
    assert "--limit file=… allows more" in done.stderr
    assert list((place / "out").iterdir()) == []


@pytest.mark.gl
def test_a_video_beyond_the_limit_of_a_file_ends_the_command_as_promised(place: Path) -> None:
    line = "video model/m.xml -o out/v.rgb --size 320x240 --duration 1 --quality draft --jobs 1"
    done = mjrun(*line.split(), "--untrusted", "--limit", "file=1")
    assert done.returncode in (4, 5), done.stderr
    assert "--limit file=… allows more" in done.stderr
    assert list((place / "out").iterdir()) == []
