"""Frames in memory are drawn when they are asked for, and may be left alone."""

from pathlib import Path

import pytest

from mjrun.errors import UnstableError
from mjrun.outputs.video import VideoInMemory, video_frames
from mjrun.simulation.simulation import Simulation

pytestmark = pytest.mark.gl


def test_an_unstable_simulation_is_told_at_the_first_frame(exploding: Path) -> None:
    waiting = video_frames(VideoInMemory(Simulation(exploding, key="fast", duration=2), "f.mkv", size=(64, 48)))
    with pytest.raises(UnstableError):
        next(waiting)


def test_frames_that_nobody_asks_for_are_not_drawn(swing: Path) -> None:
    some = video_frames(VideoInMemory(Simulation(swing), "f.mkv", size=(64, 48), jobs=1))
    assert next(some).shape == (48, 64, 3)
    some.close()
    with pytest.raises(StopIteration):
        next(some)
