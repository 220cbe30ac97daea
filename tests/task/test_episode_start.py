"""Starts of episodes: what is written, what is added and what is drawn instead, by seed alone."""

import mujoco
import numpy as np
import pytest

from mjrun.errors import UnknownNameError, UsageError
from mjrun.model import state
from mjrun.model.sources import parse_source
from mjrun.model.variants import ModelVariant, SharedCompilation, VariantLoader
from mjrun.physics.random_distribution import draw_numbers
from mjrun.task.episode_start import EpisodeModels, EpisodeStarts
from mjrun.task.random_streams import MODEL as MODEL_STREAM
from mjrun.task.random_streams import START, stream
from mjrun.task.task import Reset

MODEL = mujoco.MjModel.from_xml_string(
    """<mujoco><worldbody><body name="a"><freejoint name="root"/><geom size=".1"/>
    <body><joint name="knee" range="-1 1"/><geom size=".1"/></body></body></worldbody>
    <keyframe><key name="up" qpos="0 0 2 1 0 0 0 .5"/></keyframe></mujoco>"""
)


def start(reset: Reset, seed: int = 3) -> mujoco.MjData:
    data = mujoco.MjData(MODEL)
    state.restore(MODEL, data, EpisodeStarts(reset, MODEL).state(ModelVariant(SharedCompilation(None, MODEL)), seed))
    return data


def test_noise_is_added_and_values_are_drawn_instead_in_the_order_of_their_streams() -> None:
    reset = Reset(
        key="up",
        qvel={"knee": 7},
        set={"qpos/knee": "uniform(-1, 1)", "qvel/root/vx": 4},
        noise={"qpos/root": "normal(0, 0.1)", "qvel/*": "choice(1, 2)"},
    )
    data, generator = start(reset), stream(3, START)
    knee = generator.uniform(-1, 1)
    pose = np.array([0, 0, 2, 1, 0, 0, 0]) + generator.normal(0, 0.1, 7)
    pose[3:] /= np.linalg.norm(pose[3:])
    np.testing.assert_allclose(data.qpos, [*pose, knee], rtol=1e-15)
    noise = np.array([1, 2])[generator.integers(2, size=7)]
    np.testing.assert_array_equal(data.qvel, np.array([4, 0, 0, 0, 0, 0, 7]) + noise)
    assert (start(reset, 4).qpos != data.qpos).all()


@pytest.mark.parametrize(
    "text",
    [
        *("uniform(-1, 1)", "normal(0, 2)", "loguniform(0.1, 2)", "truncnormal(0, 1, -1, 1)"),
        *("choice(1, 2, 5)", "integers(0, 9)", "0.25"),
    ],
)
def test_equal_noise_on_neighbouring_columns_is_drawn_column_by_column(text: str) -> None:
    data, generator = start(Reset(noise={"qpos/knee": text, "qvel/root": text, "qvel/knee": text})), stream(3, START)
    noise = [draw_numbers(text, generator, count) for count in (1, 6, 1)]
    np.testing.assert_array_equal([data.qpos[7], *data.qvel], np.concatenate(noise))


def test_without_randomness_every_seed_starts_alike() -> None:
    assert (start(Reset(key="up"), 1).qpos == start(Reset(key="up"), 2).qpos).all()


def test_unknown_columns_are_told_where_they_stand() -> None:
    with pytest.raises(UnknownNameError, match=r"no column 'qpos/kne'.*mean 'qpos/knee'") as caught:
        start(Reset(noise={"qpos/kne": "normal(0, 1)"}))
    assert caught.value.path == ("reset", "noise", "qpos/kne")


def test_models_vary_by_seed_alone() -> None:
    source = parse_source("scene:pendulum")
    vary = (("opt.gravity[2]", "uniform(-9, -1)"), ("opt.cone", "choice(elliptic, pyramidal)"))
    models = EpisodeModels(source, vary, VariantLoader())
    assert not models.is_one
    generator = stream(5, MODEL_STREAM)
    model = models.model(5)
    assert model.opt.gravity[2] == generator.uniform(-9, -1)
    assert model.opt.cone == (1, 0)[int(generator.integers(2))]
    assert EpisodeModels(source, vary, VariantLoader()).model(5).opt.gravity[2] == model.opt.gravity[2]


def test_a_start_is_that_of_its_model_when_models_are_written_over() -> None:
    vary = (("opt.gravity[2]", "uniform(-9, -1)"),)
    models = EpisodeModels(parse_source("scene:pendulum"), vary, VariantLoader())
    first = models.variant(1)
    starts = EpisodeStarts(Reset(), first.model)
    gravity, start = first.model.opt.gravity[2], starts.state(first, 1).copy()
    models.reuse(first)
    second = models.variant(2)
    assert second.model is first.model
    assert second.model.opt.gravity[2] != gravity
    np.testing.assert_array_equal(starts.state(second, 2), start)
    models.reuse(second)
    assert models.variant(1).model.opt.gravity[2] == gravity


@pytest.mark.parametrize(
    ("path", "message"), [("opt.gravty", "no setting 'gravty'"), ("opt.timestep", "the same in all episodes")]
)
def test_what_cannot_vary_is_told_where_it_stands(path: str, message: str) -> None:
    with pytest.raises(UsageError, match=message) as caught:
        EpisodeModels(parse_source("scene:pendulum"), ((path, "uniform(1, 2)"),), VariantLoader()).model(0)
    assert caught.value.path == ("reset", "vary", path)
