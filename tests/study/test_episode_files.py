"""The course of an episode, compared with the policy that played it and with a bare MuJoCo loop."""

from contextlib import ExitStack
from fractions import Fraction
from pathlib import Path

import mujoco
import numpy as np

import mjrun
from mjrun.model import state
from mjrun.study.episode_files import acted, recorded
from tests.evaluation.tasks import XML, cart_task


def test_an_episode_is_simulated_once_and_its_states_are_those_that_the_policy_saw(tmp_path: Path) -> None:
    seen = list[float]()

    def policy(observation: np.ndarray) -> np.ndarray:
        seen.append(float(observation[0]))
        return np.array([-0.1])

    episode = mjrun.Simulation(cart_task(tmp_path), policy=policy, seed=4).episode
    assert episode
    with ExitStack() as stack:
        rollout = acted(episode, (), 3, stack)
        slider = state.fields(state.sizes(rollout.model))["qpos"]
        positions = [float(row[slider][0]) for row in rollout.states]
    assert positions == seen[:-1][::3]
    assert rollout.last[slider] == seen[-1]
    assert rollout.rows.observations[:, 0].tolist() == [*positions, seen[-1]]
    assert list(rollout.steps) == [*range(0, 2 * len(seen) - 2, 6), 2 * len(seen) - 2]


def test_the_next_seed_shares_the_world_and_changes_no_number(tmp_path: Path) -> None:
    task = cart_task(tmp_path)
    alone, shared = (mjrun.Simulation(task, policy="random", seed=seed).episode for seed in (5, 4))
    assert alone
    assert shared
    with ExitStack() as stack:
        acted(shared, (), 1, stack)
        expected, found = (acted(episode, (), 1, stack) for episode in (alone, shared.of_seed(5)))
    np.testing.assert_array_equal(found.rows.observations, expected.rows.observations)
    np.testing.assert_array_equal(found.rows.actions, expected.rows.actions)
    np.testing.assert_array_equal(found.last, expected.last)


def test_a_simulation_without_a_policy_is_observed_at_the_rate_of_rows(tmp_path: Path) -> None:
    (tmp_path / "m.xml").write_text(XML)
    simulation = mjrun.Simulation(tmp_path / "m.xml", ctrl={"push": (0.5,)}, duration=0.3)
    with ExitStack() as stack:
        rollout = recorded(simulation, ["xpos/cart/x", "qvel"], Fraction(20), stack)
    model = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(model)
    data.ctrl[0] = 0.5
    for row, observation in enumerate(rollout.rows.observations):
        mujoco.mj_forward(model, data)
        assert observation.tolist() == [data.xpos[1, 0], data.qvel[0]]
        assert row == 6 or rollout.rows.actions[row].tolist() == [0.5]
        mujoco.mj_step(model, data, 5)
    assert list(rollout.steps) == [0, 5, 10, 15, 20, 25, 30]
