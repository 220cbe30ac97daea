"""A process that gives up capabilities has none but those on files, and gets none back by a program that it starts."""

import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="capabilities are Linux's")

TRY = """
import re, subprocess
from mjrun.confinement.self_confinement import drop_capabilities
def sets(status):
    return [int(re.search(f"Cap{name}:\\\\s*(\\\\w+)", status)[1], 16) for name in ("Inh", "Prm", "Eff", "Bnd", "Amb")]
print(*sets(open("/proc/self/status").read()))
drop_capabilities()
print(*sets(open("/proc/self/status").read()))
print(*sets(subprocess.run(["cat", "/proc/self/status"], capture_output=True, text=True).stdout))
"""
ON_FILES = 0b1110  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH, CAP_FOWNER: see capabilities(7)


def test_only_capabilities_on_files_are_left() -> None:
    done = subprocess.run([sys.executable, "-c", TRY], capture_output=True, text=True, check=True)
    before, after, started = ([int(word) for word in line.split()] for line in done.stdout.splitlines())
    has_some = bool(before[1])
    for inherited, permitted, effective, bounding, ambient in (after, started):
        assert inherited | permitted | effective | ambient | (bounding if os.getuid() == 0 else 0) <= ON_FILES
        assert permitted == effective == before[1] & ON_FILES
    assert has_some or os.getuid()
