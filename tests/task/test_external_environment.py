"""Environments of Gymnasium's are stepped as they step themselves, and to every physics step in between."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest

from mjrun.errors import ControllerError, ModelNotFoundError, SimulationError, UnstableError, UsageError
from mjrun.model import state
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.override import Override
from mjrun.model.sources.gym import GymSource, quiet
from mjrun.physics.stepper import PhysicsStepper
from mjrun.task.episode import EpisodeOver, EpisodeStepper
from mjrun.task.external_environment import EnvironmentStepper, ExternalEnvironment
from mjrun.timeline import rational
from tests.task.environments import registered

ACTION = np.array([0.25])
DENSE = (Override("geom/cart.density", "2000"),)


@pytest.mark.parametrize("name", ["Ant-v5", "Humanoid-v5", "Swimmer-v5"])
def test_the_names_of_an_observation_are_the_columns_it_consists_of(name: str) -> None:
    environment = ExternalEnvironment(GymSource(name))
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
    environment = ExternalEnvironment(GymSource("HalfCheetah-v5"))
    assert environment.action_names == ["bthigh", "bshin", "bfoot", "fthigh", "fshin", "ffoot"]
    assert (environment.action_low.tolist(), environment.action_high.tolist()) == ([-1.0] * 6, [1.0] * 6)
    assert (environment.control_steps, float(environment.control_dt)) == (5, 0.05)


def test_an_action_of_another_size_is_refused() -> None:
    environment = ExternalEnvironment(GymSource("InvertedPendulum-v5"))
    environment.reset(0)
    with pytest.raises(UsageError, match=r"InvertedPendulum-v5 takes actions of 1 numbers, not of 2"):
        environment.step(np.zeros(2))


def test_actions_that_are_no_vectors_are_refused(tmp_path: Path) -> None:
    with (
        registered(tmp_path, "discrete") as name,
        pytest.raises(UsageError, match=r"action space Discrete\(2\)"),
    ):
        ExternalEnvironment(GymSource(name))


def test_environments_that_are_not_on_mujoco_are_refused() -> None:
    with pytest.raises(ModelNotFoundError, match="it does not run on MuJoCo"):
        ExternalEnvironment(GymSource("Pendulum-v1"))


def test_observations_of_several_parts_are_flattened_as_gymnasium_does(tmp_path: Path) -> None:
    with registered(tmp_path, "dict") as name:
        environment = ExternalEnvironment(GymSource(name))
        environment.reset(1)
        seen = environment.step(ACTION).observation
        assert seen.tolist() == [*environment.data.qpos, *environment.data.qvel]
        assert environment.observation_names == ["position/0", "velocity/0"]


def test_an_environment_may_hold_the_one_that_simulates(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with registered(tmp_path, "held") as name:
        held, plain = ExternalEnvironment(GymSource(name)), ExternalEnvironment(GymSource(name, overrides=DENSE))
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
        environment = ExternalEnvironment(GymSource(name))
        environment.reset(0)
        results = [environment.step(ACTION) for _ in range(steps)]
    assert [result.ending for result in results[:-1]] == [None] * (steps - 1)
    assert results[-1].ending is not None
    assert (results[-1].ending.name, results[-1].ending.kind) == ending
    assert results[0].reward_terms == {"alive": 1.0, "speed": 0.5}


def test_an_environment_that_raises_is_told_with_its_traceback(tmp_path: Path) -> None:
    with registered(tmp_path, "raises") as name:
        environment = ExternalEnvironment(GymSource(name))
        environment.reset(0)
        for _ in range(2):
            environment.step(ACTION)
        with pytest.raises(ControllerError, match=r"^step of gym:acme/Cart-v0 raised ZeroDivisionError: the cart is"):
            environment.step(ACTION)


def test_an_overridden_model_takes_the_place_of_its_own_and_the_control_period_stays() -> None:
    source = GymSource("Hopper-v5", overrides=(Override("opt.timestep", "0.001"), Override("opt.gravity", "0 0 -1")))
    environment, plain = ExternalEnvironment(source), ExternalEnvironment(GymSource("Hopper-v5"))
    assert environment.control_dt == plain.control_dt
    assert (environment.control_steps, environment.model.opt.gravity[2]) == (8, -1)
    environment.reset(0)
    environment.step(np.zeros(3))
    assert environment.data.time == pytest.approx(float(plain.control_dt))


def test_a_timestep_that_does_not_divide_the_control_period_is_refused() -> None:
    with pytest.raises(UsageError, match=r"acts every 0\.008 s, which must be a whole number of timesteps"):
        ExternalEnvironment(GymSource("Hopper-v5", overrides=(Override("opt.timestep", "0.003"),)))


def test_a_timestep_that_is_a_quotient_of_floats_divides_the_control_period() -> None:
    text = repr(0.008 / 7)
    assert 7 * rational(text) != rational("0.008")
    source = GymSource("Hopper-v5", overrides=(Override("opt.timestep", text),))
    assert ExternalEnvironment(source).control_steps == 7


def test_an_episode_starts_where_an_overridden_model_does() -> None:
    plain = ExternalEnvironment(GymSource("InvertedPendulum-v5"))
    moved = ExternalEnvironment(GymSource("InvertedPendulum-v5", overrides=(Override("joint/slider.ref", "0.5"),)))
    assert moved.reset(4)[0] == plain.reset(4)[0] + 0.5
    assert moved.reset(4)[1] == plain.reset(4)[1]


PERIODS, SEED = 40, 5
NAMES = ["HalfCheetah-v5", "Humanoid-v5", "Reacher-v5", "Ant-v4"]


class Recorded:
    """A policy that gives the same actions in every episode."""

    def __init__(self, actions: Sequence[np.ndarray]) -> None:
        self.actions = iter(actions)

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        return next(self.actions)


def made(name: str) -> Any:
    with collected_warnings(), quiet():
        return gymnasium.make(name, disable_env_checker=True)


def actions(name: str) -> list[np.ndarray]:
    space, rng = made(name).action_space, np.random.default_rng(7)
    return [rng.uniform(space.low, space.high).astype(np.float32) for _ in range(PERIODS + 1)]


def started(name: str, *overrides: Override) -> EnvironmentStepper:
    with collected_warnings():
        return EnvironmentStepper(
            ExternalEnvironment(GymSource(name, overrides=overrides)), Recorded(actions(name)), SEED
        )


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("look_inside", [False, True])
def test_states_observations_and_rewards_are_those_of_a_bare_loop(name: str, look_inside: bool) -> None:
    stepper = started(name)
    assert isinstance(stepper, EpisodeStepper)
    environment = made(name)
    data: mujoco.MjData = environment.unwrapped.data
    physics = state.part(environment.unwrapped.model, int(mujoco.mjtState.mjSTATE_PHYSICS))
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
        environment = ExternalEnvironment(GymSource(name))
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
        environment = ExternalEnvironment(GymSource(name))
    stepper = EnvironmentStepper(environment, Recorded([np.array([0.5])] * 9), 0)
    stepper.advance(8)  # the environment's own states
    stepper.advance(9)
    with pytest.raises(UsageError, match=r"does more in its step at 0\.08 s .*\nrequest only every 4 steps, 0\.04 s"):
        stepper.advance(12)


def test_an_action_that_is_no_number_is_told_with_its_step() -> None:
    environment = ExternalEnvironment(GymSource("InvertedPendulum-v5"))
    stepper = EnvironmentStepper(environment, Recorded([np.zeros(1), np.array([np.nan])]), 0, "cart.onnx")
    with pytest.raises(
        SimulationError, match=r"cart\.onnx returned non-finite actions at step 2, time 0\.04 s: slide = nan"
    ):
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


def test_what_an_environment_tells_of_its_reward_without_a_number_is_no_term(tmp_path: Path) -> None:
    with registered(tmp_path, "talks") as name:
        environment = ExternalEnvironment(GymSource(name))
        environment.reset(0)
        assert environment.step(ACTION).reward_terms == {"alive": 1.0, "speed": 0.5}
