"""Wall times of loading, of frames part by part, and of whole outputs, with a fake clock."""

from dataclasses import replace
from pathlib import Path

import mujoco
import pytest

from mjrun.bench.output_timing import timed_load
from mjrun.errors import ModelError
from mjrun.model.override import Override
from mjrun.model.sources import source_of
from mjrun.rendering.backend import Backend
from tests.bench.bench_clocks import MODEL, FakeClock, bench


@pytest.mark.gl
def test_a_whole_video_and_trace_are_a_second_of_simulation(path: Path) -> None:
    trace, film = bench(path, whole=True, size=(64, 48)).run(clock=FakeClock()).whole
    assert (trace.what, trace.count, trace.unit, trace.simulated, trace.seconds) == ("trace", 101, "rows", 1.0, 1.0)
    assert (film.what, film.count, film.unit, film.simulated, film.seconds) == ("video", 30, "frames", 1.0, 1.0)
    assert film.simulation is not None


def test_parsing_and_compiling_are_timed_apart_and_the_model_has_its_overrides(tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_text(MODEL)
    source = replace(source_of(path), overrides=(Override("opt.timestep", ".5"),))
    model, load = timed_load(source, FakeClock())
    assert model.opt.timestep == 0.5
    assert load.first == 1.0
    assert load.parse is not None
    assert load.compile is not None
    assert (load.parse.samples, load.compile.samples) == ([1.0] * 3, [1.0] * 3)


def test_a_compiled_file_is_neither_parsed_nor_compiled(tmp_path: Path) -> None:
    path = tmp_path / "model.mjb"
    mujoco.mj_saveModel(mujoco.MjModel.from_xml_string(MODEL), str(path))
    model, load = timed_load(source_of(path), FakeClock())
    assert model.nv == 1
    assert (load.first, load.parse, load.compile) == (1.0, None, None)


def test_a_file_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ModelError):
        timed_load(source_of(tmp_path / "none.xml"), FakeClock())


@pytest.mark.gl
@pytest.mark.parametrize(("view", "quality"), [("rgb", "high"), ("depth", "model"), ("seg", "model")])
def test_a_frames_parts_make_up_its_time_and_the_clock_is_asked_where_they_change(
    path: Path, backend: Backend, view: str, quality: str
) -> None:
    settings = {"size": (64, 48), "view": view, "quality": quality}
    (result,) = bench(path, render=True, repeats=1, **settings).run(clock=FakeClock()).frames
    assert (result.view, result.size, result.quality, result.device) == (view, (64, 48), quality, backend.renderer)
    assert result.read is not None
    # Each look at the clock is a second: the state and the scene are two spells of updating, and so on.
    assert result.update.median == 2
    assert result.draw.median == {"rgb": 1, "depth": 3, "seg": 3}[view]
    assert result.read.median == {"rgb": 3, "depth": 5, "seg": 5}[view]
    parts = (result.update, result.draw, result.read, result.compose)
    assert result.total.samples == [sum(spans) for spans in zip(*(part.samples for part in parts), strict=True)]
    # A film of each of the 7 pictures four times, between two looks at the clock.
    assert result.encode.samples == [1 / 28] * 3


@pytest.mark.gl
def test_filament_does_not_tell_drawing_from_reading(path: Path, vulkan: Backend) -> None:
    (result,) = bench(path, render=True, size=(64, 48), renderer="filament", repeats=1).run(clock=FakeClock()).frames
    assert (result.renderer, result.device, result.read) == ("filament", vulkan.renderer, None)
    # One look at the clock lies between any two parts: composing comes before, between and after the others.
    assert (result.update.median, result.draw.median, result.compose.median, result.total.median) == (1, 1, 3, 5)
