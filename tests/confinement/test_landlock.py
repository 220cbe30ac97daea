"""Landlock lets a process at the files that rules name, and at no others; a thread of it may be let at fewer."""

import subprocess
import sys
from pathlib import Path

import pytest

from mjrun.confinement import landlock

pytestmark = pytest.mark.skipif(not landlock.version(), reason="this kernel has no Landlock")

TRY = """
import sys, threading
from mjrun.confinement.landlock import READ, WRITE, restrict
folder = sys.argv[1]
def can(path, mode):
    try:
        open(path, mode).close()
    except PermissionError:
        return "-"
    return "+"
def all_of():
    names = ("read/in", "r"), ("read/link", "r"), ("read/in", "a"), ("write/new", "w"), ("write/new", "r"), ("out", "r")
    return " ".join(can(f"{folder}/{name}", mode) for name, mode in names)
alone = []
def work():
    restrict([(f"{folder}/read", READ)], network=False)
    alone.append(all_of())
thread = threading.Thread(target=work)
thread.start()
thread.join()
before = all_of()
restrict([(f"{folder}/read", READ), (f"{folder}/write", WRITE), (f"{folder}/missing", READ)])
print(alone[0], before, all_of(), sep="\\n")
"""


def test_a_process_opens_what_rules_name_and_a_thread_may_open_less(tmp_path: Path) -> None:
    for folder in ("read", "write"):
        (tmp_path / folder).mkdir()
    (tmp_path / "read/in").write_text("")
    (tmp_path / "write/new").write_text("")
    (tmp_path / "out").write_text("secret")
    (tmp_path / "read/link").symlink_to(tmp_path / "out")
    done = subprocess.run([sys.executable, "-c", TRY, str(tmp_path)], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["+ - - - - -", "+ + + + + +", "+ - - + + -"]
