"""The cost of a frame, part by part, with a fake clock."""

import sys
from pathlib import Path

import pytest

from mjrun.rendering.backend import Backend

sys.path.append(str(Path(__file__).parent))

from bench_clocks import MODEL, FakeClock, bench


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "model.xml"
    path.write_text(MODEL)
    return path


@pytest.mark.gl
@pytest.mark.parametrize("view", ["rgb", "depth", "seg"])
@pytest.mark.parametrize("quality", ["model", "high"])
def test_a_frames_parts_make_up_its_time_and_the_clock_is_asked_where_they_change(
    path: Path, backend: Backend, view: str, quality: str
) -> None:
    settings = {"size": (64, 48), "view": view, "quality": quality}
    (found,) = bench(path, render=True, repeats=1, **settings).run(clock=FakeClock()).frames
    assert (found.view, found.size, found.quality, found.device) == (view, (64, 48), quality, backend.renderer)
    assert found.read is not None
    # Each look at the clock is a second: the state and the scene are two spells of updating, and so on.
    assert found.update.median == 2
    assert found.draw.median == {"rgb": 1, "depth": 3, "seg": 3}[view]
    assert found.read.median == {"rgb": 3, "depth": 5, "seg": 5}[view]
    parts = (found.update, found.draw, found.read, found.compose)
    assert found.total.samples == [sum(spans) for spans in zip(*(part.samples for part in parts), strict=True)]
    # A film of each of the 7 pictures four times, between two looks at the clock.
    assert found.encode.samples == [1 / 28] * 3


@pytest.mark.gl
def test_filament_does_not_tell_drawing_from_reading(path: Path, vulkan: Backend) -> None:
    (found,) = bench(path, render=True, size=(64, 48), renderer="filament", repeats=1).run(clock=FakeClock()).frames
    assert (found.renderer, found.device, found.read) == ("filament", vulkan.renderer, None)
    # One look at the clock lies between any two parts: composing comes before, between and after the others.
    assert (found.update.median, found.draw.median, found.compose.median, found.total.median) == (1, 1, 3, 5)
