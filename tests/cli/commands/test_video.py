"""`mjrun video` as a user runs it."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.processes import PATIENCE, children, worker

if TYPE_CHECKING:
    from tests.conftest import Command, Film

FAST = ("--size", "64x48", "--quality", "draft", "--duration", "0.2", "--fps", "20")


def test_a_model_is_enough(mjrun_here: Command, swing: Path, decode: Callable[[Path], Film]) -> None:
    done = mjrun_here("video", swing, "--size", "64x36", "--quality", "draft")
    assert done.returncode == 0
    assert mjrun_here.files() == ["swing.mp4"]
    sentence = done.stdout.decode()
    assert sentence.startswith("swing.mp4: 64x36, 150 frames, 5 s at 30 fps, h264; made in ")
    assert sentence.count("\n") == 1
    assert len(decode(mjrun_here.folder / "swing.mp4").frames) == 150


def test_a_video_in_a_pipe_is_whole_and_alone_there(
    mjrun_here: Command, swing: Path, decode: Callable[[Path], Film]
) -> None:
    for container in ("mp4", "webm", "gif"):
        done = mjrun_here("video", swing, "-o", "-", "--format", container, *FAST)
        assert done.returncode == 0
        path = mjrun_here.folder / f"piped.{container}"
        path.write_bytes(done.stdout)
        assert (b"moof" in done.stdout) == (container == "mp4")  # it is in fragments
        film = decode(path)
        assert len(film.frames) == 4
        assert film.start == 0
        assert done.stderr.decode().splitlines()[-1].startswith("-: 64x48, 4 frames")
    assert len(mjrun_here("video", swing, "-o", "-", "--format", "rgb", *FAST).stdout) == 4 * 64 * 48 * 3


def test_quiet_says_nothing_and_verbose_says_more(mjrun_here: Command, swing: Path) -> None:
    quiet = mjrun_here("video", swing, "-q", *FAST)
    assert (quiet.returncode, quiet.stdout, quiet.stderr) == (0, b"", b"")
    assert b"simulated in " in mjrun_here("video", swing, "-v", *FAST).stderr


def test_a_video_may_be_a_folder_or_a_pattern(mjrun_here: Command, swing: Path) -> None:
    assert mjrun_here("video", swing, "-o", "frames/", *FAST).returncode == 0
    assert len(list((mjrun_here.folder / "frames").iterdir())) == 4
    assert mjrun_here("video", swing, "-o", "f_%d.png", *FAST).returncode == 0
    assert mjrun_here.files() == ["f_0.png", "f_1.png", "f_2.png", "f_3.png", "frames"]


def test_the_same_command_gives_the_same_pixels(mjrun_here: Command, swing: Path) -> None:
    command = ("video", swing, "-o", "-", "--format", "rgb", "-q", "--perturb", "1", "--seed", "7", *FAST)
    first, second = mjrun_here(*command), mjrun_here(*command, env={"LC_ALL": "de_DE.UTF-8", "LP_NUM_THREADS": "1"})
    other = mjrun_here(*command, "--seed", "8")
    assert first.stdout == second.stdout != other.stdout


@pytest.mark.slow
def test_every_shared_option_reaches_the_simulation(mjrun_here: Command, swing: Path) -> None:
    command = ("video", swing, "-o", "-", "--format", "rgb", "-q", *FAST)
    plain = mjrun_here(*command).stdout
    changes = (
        ("--qpos", "hinge=1"),
        ("--qvel", "hinge=5"),
        ("--set", "opt.gravity=0,0,3"),
        ("--set", "geom/box.rgba=0,0,1,1"),
        ("--timestep", "0.01"),
        ("--speed", "0.5"),
        ("--camera", "side"),
        ("--hide", "skybox", "--show", "joint"),
        ("--geomgroup", "none"),
        ("--frame-axes", "body"),
        ("--label", "body"),
        ("--quality", "model"),
    )
    for change in changes:
        done = mjrun_here(*command, *change)
        assert done.returncode == 0, done.stderr
        assert done.stdout != plain, change


def encoders(mjrun: int) -> list[int]:
    """Process ids of the encoders that a process has started."""
    found = []
    for child in children(mjrun):
        with contextlib.suppress(OSError):
            if b"rawvideo" in Path(f"/proc/{child}/cmdline").read_bytes():
                found.append(child)
    return found


@pytest.mark.slow
def test_a_killed_encoder_ends_with_six(mjrun: Command, swing: Path) -> None:
    (mjrun.folder / "swing.mp4").write_text("old")
    child = mjrun.start("video", swing, "--duration", "100", "--size", "320x240", "--quality", "draft")
    working = worker(child)
    while not (found := encoders(working)):
        assert child.poll() is None
    for encoder in found:
        os.kill(encoder, signal.SIGKILL)
    _, error = child.communicate(timeout=PATIENCE)
    assert child.returncode == 6
    assert b"the encoder was killed by SIGKILL" in error
    assert (mjrun.folder / "swing.mp4").read_text() == "old"
    assert mjrun.files() == ["swing.mp4"]


def test_a_hostile_name_reaches_the_terminal_harmless(mjrun_here: Command, tmp_path: Path) -> None:
    model = tmp_path / "hostile.xml"
    model.write_text(
        '<mujoco><worldbody><body><joint name="&#27;]0;owned&#7;"/><geom size=".1"/></body></worldbody></mujoco>'
    )
    done = mjrun_here("video", model, "--qpos", "x=1")
    assert done.returncode == 2
    assert b"\x1b" not in done.stderr
    assert b"\\x1b]0;owned\\x07" in done.stderr
