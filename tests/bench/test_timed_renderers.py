"""Renderers that measure: the same pixels as those that do not, and a stopwatch against arithmetic."""

from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.bench.output_timing import Stopwatch, TimedClassicRenderer, TimedFilamentRenderer
from mjrun.camera.script import parse_camera
from mjrun.camera.script_poses import BoundCameraScript
from mjrun.model.state import save
from mjrun.rendering.backend import Backend
from mjrun.rendering.classic import ClassicRenderer
from mjrun.rendering.filament import FilamentRenderer
from mjrun.rendering.segmentation import Segmentation
from mjrun.rendering.visual import Visual

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


def views(make: Callable[..., ClassicRenderer | FilamentRenderer], path: Path, backend: Backend) -> dict:
    """What a renderer draws of a model's first instant."""
    model = mujoco.MjModel.from_xml_path(str(path))
    state = save(model, mujoco.MjData(model))
    pose = BoundCameraScript(parse_camera("free", model), model, SIZE).pose(state)
    with closing(make(model, SIZE, backend, Visual(), Segmentation(model))) as renderer:
        renderer.set_state(state)
        picture = renderer.render(pose, ("rgb", "depth", "seg"))
        return {name: np.array(getattr(picture, name)) for name in ("rgb", *EXACT)}


@pytest.mark.gl
def test_a_timed_image_is_the_image(swing: Path, backend: Backend) -> None:
    watch = Stopwatch(TickingClock())
    timed = views(partial(TimedClassicRenderer, watch=watch), swing, backend)
    for name, expected in views(ClassicRenderer, swing, backend).items():
        np.testing.assert_array_equal(timed[name], expected)
    assert set(watch.spent) == {"update", "draw", "read"}


@pytest.mark.gl
def test_a_timed_image_of_filament_is_the_image_up_to_its_noise(swing: Path, vulkan: Backend) -> None:
    watch = Stopwatch(TickingClock())
    timed = views(partial(TimedFilamentRenderer, watch=watch), swing, vulkan)
    expected = views(FilamentRenderer, swing, vulkan)
    for name in EXACT:
        np.testing.assert_array_equal(timed[name], expected[name])
    assert np.abs(timed["rgb"].astype(int) - expected["rgb"]).mean() < 1
    assert set(watch.spent) == {"update", "draw"}
