"""Theorems about episodes of Gymnasium's environments: those of a bare loop, to the bit, and every step in between."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest

from mjrun.errors import SimulationError, UnstableError, UsageError
from mjrun.model import state
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.override import Override
from mjrun.model.sources.gym import GymSource, quiet
from mjrun.physics.stepper import PhysicsStepper
from mjrun.task.environment_stepper import EnvironmentStepper
from mjrun.task.episode import EpisodeOver, EpisodeStepper
from mjrun.task.gymnasium import Environment
from tests.task.environments import registered

PERIODS, SEED = 40, 5
NAMES = ["HalfCheetah-v5", "Humanoid-v5", "Reacher-v5", "Ant-v4"]


class Recorded:
    """A policy that gives the same actions in every episode."""

    def __init__(self, actions: Sequence[np.ndarray]) -> None:
        self.actions = iter(actions)

    def act(self, observation: np.ndarray) -> np.ndarray:
        return next(self.actions)


def made(name: str) -> Any:
    with collected_warnings(), quiet():
        return gymnasium.make(name, disable_env_checker=True)


def actions(name: str) -> list[np.ndarray]:
    space, rng = made(name).action_space, np.random.default_rng(7)
    return [rng.uniform(space.low, space.high).astype(np.float32) for _ in range(PERIODS + 1)]


def started(name: str, *overrides: Override) -> EnvironmentStepper:
    with collected_warnings():
        return EnvironmentStepper(Environment(GymSource(name, overrides=overrides)), Recorded(actions(name)), SEED)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("look_inside", [False, True])
def test_states_observations_and_rewards_are_those_of_a_bare_loop(name: str, look_inside: bool) -> None:
    stepper = started(name)
    assert isinstance(stepper, EpisodeStepper)
    environment = made(name)
    data: mujoco.MjData = environment.unwrapped.data
    physics = state.part(environment.unwrapped.model, state.PHYSICS)
    seen, _ = environment.reset(seed=SEED)
    total, ended, now = 0.0, False, stepper.now()

    for period, action in enumerate(actions(name)[:PERIODS]):
        now = stepper.now()
        assert np.array_equal(stepper.state()[physics], state.save(environment.unwrapped.model, data)[physics])
        assert np.array_equal(now.observation, seen)
        assert np.array_equal(now.action, action)
        assert now.total == total
        assert np.array_equal(stepper.instant().ctrl, action)  # an instant knows the controls that act from there on

        seen, reward, terminated, truncated, told = environment.step(action)
        total, ended = total + reward, terminated or truncated
        for step in range(stepper.control_steps if look_inside else 0):
            stepper.advance(period * stepper.control_steps + step)
            stepper.state()
        stepper.advance((period + 1) * stepper.control_steps)
        now = stepper.now()
        assert now.reward == reward
        assert now.reward_terms.tolist() == [told[f"reward_{name}"] for name in stepper.names.rewards]
        if ended:
            break

    assert (now.ending is not None) == ended
    assert np.array_equal(stepper.state(), state.save(environment.unwrapped.model, data)) or not ended


def test_the_steps_in_between_are_those_of_the_physics() -> None:
    stepper = started("HalfCheetah-v5")
    physics = PhysicsStepper(stepper.model, stepper.initial())
    for period in range(3):
        physics.jump(period * 5, stepper.state())
        for step in range(period * 5, period * 5 + 5):
            stepper.advance(step)
            physics.advance(step)
            assert np.array_equal(stepper.state(), physics.state())
        stepper.advance(period * 5 + 5)


def test_an_episode_ends_at_a_step_beyond_which_nothing_goes(tmp_path: Path) -> None:
    with registered(tmp_path, "", max_episode_steps=3) as name:
        environment = Environment(GymSource(name))
    stepper = EnvironmentStepper(environment, Recorded([np.array([0.5])] * 3), 0)
    stepper.advance(12)
    ending = stepper.now().ending
    assert ending is not None
    assert (ending.name, stepper.now().total) == ("timeout", 4.5)
    with pytest.raises(EpisodeOver) as caught:
        stepper.advance(13)
    assert (caught.value.step, stepper.step, caught.value.ending) == (12, 12, ending)


def test_what_an_environment_does_besides_physics_is_noticed_where_it_matters(tmp_path: Path) -> None:
    with registered(tmp_path, "kicked") as name:
        environment = Environment(GymSource(name))
    stepper = EnvironmentStepper(environment, Recorded([np.array([0.5])] * 9), 0)
    stepper.advance(8)  # the environment's own states
    stepper.advance(9)
    with pytest.raises(UsageError, match=r"does more in its step at 0\.08 s .*\nlook only every 4 steps, 0\.04 s"):
        stepper.advance(12)


def test_an_action_that_is_no_number_is_told_with_its_step() -> None:
    environment = Environment(GymSource("InvertedPendulum-v5"))
    stepper = EnvironmentStepper(environment, Recorded([np.zeros(1), np.array([np.nan])]), 0, "cart.onnx")
    with pytest.raises(SimulationError, match=r"cart\.onnx answered at step 2, time 0\.04 s, .*: slide = nan"):
        stepper.advance(2)


@pytest.mark.parametrize("look_inside", [False, True])
def test_an_unstable_simulation_is_told_with_its_first_bad_step(look_inside: bool) -> None:
    stepper = started("HalfCheetah-v5", Override("joint/*.damping", "-300"))
    reference = PhysicsStepper(stepper.model, stepper.initial())
    looks = range(5 * PERIODS) if look_inside else range(0, 5 * PERIODS, 5)

    def go() -> None:
        for step in looks:
            stepper.advance(step)
            if step % 5 == 0:
                reference.jump(step, stepper.state())

    with pytest.raises(UnstableError) as caught:
        go()
    with pytest.raises(UnstableError) as expected:
        reference.advance(reference.step + 5)
    assert (caught.value.step, str(caught.value)) == (expected.value.step, str(expected.value))
