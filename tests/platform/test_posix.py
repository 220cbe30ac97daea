"""The functions of a POSIX system that the rest of the house tests only through others."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from mjrun.platform import posix, system
from tests.processes import command_line_of, wait_until


def test_a_posix_system_is_recognized() -> None:
    assert system.CAN_FORK
    assert system is posix


def test_a_pipe_shows_whether_it_is_full_and_read() -> None:
    reading, writing = os.pipe()
    posix.make_nonblocking(writing)
    assert not posix.is_full(writing)
    assert posix.wait_until_writable(writing, 0)
    with pytest.raises(BlockingIOError):  # noqa: PT012
        while True:
            os.write(writing, bytes(2**16))
    assert posix.is_full(writing)
    assert not posix.wait_until_writable(writing, 0.01)
    assert not posix.reader_is_gone(writing)
    os.close(reading)
    assert posix.reader_is_gone(writing)
    os.close(writing)


def test_a_descriptor_shows_whether_it_is_read_only() -> None:
    reading, writing = os.pipe()
    assert posix.is_read_only(reading)
    assert not posix.is_read_only(writing)
    copy = posix.duplicate(reading)
    assert copy > 2
    assert not os.get_inheritable(copy)
    for descriptor in (reading, writing, copy):
        os.close(descriptor)


def test_a_folder_of_any_depth_is_removed_and_links_in_it_are_not_followed(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "other/file").touch()
    (tmp_path / "deep").mkdir()
    folder = os.open(tmp_path / "deep", os.O_RDONLY)
    for _ in range(2000):
        os.symlink(tmp_path / "other", "link", dir_fd=folder)
        os.mkdir("inner", dir_fd=folder)
        inner = os.open("inner", os.O_RDONLY, dir_fd=folder)
        os.close(folder)
        folder = inner
    os.close(folder)
    posix.remove_folder(tmp_path / "deep")
    assert [path.name for path in tmp_path.rglob("*")] == ["other", "file"]


def test_a_hangup_ends_the_wait_for_it() -> None:
    reading, writing = os.pipe()
    waiting = threading.Thread(target=posix.wait_for_hangup, args=(reading,))
    waiting.start()
    assert waiting.is_alive()
    os.close(writing)
    waiting.join(10)
    assert not waiting.is_alive()
    os.close(reading)


def test_a_process_and_what_it_started_are_killed_together() -> None:
    script = "import subprocess; print(subprocess.Popen(['sleep', '60']).pid, flush=True); import time; time.sleep(60)"
    with subprocess.Popen(
        [sys.executable, "-S", "-c", script], stdout=subprocess.PIPE, **posix.process_options(())
    ) as process:
        assert process.stdout
        grandchild = int(process.stdout.readline())
        posix.kill_group(process.pid)
        assert process.wait() == -signal.SIGKILL
    wait_until(lambda: not command_line_of(grandchild))
    posix.kill_group(process.pid)  # nothing is left, which is no error


@pytest.mark.skipif(not posix.process_identity(), reason="only Linux identifies processes")
def test_the_end_of_a_process_is_known_on_its_machine_alone() -> None:
    script = "from mjrun.platform import posix; print(posix.process_identity(), flush=True); input()"
    with subprocess.Popen([sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout
        identity = process.stdout.readline().decode().strip()
        assert not posix.has_ended(identity)
        process.kill()
        wait_until(lambda: posix.has_ended(identity))  # as soon as it is dead, which its parent has not noticed
        process.wait()
    assert posix.has_ended(identity)
    assert not posix.has_ended(f"other{identity}")
    assert not any(posix.has_ended(text) for text in ("", "x", identity.split()[0]))
