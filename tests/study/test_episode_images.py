"""Images of episodes, the same whatever was rendered before, and by however many processes."""

from contextlib import closing
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import mujoco
import numpy as np
import pytest

import mjrun
from mjrun.model import state
from mjrun.options.rendering import ViewOptions
from mjrun.physics.simulation_loop import StateBuffer
from mjrun.rendering.visual import visual_of
from mjrun.study.episode_files import EpisodeImageRenderer
from mjrun.timeline import Timeline

pytestmark = pytest.mark.gl

MODEL = """<mujoco><visual><quality shadowsize="64" offsamples="0"/></visual>
<worldbody><body name="box" pos="0 0 {height}"><joint name="lift" type="slide" axis="0 0 1"/>
  <geom type="box" size=".1 .1 .1" rgba="{color} 1"/></body></worldbody></mujoco>"""
OPTIONS = ViewOptions(size=(64, 48), camera=["free:distance=2", "track:box"], quality="draft", stage="floor,light,sky")
HEIGHTS = [0.0, 0.2, 0.5]


def images(renderer: EpisodeImageRenderer, path: Path, heights: list[float]) -> list[np.ndarray]:
    source = mjrun.Simulation(path).source
    model = source.load()
    with closing(StateBuffer(model)) as states:
        data = mujoco.MjData(model)
        for height in heights:
            data.qpos[0] = height
            states.append(state.save(model, data))
        timeline = Timeline.of_steps(Fraction(1, 500), len(heights))
        times = [0.002 * index for index in range(len(heights))]
        made = renderer.images(source, model, states, times, timeline)
        return [image.copy() for row in made for image in row]


@pytest.fixture
def models(tmp_path: Path) -> list[Path]:
    paths = []
    for index, (height, color) in enumerate(((0.3, "1 0 0"), (0.7, "0 1 0"))):
        paths.append(tmp_path / f"{index}.xml")
        paths[-1].write_text(MODEL.format(height=height, color=color))
    return paths


def test_images_are_those_of_a_new_renderer_whatever_was_rendered_before(models: list[Path]) -> None:
    with closing(EpisodeImageRenderer(OPTIONS, 1)) as renderer:
        one_after_the_other = [images(renderer, path, HEIGHTS) for path in (models[0], models[1], models[0])]
    for path, found in zip((models[0], models[1], models[0]), one_after_the_other, strict=True):
        with closing(EpisodeImageRenderer(OPTIONS, 1)) as renderer:
            np.testing.assert_array_equal(found, images(renderer, path, HEIGHTS))
    assert not np.array_equal(one_after_the_other[0], one_after_the_other[1])


def test_images_are_those_of_a_single_render(models: list[Path]) -> None:
    plain = replace(OPTIONS, stage=("none",))
    with closing(EpisodeImageRenderer(plain, 1)) as renderer:
        found = images(renderer, models[0], [0.2])
    model = mjrun.load(models[0])
    data = mujoco.MjData(model)
    data.qpos[0] = 0.2
    for image, camera in zip(found, OPTIONS.camera, strict=True):
        expected = mjrun.render(model, data, camera, (64, 48), visual=visual_of(plain))
        np.testing.assert_array_equal(image, expected)


def test_the_floor_is_below_the_whole_episode(models: list[Path]) -> None:
    options = replace(OPTIONS, camera=("free:distance=2",))
    with closing(EpisodeImageRenderer(options, 1)) as renderer:
        rising, falling = (images(renderer, models[0], heights) for heights in (HEIGHTS, HEIGHTS[::-1]))
    np.testing.assert_array_equal(rising, falling[::-1])


@pytest.mark.slow
def test_several_processes_render_the_same_images(models: list[Path]) -> None:
    rendered = []
    for processes in (1, 2):
        with closing(EpisodeImageRenderer(OPTIONS, processes)) as renderer:
            rendered.append([images(renderer, path, HEIGHTS) for path in models])
    np.testing.assert_array_equal(*rendered)
