"""Theorems about Gymnasium's environments as tasks: what they give is what Gymnasium gives."""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from mjrun.errors import ControllerError, ModelNotFoundError, UsageError
from mjrun.model.override import Override
from mjrun.model.sources.gym import GymSource
from mjrun.task.gymnasium import Environment
from tests.task.environments import registered

ACTION = np.array([0.25])
DENSE = (Override("geom/cart.density", "2000"),)


@pytest.mark.parametrize("name", ["Ant-v5", "Humanoid-v5", "Swimmer-v5"])
def test_the_names_of_an_observation_are_the_columns_it_consists_of(name: str) -> None:
    environment = Environment(GymSource(name))
    theirs: Any = gymnasium.make(name)
    assert environment.observation_size == len(environment.observation_names) == theirs.observation_space.shape[0]
    assert environment.episode_steps == theirs.spec.max_episode_steps

    observation = environment.reset(seed=3)
    values = dict(zip(environment.observation_names, observation, strict=True))
    joints = environment.model.joint(1), environment.model.joint(environment.model.njnt - 1)
    for joint in joints:
        place = values.get(f"qpos/{joint.name}")
        assert place is None or place == environment.data.qpos[joint.qposadr[0]]
        assert values[f"qvel/{joint.name}"] == environment.data.qvel[joint.dofadr[0]]


def test_actions_have_the_names_of_controls_and_the_bounds_of_the_environment() -> None:
    environment = Environment(GymSource("HalfCheetah-v5"))
    assert environment.action_names == ["bthigh", "bshin", "bfoot", "fthigh", "fshin", "ffoot"]
    assert (environment.action_low.tolist(), environment.action_high.tolist()) == ([-1.0] * 6, [1.0] * 6)
    assert (environment.control_steps, float(environment.control_dt)) == (5, 0.05)


def test_an_action_of_another_size_is_refused() -> None:
    environment = Environment(GymSource("InvertedPendulum-v5"))
    environment.reset(0)
    with pytest.raises(UsageError, match=r"InvertedPendulum-v5 takes actions of 1 numbers, not of 2"):
        environment.step(np.zeros(2))


def test_actions_that_are_no_vectors_are_refused(tmp_path: Path) -> None:
    with (
        registered(tmp_path, "discrete") as name,
        pytest.raises(UsageError, match=r"actions of the kind Discrete\(2\)"),
    ):
        Environment(GymSource(name))


def test_environments_that_are_not_on_mujoco_are_refused() -> None:
    with pytest.raises(ModelNotFoundError, match="its simulation is not MuJoCo's"):
        Environment(GymSource("Pendulum-v1"))


def test_observations_of_several_parts_are_flattened_as_gymnasium_does(tmp_path: Path) -> None:
    with registered(tmp_path, "dict") as name:
        environment = Environment(GymSource(name))
        environment.reset(1)
        seen = environment.step(ACTION).observation
        assert seen.tolist() == [*environment.data.qpos, *environment.data.qvel]
        assert environment.observation_names == ["position/0", "velocity/0"]


def test_an_environment_may_hold_the_one_that_simulates(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with registered(tmp_path, "held") as name:
        held, plain = Environment(GymSource(name)), Environment(GymSource(name, overrides=DENSE))
    assert held.control_steps == plain.control_steps == 4
    assert plain.model.body_mass[1] == 2 * held.model.body_mass[1]
    held.reset(3)
    held.step(ACTION)
    assert held.data.time == pytest.approx(0.04)
    assert "payload" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("fault", "steps", "ending"), [("arrives", 3, ("terminated", "success")), ("", 5, ("timeout", "timeout"))]
)
def test_an_episode_ends_as_the_environment_says(
    tmp_path: Path, fault: str, steps: int, ending: tuple[str, str]
) -> None:
    with registered(tmp_path, fault, max_episode_steps=5) as name:
        environment = Environment(GymSource(name))
        environment.reset(0)
        results = [environment.step(ACTION) for _ in range(steps)]
    assert [result.ending for result in results[:-1]] == [None] * (steps - 1)
    assert results[-1].ending is not None
    assert (results[-1].ending.name, results[-1].ending.kind) == ending
    assert results[0].reward_terms == {"alive": 1.0, "speed": 0.5}


def test_an_environment_that_raises_is_told_with_its_traceback(tmp_path: Path) -> None:
    with registered(tmp_path, "raises") as name:
        environment = Environment(GymSource(name))
        environment.reset(0)
        for _ in range(2):
            environment.step(ACTION)
        with pytest.raises(ControllerError, match=r"^step of gym:acme/Cart-v0 raised ZeroDivisionError: the cart is"):
            environment.step(ACTION)


def test_an_overridden_model_takes_the_place_of_its_own_and_the_control_period_stays() -> None:
    source = GymSource("Hopper-v5", overrides=(Override("opt.timestep", "0.001"), Override("opt.gravity", "0 0 -1")))
    environment, plain = Environment(source), Environment(GymSource("Hopper-v5"))
    assert environment.control_dt == plain.control_dt
    assert (environment.control_steps, environment.model.opt.gravity[2]) == (8, -1)
    environment.reset(0)
    environment.step(np.zeros(3))
    assert environment.data.time == pytest.approx(float(plain.control_dt))


def test_a_timestep_that_does_not_divide_the_control_period_is_refused() -> None:
    with pytest.raises(UsageError, match=r"acts every 0\.008 s, which must be a whole number of timesteps"):
        Environment(GymSource("Hopper-v5", overrides=(Override("opt.timestep", "0.003"),)))


def test_an_episode_starts_where_an_overridden_model_does() -> None:
    plain = Environment(GymSource("InvertedPendulum-v5"))
    moved = Environment(GymSource("InvertedPendulum-v5", overrides=(Override("joint/slider.ref", "0.5"),)))
    assert moved.reset(4)[0] == plain.reset(4)[0] + 0.5
    assert moved.reset(4)[1] == plain.reset(4)[1]
