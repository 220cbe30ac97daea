"""Theorems about what environments of Gymnasium's are as tasks."""

from pathlib import Path

import gymnasium
import numpy as np
import pytest

from mjrun.model.sources.gym import GymSource
from mjrun.physics.initial_state import InitialState
from mjrun.probe.fields import field_probe
from mjrun.task.environment_description import describe_environment
from tests.task.environments import registered


@pytest.mark.parametrize(("name", "numbers", "limit"), [("Ant-v5", (105, 8), 1000), ("Reacher-v5", (10, 2), 50)])
def test_sizes_and_times_are_those_of_gymnasium(name: str, numbers: tuple[int, int], limit: int) -> None:
    task = describe_environment(GymSource(name)).task
    environment: gymnasium.Env = gymnasium.make(name)
    assert (task.observations, task.actions, task.periods) == (*numbers, limit)
    assert environment.observation_space.shape == (task.observations,)
    assert environment.get_wrapper_attr("dt") == task.control_dt == task.control_steps * task.timestep
    assert task.duration == pytest.approx(limit * task.control_dt)


def test_each_number_of_an_observation_is_that_of_its_source() -> None:
    source = GymSource("Hopper-v5?reset_noise_scale=0")
    environment = gymnasium.make("Hopper-v5", reset_noise_scale=0)
    observation, _ = environment.reset(seed=1)
    model, data = source.load(), InitialState().data(source.load())
    columns = {
        column.name: (value, column.unit)
        for field, values in (("qpos", data.qpos), ("qvel", data.qvel))
        for column, value in zip(field_probe(model, field).columns, values, strict=True)
    }
    for row in describe_environment(source).observations:
        assert columns[row.source] == (observation[row.index], row.unit)


def test_actions_have_their_bounds_and_the_limits_of_their_controls() -> None:
    rows = describe_environment(GymSource("Humanoid-v5")).actions
    assert [row.name for row in rows[:2]] == ["abdomen_y", "abdomen_z"]
    assert all((row.low, row.high) == pytest.approx((-0.4, 0.4)) == row.range for row in rows)


def test_an_environment_without_a_limit_has_none(tmp_path: Path) -> None:
    with registered(tmp_path) as name:
        description = describe_environment(GymSource(name))
    assert (description.task.duration, description.task.periods) == (None, None)
    assert [row.name for row in description.terminations] == ["terminated"]
    assert [row.name for row in description.rewards] == ["alive", "speed"]
    assert np.all([row.source == "" for row in description.observations])
