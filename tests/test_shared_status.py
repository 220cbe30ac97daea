"""The status of a process can be read by another process after it has died."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from mjrun import shared_status
from mjrun.shared_status import (
    SIZE,
    ProcessActivityMemory,
    completing,
    doing,
    note_child,
    note_end_of_child,
    note_folder,
    note_heard,
)


@pytest.fixture
def memory() -> Iterator[ProcessActivityMemory]:
    memory = ProcessActivityMemory()
    shared_status.record_status_in(memory)
    yield memory
    shared_status.record_status_in(None)


def test_activities_nest_and_the_last_model_is_kept(memory: ProcessActivityMemory) -> None:
    assert memory.read() == shared_status.ProcessStatus()
    with doing("reading", Path("a\udcff.xml")):
        assert (memory.read().activity, memory.read().model) == ("reading", "a\udcff.xml")
        with doing("simulating"):
            assert (memory.read().activity, memory.read().model) == ("simulating", "a\udcff.xml")
        assert memory.read().activity == "reading"
    assert (memory.read().activity, memory.read().model) == ("", "a\udcff.xml")


def test_an_activity_ends_with_its_block_however_that_ends(memory: ProcessActivityMemory) -> None:
    with pytest.raises(KeyError), doing("drawing"):
        raise KeyError
    assert memory.read().activity == ""


def test_folders_and_children_are_noted(memory: ProcessActivityMemory, tmp_path: Path) -> None:
    note_folder(tmp_path)
    note_folder(tmp_path)
    note_child(11)
    note_child(12)
    note_end_of_child(11)
    note_end_of_child(13)
    assert (memory.read().folders, memory.read().children) == ([str(tmp_path)], [12])


def test_what_must_be_completed_is_noted(memory: ProcessActivityMemory) -> None:
    assert not memory.completing
    with completing():
        assert memory.completing
    assert not memory.completing


def test_a_notice_that_is_too_long_leaves_the_older_one(memory: ProcessActivityMemory) -> None:
    with doing("reading", "a"), doing("reading", "b" * SIZE):
        assert memory.read().model == "a"


def test_the_parent_reads_what_a_killed_child_has_noted(memory: ProcessActivityMemory) -> None:
    child = os.fork()
    if not child:
        with doing("compiling", "robot.xml"):
            note_heard()
            os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(child, 0)
    assert memory.heard
    assert (memory.read().activity, memory.read().model) == ("compiling", "robot.xml")


def test_nothing_is_noted_without_memory() -> None:
    note_heard()
    with doing("drawing", "a.xml"):
        note_child(1)
    note_end_of_child(1)
