"""The command on a system without POSIX: its modules and functions are hidden from it and from what it starts."""

import ast
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet
import pytest

import mjrun
from tests.conftest import Command
from tests.platform.hidden_posix import MODULES
from tests.processes import command_line_of, wait_until

ROOT = Path(__file__).parents[2]
PACKAGE = Path(mjrun.__file__).parent
TRACE = ("trace", "scene:pendulum", "--steps", "20")
SWEEP = ("sweep", "scene:pendulum", "--vary", "opt.timestep=0.001,0.002,0.004", "--duration", "0.02", "--jobs", "2")

# Where POSIX may be used: in its own module, in the monitor that forks, in what confines a process on Linux, and before
# any bytecode is written.
HOMES = ("platform/posix.py", "cli/crash_monitor.py", "confinement/loopback_connector.py", "__main__.py")


@pytest.fixture(scope="module")
def bootstrap(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a `sitecustomize` that hides POSIX."""
    folder = tmp_path_factory.mktemp("bootstrap")
    (folder / "sitecustomize.py").write_text(
        f"import sys\nsys.path.append({str(ROOT)!r})\nfrom tests.platform.hidden_posix import hide\nhide()\n"
    )
    return folder


def without_posix(bootstrap: Path) -> dict[str, str]:
    """Returns the environment of a process without POSIX."""
    # Its temporary folder has no lock: other processes on this machine would take it for left behind.
    return {**os.environ, "PYTHONPATH": str(bootstrap), "TMPDIR": str(bootstrap)}


def run(folder: Path, *arguments: str, bootstrap: Path) -> "subprocess.CompletedProcess[str]":
    """Runs the command in a folder, without POSIX."""
    environment = without_posix(bootstrap)
    command = [sys.executable, "-m", "mjrun", *arguments]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def results(folder: Path) -> list[dict[str, object]]:
    """Returns the rows of a study, without the times that they took."""
    rows = pyarrow.parquet.read_table(folder / "results.parquet").to_pylist()
    return [{name: value for name, value in row.items() if not name.startswith("wall")} for row in rows]


def test_the_bootstrap_hides_posix(bootstrap: Path) -> None:
    code = "import os, signal; print(hasattr(os, 'fork'), hasattr(signal, 'SIGHUP')); import fcntl"
    environment = without_posix(bootstrap)
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)
    assert done.stdout == "False False\n"
    assert "ModuleNotFoundError" in done.stderr


def test_it_says_the_same(bootstrap: Path, mjrun_here: Command) -> None:
    arguments = ("check", "scene:pendulum")
    expected, done = mjrun_here(*arguments), run(mjrun_here.folder, *arguments, bootstrap=bootstrap)
    assert (done.returncode, done.stdout, done.stderr) == (0, expected.stdout.decode(), expected.stderr.decode())


def test_a_trace_is_the_same_bit_for_bit_and_is_plotted_and_compared(bootstrap: Path, mjrun_here: Command) -> None:
    folder = mjrun_here.folder
    assert mjrun_here(*TRACE, "-o", "normal.csv").returncode == 0
    (folder / "trace.csv").write_text("older")
    done = run(folder, *TRACE, "-o", "trace.csv", bootstrap=bootstrap)
    assert done.returncode == 0, done.stderr
    assert (folder / "trace.csv").read_bytes() == (folder / "normal.csv").read_bytes()

    done = run(folder, "plot", "trace.csv", "-o", "plot.png", bootstrap=bootstrap)
    assert done.returncode == 0, done.stderr
    assert (folder / "plot.png").read_bytes()[:4] == b"\x89PNG"
    done = run(folder, "diff", "trace.csv", "normal.csv", bootstrap=bootstrap)
    assert (done.returncode, "bit for bit" in done.stdout + done.stderr) == (0, True)
    assert mjrun_here.files() == ["normal.csv", "plot.png", "trace.csv"]


def test_a_study_on_two_processes_is_the_same_bit_for_bit(bootstrap: Path, mjrun_here: Command) -> None:
    assert mjrun_here(*SWEEP, "-o", "normal").returncode == 0
    done = run(mjrun_here.folder, *SWEEP, "-o", "hidden", bootstrap=bootstrap)
    assert done.returncode == 0, done.stderr
    rows = results(mjrun_here.folder / "hidden")
    assert len(rows) == 3
    assert rows == results(mjrun_here.folder / "normal")


def test_a_worker_that_ends_before_it_connects_is_reported(bootstrap: Path, tmp_path: Path) -> None:
    code = (
        "from mjrun import worker\n"
        "worker.serve_by_address = None\n"
        "worker.python_call = lambda *_, **__: [__import__('sys').executable, '-S', '-c', 'raise SystemExit(3)']\n"
        "one = worker.Worker('mjrun.study.point_server:PointSimulationServer')\n"
        "try:\n    one.ask('anything')\n"
        "except worker.WorkerEndedError as error:\n    print(error)\n"
        "finally:\n    one.close()\n"
    )
    environment = without_posix(bootstrap)
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.stdout == "ended with code 3\n", done.stderr


def test_a_worker_ends_when_its_parent_is_killed(bootstrap: Path, tmp_path: Path) -> None:
    code = (
        "import os\nfrom mjrun import worker\n"
        "one = worker.Worker('mjrun.study.point_server:PointSimulationServer')\n"
        "print(one.process.pid, flush=True)\nos.kill(os.getpid(), 9)\n"
    )
    environment = without_posix(bootstrap)
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    worker = int(done.stdout)
    wait_until(lambda: not command_line_of(worker))


def test_untrusted_files_are_refused_in_one_sentence(bootstrap: Path, tmp_path: Path) -> None:
    done = run(tmp_path, *TRACE, "--untrusted", bootstrap=bootstrap)
    assert done.returncode == 2
    reason = "--untrusted cannot confine anything on this system; run mjrun on Linux, or in a container"
    assert done.stderr.splitlines()[0] == f"mjrun: error: {reason}"
    assert not list(tmp_path.iterdir())


def nodes_of_modules_with(*words: str) -> Iterator[tuple[str, ast.AST]]:
    """Yields every node of the modules whose text contains a word, with the place of the module."""
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text("utf-8")
        if any(word in text for word in words):
            place = path.relative_to(PACKAGE).as_posix()
            yield from ((place, node) for node in ast.walk(ast.parse(text)))


def test_text_has_the_same_line_ends_on_every_system() -> None:
    writers = ("write_text", "TextIOWrapper")
    writes = [
        (place, node.lineno)
        for place, node in nodes_of_modules_with(*writers)
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and node.func.attr in writers
        and not any(keyword.arg == "newline" for keyword in node.keywords)
    ]
    assert writes == []


def test_posix_is_used_in_its_own_modules_only() -> None:
    users = {
        place
        for place, node in nodes_of_modules_with(*(f"import {name}" for name in MODULES))
        if isinstance(node, ast.Import) and any(alias.name in MODULES for alias in node.names)
    }
    assert users == {*HOMES}
