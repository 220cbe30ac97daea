"""What a confined process can read, and how it is told; attackers are played by the scoreboard (inside_sandbox)."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from mjrun.confinement import landlock, seccomp
from mjrun.confinement.self_confinement import confined_load, means

# Reads files in the interpreter's folder, which is set to another one, from a confined process and where models load.
TRY_PREFIX = """
import sys, sysconfig
from pathlib import Path
prefix = Path(sys.argv[1])
from mjrun.confinement.confinement import Confinement
from mjrun.confinement.self_confinement import confine, confined_load, with_temporary
sys.prefix = sys.base_prefix = sys.exec_prefix = str(prefix)
confine(with_temporary(Confinement(())))
def readable():
    def can(path):
        try:
            return bool(path.read_text())
        except PermissionError:
            return False
    return [str(path.relative_to(prefix)) for path in files if can(path)]
files = [prefix / name for name in ("secret", "pyvenv.cfg", "home/secret", "lib/a.so", "bin/tool", "etc/shadow")]
print(readable(), confined_load(readable))
"""


@pytest.mark.skipif(not landlock.version(), reason="this kernel has no Landlock")
def test_of_the_interpreters_folder_only_libraries_are_read(tmp_path: Path) -> None:
    for name in ("secret", "pyvenv.cfg", "home/secret", "lib/a.so", "bin/tool", "etc/shadow"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("x")
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    command = [sys.executable, "-c", TRY_PREFIX, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=60)
    libraries = ["pyvenv.cfg", "lib/a.so"]
    assert (done.stderr, done.stdout.strip()) == ("", f"{[*libraries, 'bin/tool']} {libraries}")


@pytest.mark.skipif(sys.platform != "linux", reason="threads are counted by Linux")
def test_a_process_with_threads_is_not_confined_by_half() -> None:
    code = """
import threading
from mjrun.confinement.confinement import Confinement
from mjrun.confinement.self_confinement import confine
threading.Thread(target=threading.Event().wait, daemon=True).start()
confine(Confinement(()))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert "a process with several threads cannot be confined" in done.stderr


def test_what_is_not_confined_loads_where_it_is() -> None:
    assert confined_load(lambda: 3) == 3


def test_what_confines_is_named() -> None:
    files, network = means()
    assert files == (f"Landlock {landlock.version()}" if landlock.version() else "checks of paths")
    assert network.startswith("seccomp") == seccomp.is_known()
    assert "TCP" in means(serves=True)[1] or not network
