"""Disturbances of worlds against the forces and the noise of each step, drawn independently."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from mjrun.errors import UnknownNameError, UsageError
from mjrun.options.simulation import NO_DISTURBANCES, Disturbances, PushKind
from mjrun.task.task import Action
from mjrun.task.worlds import TaskWorlds, WorldDisturbances
from tests.task.test_worlds import MODEL, cart

PUSHES = ("pole=1/0/0@0.02+0.03", "ball=0/2/0@0.04+0.05")
WORLDS = np.arange(2)


def test_pushes_hold_from_edge_to_edge_and_noise_for_a_step() -> None:
    forces = np.zeros((2, MODEL.nbody, 6))
    parts = np.zeros((2, mujoco.mj_stateSize(MODEL, mujoco.mjtState.mjSTATE_INTEGRATION))), np.ones((2, MODEL.nu))
    pushed = WorldDisturbances(cart(push=PUSHES), MODEL, *parts, forces)
    noisy = WorldDisturbances(cart(ctrl_noise=0.5), MODEL, *parts, forces)
    for world in WORLDS.tolist():
        pushed.begin(world, world, MODEL)
        noisy.begin(world, world, MODEL)
    steps, held = np.array([0, 3]), []
    while steps[0] < 12:
        held.append(pushed.apply(WORLDS, steps))
        for each, step in zip(forces, steps, strict=True):
            assert (each[2, 0], each[3, 1]) == (1 * (2 <= step < 5), 2 * (4 <= step < 9))
        assert noisy.apply(WORLDS, steps) == 1
        for world, step in enumerate(steps):
            noise = 0.5 * np.random.default_rng([world, 1, 0]).standard_normal((1024, MODEL.nu))
            np.testing.assert_array_equal(parts[1][world], 1 + noise[step])
        steps += held[-1]
    assert held[:6] == [1, 1, 2, 1, 1, 3]  # the edges 2, 4, 5 and 9 of worlds at steps k and k + 3


def test_a_delayed_action_is_a_task_whose_actions_come_later() -> None:
    """Until the first one arrives, an action of zeros is in force."""
    actions = np.random.default_rng(1).normal(size=(8, 2, 2))
    late = TaskWorlds(cart(actions=[Action(actuators=["turn", "push"], offset="home", delay=3)]), 2)
    plain = TaskWorlds(cart(actions=[Action(actuators=["turn", "push"], offset="home")]), 2)
    for _ in range(2):  # a new episode does not remember the last one
        late.reset([4, 5])
        plain.reset([4, 5])
        for k in range(8):
            late.step(actions[k])
            plain.step(actions[k - 3] if k >= 3 else np.zeros((2, 2)))
            np.testing.assert_array_equal(late.state(1), plain.state(1))


def test_options_add_pushes_to_a_task_and_replace_its_noise() -> None:
    task = cart(push=PUSHES[:1], ctrl_noise=0.1, ctrl_noise_time=0.5)
    assert task.with_disturbances(NO_DISTURBANCES) is task
    more = task.with_disturbances(Disturbances((PushKind().parse(PUSHES[1]),), 0.0))
    assert more == replace(task, push=PUSHES, ctrl_noise=0)


def test_unknown_bodies_and_invalid_noise_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="wheel") as caught:
        TaskWorlds(cart(push=[PUSHES[0], "wheel=1/0/0@0+1"]), 1)
    assert caught.value.path[:2] == ("push", 1)
    with pytest.raises(UsageError, match="ctrl_noise"):
        cart(ctrl_noise=-1)
