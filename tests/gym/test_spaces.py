"""Spaces have the bounds that the task and its model have."""

from pathlib import Path

import numpy as np

from mjrun.gym.spaces import SQUASHED, action_space, observation_space, task_of
from mjrun.task.task import Task
from mjrun.task.terms import Action, Observation
from mjrun.task.worlds import TaskWorlds
from tests.gym.tasks import write_cart


def test_bounds_of_observations_and_actions(tmp_path: Path) -> None:
    task = task_of(write_cart(tmp_path))
    worlds = TaskWorlds(task, 1)
    space = observation_space(worlds)
    assert space.low.tolist() == [-4, -4, -np.inf, -np.inf]
    assert space.high.tolist() == [5, 5, np.inf, np.inf]
    space = action_space(worlds)
    np.testing.assert_allclose(space.low, [-2, -np.pi / 2], rtol=1e-6)
    np.testing.assert_allclose(space.high, [4, np.pi / 2], rtol=1e-6)


def test_squashed_and_clipped_actions_have_bounds_of_their_own(tmp_path: Path) -> None:
    write_cart(tmp_path)
    task = Task(
        tmp_path / "cart.xml",
        control_dt=0.02,
        duration=1,
        observations=[Observation(name="x", probe="qpos")],
        actions=[Action(actuators="push", squash="tanh"), Action(joints="hinge", target="torque", clip=[-3, 2])],
    )
    space = action_space(TaskWorlds(task, 1))
    assert space.low.tolist() == [-SQUASHED, -3]
    assert space.high.tolist() == [SQUASHED, 2]
