"""The functions of a system without POSIX, as far as they do the same everywhere."""

import ast
import errno
import inspect
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

import mjrun
from mjrun.platform import posix, windows


def used() -> set[str]:
    """Returns the names of `system` that mjrun uses anywhere."""
    return {
        node.attr
        for path in Path(mjrun.__file__).parent.rglob("*.py")
        if "mjrun.platform import system" in (text := path.read_text("utf-8"))
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "system"
    }


def test_both_systems_have_what_is_used() -> None:
    for name in used():
        one, other = getattr(posix, name), getattr(windows, name)
        if inspect.isfunction(one):
            parameters = [[*inspect.signature(each).parameters.values()] for each in (one, other)]
            assert parameters[0] == parameters[1], name


def test_nothing_is_locked_so_that_files_can_be_renamed(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=os.strerror(errno.ENOLCK)):
        windows.locked(tmp_path)


def test_a_second_name_is_given_where_the_system_can(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("text")
    windows.hard_link(tmp_path / "file", tmp_path / "second")
    assert (tmp_path / "second").read_text() == "text"
    (tmp_path / "link").symlink_to(tmp_path / "file")
    with pytest.raises(OSError, match="no second name"):
        windows.hard_link(tmp_path / "link", tmp_path / "third")
    monkeypatch.delattr(os, "link")
    with pytest.raises(OSError, match="no second name"):
        windows.hard_link(tmp_path / "file", tmp_path / "third")


def test_a_process_inherits_nothing() -> None:
    assert subprocess.run([sys.executable, "-S", "-c", ""], check=True, **windows.process_options(())).returncode == 0
    with pytest.raises(OSError, match="inherits no descriptors"):
        windows.process_options([3])
    with pytest.raises(OSError, match="inherits no descriptors"):
        windows.duplicate(3)


def test_the_end_of_a_pipe_ends_the_wait_for_it() -> None:
    reading, writing = os.pipe()
    waiting = threading.Thread(target=windows.wait_for_hangup, args=(reading,))
    waiting.start()
    os.write(writing, b"more")
    assert waiting.is_alive()
    os.close(writing)
    waiting.join(10)
    assert not waiting.is_alive()
    os.close(reading)


def test_a_process_ends_itself_in_time() -> None:
    script = "import time\nfrom mjrun.platform.windows import end_after\nwith end_after(0): time.sleep(60)"
    assert subprocess.run([sys.executable, "-c", script], timeout=50, check=False).returncode == 1
