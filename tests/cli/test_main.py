"""The command as a whole: exit codes, streams, signals, pipes."""

from __future__ import annotations

import errno
import json
import marshal
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import click
import mujoco
import pytest

from mjrun import __version__
from mjrun.cli.main import COMMANDS, group
from mjrun.document.json_schema import failure_schema
from mjrun.errors import EncoderError, NoRendererError, TerminatedError
from tests.cases import cases
from tests.document.schema_oracle import fits
from tests.processes import PATIENCE

if TYPE_CHECKING:
    from tests.conftest import Command

SMALL = ("--size", "64x48", "--quality", "draft")


def test_help_lists_every_command(mjrun_here: Command) -> None:
    done = mjrun_here("--help")
    assert done.returncode == 0
    assert all(f"  {name}" in done.stdout.decode() for name in COMMANDS)
    assert mjrun_here().stdout == done.stdout


def test_the_version_is_the_package_s(mjrun: Command) -> None:
    assert mjrun("--version").stdout.decode() == f"mjrun {__version__}\n"


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_of_every_command_has_help(name: str) -> None:
    command = group.get_command(None, name)  # type: ignore[arg-type]
    assert command
    assert command.help
    context = click.Context(command)
    records = [param.get_help_record(context) for param in command.params if isinstance(param, click.Option)]
    assert all(record and record[1] for record in records)


@cases("arguments, code, message")
def test_a_mistake_is_explained_on_stderr_and_leaves_nothing(
    mjrun_here: Command, swing: Path, arguments: list[str], code: int, message: str
) -> None:
    swing.rename(mjrun_here.folder / "swing.xml")
    done = mjrun_here(*arguments)
    error = done.stderr.decode()
    assert (done.returncode, done.stdout) == (code, b"")
    assert error.startswith("mjrun: error: ")
    assert message in error
    assert "Traceback" not in error
    assert mjrun_here.files() == ["swing.xml"]


@pytest.mark.parametrize(
    ("line", "outputs"),
    [
        ("trace swing.xml --duration .01 -o a/b/t.csv", ["a/b/t.csv"]),
        ("trace swing.xml --duration .01 -o a/t.csv --contacts a/c/c.csv", ["a/t.csv", "a/c/c.csv"]),
        ("trace swing.xml --duration .01 -o t.csv --recording a/r.npz --manifest b/m.json", ["a/r.npz", "b/m.json"]),
        ("trace swing.xml --duration .01 -o t.csv --save-key a/k.xml:end", ["a/k.xml"]),
        ("bench swing.xml --steps 20 --repeats 2 --save a/b/base.json --summary c/s.md", ["a/b/base.json", "c/s.md"]),
        ("plot run.csv -o a/p.png --html b/c/p.html", ["a/p.png", "b/c/p.html"]),
        pytest.param("image swing.xml --size 64x48 -o a/i.png", ["a/i.png"], marks=pytest.mark.gl),
        pytest.param("image swing.xml --size 64x48 --view seg -o a/i.png", ["a/i.labels.json"], marks=pytest.mark.gl),
        pytest.param(
            "video swing.xml --size 64x48 --duration .1 -o a/b/v.mp4 --calibration c/c.json",
            ["a/b/v.mp4", "c/c.json"],
            marks=pytest.mark.gl,
        ),
        pytest.param(
            "video swing.xml --size 64x48 --duration .1 -o a/b/turn/", ["a/b/turn/000000.png"], marks=pytest.mark.gl
        ),
        pytest.param(
            "video swing.xml --size 64x48 --duration .1 -o a/b/f_%03d.png", ["a/b/f_000.png"], marks=pytest.mark.gl
        ),
    ],
)
def test_every_output_makes_its_folders(mjrun_here: Command, swing: Path, line: str, outputs: list[str]) -> None:
    swing.rename(mjrun_here.folder / "swing.xml")
    (mjrun_here.folder / "run.csv").write_text("time,x\n0,1\n1,2\n")
    done = mjrun_here(*line.split())
    assert done.returncode == 0, done.stderr
    assert all((mjrun_here.folder / path).is_file() for path in outputs)


@cases("line, code, message")
def test_an_output_does_not_replace_what_users_write(
    mjrun_here: Command, swing: Path, line: str, code: int, message: str
) -> None:
    content = swing.read_bytes()
    swing.rename(mjrun_here.folder / "swing.xml")
    for name in ("other.xml", "study.yaml", "act.py", "conf.json"):
        (mjrun_here.folder / name).write_bytes(content)
    done = mjrun_here(*line.split())
    assert (done.returncode, message in done.stderr.decode()) == (code, True), done.stderr
    for path in mjrun_here.folder.iterdir():
        assert path.read_bytes() == content


@cases("line, code")
def test_a_command_that_fails_leaves_no_folder(mjrun_here: Command, swing: Path, line: str, code: int) -> None:
    swing.rename(mjrun_here.folder / "swing.xml")
    assert mjrun_here(*line.split()).returncode == code
    assert [path.name for path in mjrun_here.folder.iterdir()] == ["swing.xml"]


@cases("arguments")
def test_an_input_other_than_the_model_that_is_missing_ends_with_seven(
    mjrun_here: Command, swing: Path, arguments: list[str]
) -> None:
    swing.rename(mjrun_here.folder / "swing.xml")
    done = mjrun_here(*arguments)
    assert (done.returncode, done.stdout) == (7, b"")
    assert b"mjrun: error: none." in done.stderr
    assert mjrun_here.files() == ["swing.xml"]


@pytest.mark.parametrize(
    "arguments", [["sweep", "scene:pendulum", "--vary", "opt.timestep=1e-3", "--dry-run"], ["check", "scene:pendulum"]]
)
def test_what_renders_nothing_does_not_mind_an_unknown_backend(mjrun: Command, arguments: list[str]) -> None:
    assert mjrun(*arguments, env={"MUJOCO_GL": "elg"}).returncode == 0


def test_a_bad_environment_is_a_wrong_option(mjrun: Command, swing: Path) -> None:
    done = mjrun("video", swing, env={"MUJOCO_GL": "elg"})
    assert done.returncode == 2
    assert b"no OpenGL backend 'elg'" in done.stderr


def test_without_any_renderer_the_packages_are_named(mjrun: Command, swing: Path) -> None:
    hidden = {"__EGL_VENDOR_LIBRARY_FILENAMES": "/none.json", "DISPLAY": "", "WAYLAND_DISPLAY": ""}
    done = mjrun("video", swing, "--gl", "egl", env=hidden)
    assert done.returncode == 5
    assert b"no working renderer was found" in done.stderr
    assert b"to draw in software: " in done.stderr
    assert mjrun.files() == []


def test_an_unstable_simulation_ends_with_four_and_names_step_time_and_joint(
    mjrun_here: Command, exploding: Path
) -> None:
    done = mjrun_here("video", exploding, "--key", "fast", *SMALL)
    assert done.returncode == 4
    assert b"became unstable at step 6, time 0.18 s: the acceleration of joint 'a'" in done.stderr
    assert mjrun_here.files() == []


def test_a_bug_is_reported_in_one_line(mjrun: Command, swing: Path) -> None:
    (mjrun.folder / "imageio_ffmpeg.py").write_text("def get_ffmpeg_exe():\n    return 1 / 0\n")
    search = {"PYTHONPATH": f"{mjrun.folder}{os.pathsep}{Path(__file__).parents[2]}"}
    quiet = mjrun("video", swing, *SMALL, env=search)
    assert quiet.returncode == 70
    assert b"a bug in mjrun: ZeroDivisionError: division by zero (imageio_ffmpeg.py:2)" in quiet.stderr
    assert b"Traceback" not in quiet.stderr


def test_a_working_folder_that_has_been_removed_is_no_bug(mjrun_here: Command, swing: Path) -> None:
    mjrun_here.folder.rmdir()
    document = swing.with_name("swing.yaml")
    document.write_text(f"model: {swing}\nduration: 0.1\ntraces: [{{output: a.csv}}]\n")
    for command in (
        ("trace", swing, "--steps", "1", "-o", "a.csv"),
        ("run", document, "-o", "out"),
        ("check", swing),
        ("sweep", swing, "--vary", "timestep=0.001,0.002", "--steps", "1", "-o", swing.with_name("study")),
        ("trace", swing, "--steps", "1", "-o", swing.with_name("a.csv"), "--if-changed"),
    ):
        done = mjrun_here(*command)
        assert done.returncode == 7
        assert done.stderr == b"mjrun: error: .: the working folder has been removed\n  cd to another folder first\n"


def test_a_simulation_that_needs_more_memory_than_there_is_is_no_bug(
    mjrun_here: Command, swing: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_memory(*_: object) -> mujoco.MjData:
        raise mujoco.FatalError("Could not allocate memory")  # as under a limit of the process

    monkeypatch.setattr(mujoco, "MjData", no_memory)
    done = mjrun_here("trace", swing, "--steps", "2", "-o", "a.csv")
    assert done.returncode == 3
    assert done.stderr.startswith(b"mjrun: error: memory ran out: Could not allocate memory\n")
    assert mjrun_here.files() == []


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGHUP, 129)], ids=str)
@pytest.mark.slow
def test_a_signal_leaves_the_old_video_and_nothing_else(
    mjrun: Command, swing: Path, number: signal.Signals, code: int
) -> None:
    (mjrun.folder / "swing.mp4").write_text("old")
    child = mjrun.start("video", swing, "--duration", "1000", "--size", "320x240")
    while not list(mjrun.folder.glob("*.part")):
        assert child.poll() is None
        time.sleep(0.01)
    time.sleep(0.2)
    for pause in (0, 0.02, 0.02, 0.05):  # people press Ctrl-C more than once
        time.sleep(pause)
        child.send_signal(number)
    out, err = child.communicate(timeout=PATIENCE)
    assert (child.returncode, out) == (code, b"")
    assert b"Traceback" not in err
    assert b"Exception ignored" not in err
    assert mjrun.files() == ["swing.mp4"]
    assert (mjrun.folder / "swing.mp4").read_text() == "old"


def test_what_comes_of_a_signal_is_no_bug(mjrun: Command, swing: Path) -> None:
    """A signal during an import may come out as something else; so may what follows from it."""
    hook = "import os, signal, sys\n\ndef get_ffmpeg_exe():\n"
    hook += (
        "    try:\n        os.kill(os.getpid(), signal.SIGTERM)\n    except BaseException:\n        raise SystemError\n"
    )
    (mjrun.folder / "imageio_ffmpeg.py").write_text(hook)
    search = {"PYTHONPATH": f"{mjrun.folder}{os.pathsep}{Path(__file__).parents[2]}"}
    done = mjrun("video", swing, *SMALL, env=search)
    assert (done.returncode, done.stderr) == (143, b"mjrun: error: ended by SIGTERM\n")


def test_a_signal_in_a_finalizer_ends_the_work_after_it() -> None:
    """Python drops what is raised in a finalizer, and with it the rest of the finalizer."""
    code = """
import os, signal, time, weakref
from mjrun.cli.main import _end

def finalize():
    os.kill(os.getpid(), signal.SIGTERM)
    print("finalized")

class Owner: pass

signal.signal(signal.SIGTERM, _end)
owner = Owner()
weakref.finalize(owner, finalize)
try:
    del owner
    time.sleep(60)
except BaseException as error:
    print(type(error).__name__)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=PATIENCE)
    assert (done.stdout, done.stderr) == (b"finalized\nTerminatedError\n", b"")


def test_a_run_within_another_program_leaves_signals_to_be_heard() -> None:
    code = "import signal; from mjrun.cli.main import run; run(['--version']); signal.raise_signal(signal.SIGINT)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=PATIENCE, check=False)
    assert b"KeyboardInterrupt" in done.stderr


def test_a_copy_of_a_prepared_interpreter_does_what_a_new_one_does(mjrun: Command, swing: Path) -> None:
    line = ["trace", str(swing), "--steps", "2", "--csv"]
    new = subprocess.run([sys.executable, "-m", "mjrun", *line], cwd=mjrun.folder, capture_output=True)
    for _ in range(2):  # the first start in an environment is a new interpreter
        done = mjrun(*line)
        assert (done.returncode, done.stdout, done.stderr) == (0, new.stdout, new.stderr)


@pytest.mark.slow
def test_a_reader_that_goes_away_ends_the_video_quietly(mjrun: Command, swing: Path) -> None:
    with mjrun.start("video", swing, "-o", "-", "-q", "--duration", "100", "--jobs", "1", *SMALL) as child:
        assert child.stdout
        assert child.stderr
        assert child.stdout.read(100)
        child.stdout.close()
        assert child.stderr.read() == b""
    assert child.returncode == 141


def test_a_closed_stdout_ends_quietly_too(mjrun: Command, swing: Path) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    with mjrun.start("info", swing, stdout=writing) as child:
        assert child.stderr
        assert child.stderr.read() == b""
    os.close(writing)
    assert child.returncode == 141


def test_help_into_a_closed_pipe_ends_quietly() -> None:
    done = subprocess.run(
        [f"'{sys.executable}' -m mjrun video --help | true; exit ${{PIPESTATUS[0]}}"],
        shell=True,
        executable="/bin/bash",
        capture_output=True,
    )
    assert done.returncode in (0, 141)  # `true` may go away before or after the text
    assert done.stderr == b""


def test_a_document_goes_to_stdout_as_json(mjrun_here: Command, swing: Path) -> None:
    done = mjrun_here("video", swing, "--json", "--duration", "0.1", "--fps", "20", *SMALL)
    assert done.returncode == 0
    found = json.loads(done.stdout)
    assert (found["path"], found["frames"], found["size"], found["codec"]) == ("swing.mp4", 2, [64, 48], "h264")
    assert found["renderer"]


@cases("arguments, code, kind, message")
def test_json_has_an_error_for_every_exit_code(
    mjrun_here: Command,
    swing: Path,
    exploding: Path,
    arguments: list[str],
    code: int,
    kind: str,
    message: str,
) -> None:
    swing.rename(mjrun_here.folder / "swing.xml")
    exploding.rename(mjrun_here.folder / "exploding.xml")
    for name, end in (("a", 1), ("b", 2)):
        (mjrun_here.folder / f"{name}.csv").write_text(f"time,energy/total\n0,{end}\n")
    done = mjrun_here(*arguments, "--json")
    document = json.loads(done.stdout)
    error = document["error"]
    assert (done.returncode, error["exit_code"], error["kind"]) == (code, code, kind)
    assert message in error["message"]
    schema = failure_schema()
    assert fits(document, schema, schema)


@pytest.mark.parametrize(
    ("error", "code", "kind"),
    [
        (NoRendererError({"egl": "none"}, "install one"), 5, "NoRendererError"),
        (EncoderError("it failed", "log"), 6, "EncoderError"),
        (KeyError("x"), 70, "InternalError"),
        (MemoryError(), 3, "OutOfMemoryError"),
        (OSError(errno.ENOMEM, "Cannot allocate memory"), 3, "OutOfMemoryError"),
        (OSError(errno.EMFILE, "Too many open files"), 7, "SystemLimitError"),
        (OSError(errno.ENFILE, "Too many open files in system"), 7, "SystemLimitError"),
        (BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable"), 7, "SystemLimitError"),
        (BlockingIOError(errno.EAGAIN, "write could not complete without blocking", 0), 70, "InternalError"),
        (RuntimeError("can't start new thread"), 7, "SystemLimitError"),
        (ValueError("thread constructor failed: Resource temporarily unavailable"), 7, "SystemLimitError"),
        (KeyboardInterrupt(), 130, "KeyboardInterrupt"),
        (TerminatedError(signal.SIGTERM), 143, "TerminatedError"),
    ],
)
def test_json_has_an_error_whatever_is_raised(
    mjrun_here: Command, monkeypatch: pytest.MonkeyPatch, error: BaseException, code: int, kind: str
) -> None:
    def fail(_: object) -> None:
        raise error

    monkeypatch.setattr("mjrun.doctor.examine", fail)
    done = mjrun_here("doctor", "--json")
    failure = json.loads(done.stdout)["error"]
    assert (done.returncode, failure["exit_code"], failure["kind"]) == (code, code, kind)
    assert failure["message"].splitlines()[0] in done.stderr.decode()


def test_without_json_a_failure_prints_nothing_on_stdout(mjrun_here: Command) -> None:
    assert mjrun_here("info", "none.xml").stdout == mjrun_here("info", "none.xml", "--", "--json").stdout == b""


@pytest.mark.parametrize(("flags", "code"), [([], 0), (["-X", "utf8=0"], 3)])
def test_without_utf8_it_starts_anew_once(tmp_path: Path, flags: list[str], code: int) -> None:
    (tmp_path / "Kübel.xml").write_text("<mujoco/>")
    environment = {**os.environ, "LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}
    command = [sys.executable, *flags, "-m", "mjrun", "info", "Kübel.xml"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, timeout=PATIENCE)
    assert done.returncode == code
    assert b"Traceback" not in done.stderr


def test_ipython_outlives_a_command_that_it_runs() -> None:
    pytest.importorskip("IPython")
    code = """
import os
from IPython.core.interactiveshell import InteractiveShell
shell = InteractiveShell.instance()
shell.run_line_magic("run", "-m mjrun schema error")
print(os.getpid())
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        schema, _, pid = process.communicate()[0].rstrip().rpartition("\n")
    assert json.loads(schema) == failure_schema()
    assert int(pid) == process.pid


def test_a_limit_on_the_size_of_files_truncates_no_bytecode(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    limit = 16384  # more than the modules have that are imported before the limit is known
    environment = {**os.environ, "PYTHONPYCACHEPREFIX": str(tmp_path), "PYTHONDONTWRITEBYTECODE": ""}
    subprocess.run(
        [sys.executable, "-m", "mjrun", "--version"],
        env=environment,
        check=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    modules = list(tmp_path.rglob("mjrun/*.pyc"))
    assert modules
    for each in modules:
        marshal.loads(each.read_bytes()[16:])  # which raises an error at a premature end
