"""Processes that are started before they are needed."""

import subprocess
import sys

from mjrun.study.worker_process import new_process, start_early


def test_the_process_that_was_started_early_is_the_next() -> None:
    start_early()
    early, other = new_process(), new_process()
    assert early[1].pid < other[1].pid or early[1].pid != other[1].pid
    for connection, process in (early, other):
        assert process.running
        connection.close()
        process.end()


def test_starting_one_needs_no_mujoco() -> None:
    code = "import sys, mjrun.study.worker_process; sys.exit('mujoco' in sys.modules or 'numpy' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
