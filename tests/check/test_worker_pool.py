"""Theorems about the processes that check models."""

import subprocess
import sys
from pathlib import Path

from mjrun.check.worker_pool import CheckProcesses, WorkerTask
from tests.check.models import PASSIVE, checked, write


def test_nothing_is_written_and_nothing_is_read_from_stdin() -> None:
    write("nan.xml", PASSIVE.format('damping="nan"'))
    before = sorted(Path().iterdir())
    code = "from mjrun.check.check import Check; print(Check(['nan.xml']).run().models[0].findings[0].code)"
    done = subprocess.run([sys.executable, "-c", code], input="unread", capture_output=True, text=True)
    assert done.stdout == "MJ100\n"
    assert sorted(Path().iterdir()) == before


def test_a_folder_of_models_is_no_place_for_modules() -> None:
    for name in ("json.py", "mujoco.py", "numpy.py", "mjrun.py"):
        write(name, "raise SystemExit(9)")
    assert checked(write("fine.xml", PASSIVE.format(""))).code == 0


def test_workers_that_were_ended_start_no_more() -> None:
    workers = CheckProcesses()
    workers.end()
    assert workers.run(WorkerTask("a.xml", (), 0, 1, 1)).messages == ()
