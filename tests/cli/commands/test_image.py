"""`mjrun image` as a user runs it."""

from __future__ import annotations

import io
import json
from typing import TYPE_CHECKING

import imageio.v3 as imageio
import numpy as np
import pytest

if TYPE_CHECKING:
    from pathlib import Path

    from tests.conftest import Command

SMALL = ("--size", "64x48", "--quality", "draft", "--camera", "side")


def test_a_model_is_enough(mjrun_here: Command, swing: Path) -> None:
    done = mjrun_here("image", swing, *SMALL)
    assert (done.returncode, done.stderr) == (0, b"")
    assert mjrun_here.files() == ["swing.png"]
    assert imageio.imread(mjrun_here.folder / "swing.png").shape == (48, 64, 3)
    line = done.stdout.decode()
    assert line.startswith("swing.png: 64x48 at 0 s; made in ")
    assert line.count("\n") == 1


def test_an_image_in_a_pipe_is_the_file_and_alone_there(mjrun_here: Command, swing: Path) -> None:
    assert mjrun_here("image", swing, *SMALL, "-t", "0.1").returncode == 0
    piped = mjrun_here("image", swing, *SMALL, "-t", "0.1", "-o", "-")
    assert piped.returncode == 0
    assert piped.stderr.decode().startswith("-: 64x48 at 0.1 s")
    written = imageio.imread(mjrun_here.folder / "swing.png")
    assert np.array_equal(imageio.imread(io.BytesIO(piped.stdout), extension=".png"), written)


def test_json_tells_what_was_made(mjrun_here: Command, swing: Path) -> None:
    found = json.loads(mjrun_here("image", swing, *SMALL, "--json", "--step", "50", "-o", "a.png").stdout)
    assert (found["paths"], found["size"], found["time"]) == (["a.png"], [64, 48], 0.1)


def test_views_lie_side_by_side_in_the_layout_asked_for(mjrun_here: Command, swing: Path) -> None:
    views = ("--view", "rgb", "--view", "depth", "--view", "seg", "--layout", "row")
    assert mjrun_here("image", swing, *SMALL, *views, "-o", "views.png").returncode == 0
    alone = mjrun_here("image", swing, *SMALL, "-o", "alone.png")
    assert alone.returncode == 0
    width = imageio.imread(mjrun_here.folder / "views.png").shape[1]
    assert width >= 3 * imageio.imread(mjrun_here.folder / "alone.png").shape[1]


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("-o", "-", "--json"), 2, "--json and the output both print to standard output"),
        (("-t", "1", "--step", "2"), 2, "--step"),
        (("--camera", "sid"), 2, "did you mean 'side'?"),
        (("-o", "a.xyz"), 2, ".xyz"),
        (("-o", "/dev/null/a.png"), 7, "is not a folder"),
    ],
)
def test_a_mistake_is_explained_and_leaves_nothing(
    mjrun_here: Command, swing: Path, arguments: tuple[str, ...], code: int, message: str
) -> None:
    done = mjrun_here("image", swing, "--size", "64x48", *arguments)
    assert (done.returncode, bool(done.stdout)) == (code, "--json" in arguments)
    assert message in done.stderr.decode()
    assert mjrun_here.files() == []
