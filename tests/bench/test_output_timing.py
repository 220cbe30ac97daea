"""Wall times of loading, of frames part by part by renderers that measure, and of whole outputs, with a fake clock."""

from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.bench.output_timing import Stopwatch, TimedClassicRenderer, TimedFilamentRenderer, timed_load
from mjrun.camera.script import parse_camera
from mjrun.camera.script_poses import BoundCameraScript
from mjrun.errors import ModelError
from mjrun.model.override import Override
from mjrun.model.sources import source_of
from mjrun.model.state import save
from mjrun.rendering.backend import WorkingBackend
from mjrun.rendering.classic import ClassicRenderer
from mjrun.rendering.filament import FilamentRenderer
from mjrun.rendering.visual import SegmentationIds, Visual
from tests.bench.bench_clocks import MODEL, FakeClock, bench


@pytest.mark.gl
def test_a_whole_video_and_trace_are_a_second_of_simulation(path: Path) -> None:
    trace, film = bench(path, whole=True, size=(64, 48), repeats=1, threads=()).run(clock=FakeClock()).whole
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
    path: Path, backend: WorkingBackend, view: str, quality: str
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
def test_filament_does_not_tell_drawing_from_reading(path: Path, vulkan: WorkingBackend) -> None:
    (result,) = bench(path, render=True, size=(64, 48), renderer="filament", repeats=1).run(clock=FakeClock()).frames
    assert (result.renderer, result.device, result.read) == ("filament", vulkan.renderer, None)
    # One look at the clock lies between any two parts: composing comes before, between and after the others.
    assert (result.update.median, result.draw.median, result.compose.median, result.total.median) == (1, 1, 3, 5)


SIZE = (64, 48)
EXACT = ("depth", "ids")
Tree = tuple[str, list["Tree"]]  # a part of the work, and the parts in it

TREES: st.SearchStrategy[Tree] = st.recursive(
    st.tuples(st.sampled_from("abc"), st.just([])),
    lambda inner: st.tuples(st.sampled_from("abc"), st.lists(inner, max_size=3)),
    max_leaves=8,
)


class TickingClock:
    """Advances by the next whole number of seconds at every look: 1, 2, 3, …"""

    def __init__(self) -> None:
        self.looks, self.now = 0, 0.0

    def __call__(self) -> float:
        self.looks += 1
        self.now += self.looks
        return self.now


def expected_times(tree: Tree, clock: TickingClock, times: dict[str, float]) -> None:
    """Adds to `times` what each part takes beside the parts in it, when each begin and end is a look at the clock."""
    name, inner = tree
    clock()
    for part in inner:
        before = clock.now
        expected_times(part, clock, times)
        times[name] = times.get(name, 0.0) + first_look(before, clock, part)
    before = clock.now
    times[name] = times.get(name, 0.0) + clock() - before


def first_look(before: float, clock: TickingClock, part: Tree) -> float:
    """How long after `before` the part that has just ended began."""
    looks = clock.looks - 2 * size_of(part) + 1
    return looks * (looks + 1) / 2 - before


def size_of(tree: Tree) -> int:
    return 1 + sum(map(size_of, tree[1]))


def run(tree: Tree, watch: Stopwatch) -> None:
    name, inner = tree
    with watch.part(name):
        for part in inner:
            run(part, watch)


@given(TREES)
def test_each_part_takes_what_it_takes_without_those_inside_it(tree: Tree) -> None:
    clock, watch, times = TickingClock(), Stopwatch(TickingClock()), {}
    expected_times(tree, clock, times)
    run(tree, watch)
    assert watch.spent == times
    whole = clock.looks * (clock.looks + 1) / 2 - 1  # from the first look to the last
    assert sum(watch.spent.values()) == whole


def test_a_part_that_fails_has_taken_its_time_and_ends() -> None:
    watch = Stopwatch(TickingClock())
    with pytest.raises(ZeroDivisionError), watch.part("outer"), watch.part("inner"):
        raise ZeroDivisionError
    assert watch.spent == {"outer": 2 + 4, "inner": 3}
    with watch.part("next"):
        pass
    assert watch.spent == {"outer": 6, "inner": 3, "next": 6}


def views(make: Callable[..., ClassicRenderer | FilamentRenderer], path: Path, backend: WorkingBackend) -> dict:
    """What a renderer draws of a model's first instant."""
    model = mujoco.MjModel.from_xml_path(str(path))
    state = save(model, mujoco.MjData(model))
    pose = BoundCameraScript(parse_camera("free", model), model, SIZE).pose(state)
    with closing(make(model, SIZE, backend, Visual(), SegmentationIds(model))) as renderer:
        renderer.set_state(state)
        picture = renderer.render(pose, ("rgb", "depth", "seg"))
        return {name: np.array(getattr(picture, name)) for name in ("rgb", *EXACT)}


@pytest.mark.gl
def test_a_timed_image_is_the_image(swing: Path, backend: WorkingBackend) -> None:
    watch = Stopwatch(TickingClock())
    timed = views(partial(TimedClassicRenderer, watch=watch), swing, backend)
    for name, expected in views(ClassicRenderer, swing, backend).items():
        np.testing.assert_array_equal(timed[name], expected)
    assert set(watch.spent) == {"update", "draw", "read"}


@pytest.mark.gl
def test_a_timed_image_of_filament_is_the_image_up_to_its_noise(swing: Path, vulkan: WorkingBackend) -> None:
    watch = Stopwatch(TickingClock())
    timed = views(partial(TimedFilamentRenderer, watch=watch), swing, vulkan)
    expected = views(FilamentRenderer, swing, vulkan)
    for name in EXACT:
        np.testing.assert_array_equal(timed[name], expected[name])
    assert np.abs(timed["rgb"].astype(int) - expected["rgb"]).mean() < 1
    assert set(watch.spent) == {"update", "draw"}
