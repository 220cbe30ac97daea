"""Processes that are started before they are needed."""

import subprocess
import sys
from pathlib import Path

import pytest

from mjrun.study import worker_process
from mjrun.study.worker_process import new_process, start_early


def end(process: worker_process.Process) -> None:
    process[0].close()
    process[1].end()


def test_the_process_that_was_started_early_is_the_next() -> None:
    start_early()
    early = worker_process._waiting[-1][1]
    assert new_process() is early
    end(early)


def test_one_that_was_started_elsewhere_is_of_no_use(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    start_early()
    early = worker_process._waiting[-1][1]
    monkeypatch.chdir(tmp_path)
    other = new_process()
    assert other is not early
    assert other[1].running
    assert not early[1].running
    end(other)


def test_starting_one_needs_no_mujoco() -> None:
    code = "import sys, mjrun.study.worker_process; sys.exit('mujoco' in sys.modules or 'numpy' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
