"""A task is an environment that Gymnasium's checker accepts, with the numbers and limits of its worlds."""

import copy
import os
import pickle
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv
from hypothesis import example, given, settings
from hypothesis import strategies as st

import mjrun
import mjrun.gym
from mjrun.errors import ModelError, UsageError
from mjrun.gym.environments import SQUASHED, action_space, observation_space, task_of
from mjrun.task.task import Action, Observation, Task
from mjrun.task.worlds import TaskWorlds
from tests.gym.tasks import CART, write_cart

VARIED = "reset: {vary: {'actuator/push.ctrlrange[1]': 'uniform(3, 9)'}, noise:"  # replaces `reset: {noise:`


def test_gymnasiums_checker_accepts_a_task(tmp_path: Path) -> None:
    env = mjrun.gym.make(str(write_cart(tmp_path)))
    with warnings.catch_warnings(action="ignore"):  # of infinite observations, as its own environments have
        check_env(env.unwrapped, skip_render_check=True)


def test_it_is_registered_and_has_the_numbers_of_worlds(tmp_path: Path) -> None:
    task = write_cart(tmp_path)
    env = gymnasium.make("mjrun.gym:mjrun/Task-v0", task=task, disable_env_checker=True)
    assert isinstance(env.unwrapped, mjrun.gym.TaskEnv)
    worlds = TaskWorlds(env.unwrapped.task, 1)
    for seed in (3, 4, 5):
        observation, info = env.reset(seed=seed)
        np.testing.assert_array_equal(observation, worlds.reset([seed])[0])
        assert info == {}
        step, terminated, truncated = None, False, False
        while not (terminated or truncated):
            action = env.action_space.sample()
            observation, reward, terminated, truncated, info = env.step(action)
            step = worlds.step(action[None].astype(float))
            np.testing.assert_array_equal(observation, step.observations[0])
            assert reward == step.rewards[0]
            assert info["reward/near"] + info["reward/effort"] == reward
        assert step
        ending = step.ended[0]
        assert ending
        assert (info["ending"], terminated) == (ending.name, ending.terminated)
        assert info["is_success"] == (ending.name == "there")


def test_its_spec_is_json_and_makes_it_again(tmp_path: Path) -> None:
    document = write_cart(tmp_path)
    for task in (document, str(document), mjrun.read_task(document)):
        made = mjrun.gym.make(task, width=320), gymnasium.make("mjrun/Task-v0", task=task, width=320)
        for env in made:
            assert env.spec
            spec = EnvSpec.from_json(env.spec.to_json())
            assert spec.kwargs == {"task": str(document), "width": 320}
            again = gymnasium.make(spec)
            np.testing.assert_array_equal(again.reset(seed=2)[0], env.reset(seed=2)[0])
    changed = replace(mjrun.read_task(document), duration=1)
    env = mjrun.gym.make(changed)
    assert env.spec
    assert env.spec.kwargs == {"task": changed}  # which is not in the document
    assert gymnasium.make(env.spec).unwrapped.task == changed  # type: ignore[attr-defined]


@pytest.mark.parametrize("call", ["step", "reset"])
def test_worlds_refuse_a_fork_instead_of_hanging_and_their_copies_continue(tmp_path: Path, call: str) -> None:
    env, action = mjrun.gym.make_vec(write_cart(tmp_path), 3), np.zeros((3, 2))
    env.reset(seed=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of forks of processes with threads
        child = os.fork()
    if child == 0:
        signal.alarm(20)  # which ends a process that hangs
        try:
            _ = env.step(action) if call == "step" else env.reset(seed=0)
        except UsageError as error:
            (tmp_path / "error").write_text(str(error))
            np.save(tmp_path / "continued.npy", copy.deepcopy(env).step(action)[0])
        finally:
            os._exit(0)
    os.waitpid(child, 0)
    assert "fork of the one that created these worlds" in (tmp_path / "error").read_text()
    np.testing.assert_array_equal(np.load(tmp_path / "continued.npy"), env.step(action)[0])


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_copies_go_on_within_an_episode_with_the_same_numbers(tmp_path: Path, copied: Callable[[Any], Any]) -> None:
    for make in (mjrun.gym.make, partial(mjrun.gym.make_vec, num_envs=3)):
        env = make(write_cart(tmp_path))
        env.reset(seed=1)
        env.action_space.seed(1)
        for _ in range(3):
            env.step(env.action_space.sample())
        other = copied(env)
        for _ in range(25):
            action = env.action_space.sample()
            np.testing.assert_array_equal(other.action_space.sample(), action)
            ours, theirs = env.step(action), other.step(action)
            np.testing.assert_equal(theirs, ours)
            if make is mjrun.gym.make and (ours[2] or ours[3]):
                np.testing.assert_array_equal(other.reset()[0], env.reset()[0])


def test_a_pickled_environment_goes_on_in_another_process(tmp_path: Path) -> None:
    env = mjrun.gym.TaskEnv(write_cart(tmp_path))
    env.reset(seed=3)
    worker = AsyncVectorEnv([partial(copy.copy, env)], context="spawn")
    try:
        np.testing.assert_array_equal(worker.reset(seed=5)[0], [env.reset(seed=5)[0]])
        action = env.action_space.sample()
        np.testing.assert_array_equal(worker.step(np.array([action]))[0], [env.step(action)[0]])
    finally:
        worker.close()


def test_a_document_and_a_model_that_are_edited_change_nothing_of_what_runs(tmp_path: Path) -> None:
    document = write_cart(tmp_path)
    env, other = mjrun.gym.TaskEnv(document), mjrun.gym.TaskEnv(document)
    before = env.reset(seed=3)[0], env.step(np.ones(2))
    document.write_text(document.read_text().replace("scale: 0.5", "scale: 0.7"))
    (tmp_path / "cart.xml").write_text(CART.replace('gear="2"', 'gear="3"'))
    after = other.reset(seed=3)[0], other.step(np.ones(2))
    np.testing.assert_equal(after, before)
    with pytest.raises(ModelError, match=r"cart\.xml is not the model of the copied environment"):
        copy.deepcopy(other)


def test_an_edited_model_is_not_varied(tmp_path: Path) -> None:
    document = write_cart(tmp_path)
    document.write_text(document.read_text().replace("reset: {noise:", VARIED))
    env = mjrun.gym.TaskEnv(document)
    env.reset(seed=3)
    (tmp_path / "cart.xml").write_text(CART.replace('gear="2"', 'gear="33"'))
    with pytest.raises(ModelError, match=r"cart\.xml has changed since the task was loaded"):
        [env.reset(seed=seed) for seed in range(3)]


def test_episodes_without_a_seed_go_on_from_the_last_one(tmp_path: Path) -> None:
    env = mjrun.gym.make(write_cart(tmp_path))
    series = []
    for _ in range(2):
        env.reset(seed=8)
        series.append([env.reset()[0] for _ in range(3)])
    np.testing.assert_array_equal(*series)
    assert (series[0][0][:2] != series[0][1][:2]).all()


@pytest.mark.gl
def test_it_draws_what_it_shows(tmp_path: Path) -> None:
    env = mjrun.gym.make(write_cart(tmp_path), render_mode="rgb_array", width=64, height=48)
    env.reset(seed=1)
    image = env.render()
    assert isinstance(image, np.ndarray)
    assert image.shape == (48, 64, 3)
    assert image.std() > 1
    with pytest.raises(ValueError, match="rgb_array or None"):
        mjrun.gym.TaskEnv(write_cart(tmp_path), render_mode="human")


def test_without_gymnasium_it_says_what_to_install() -> None:
    code = "import sys; sys.modules['gymnasium'] = None\nimport mjrun.gym"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 1
    assert "MissingExtraError: mjrun.gym needs gymnasium" in done.stderr
    assert "pip install 'mjrun[gym]'" in done.stderr


def test_bounds_of_observations_and_actions(tmp_path: Path) -> None:
    task = task_of(write_cart(tmp_path))
    worlds = TaskWorlds(task, 1)
    space = observation_space(worlds)
    assert space.low.tolist() == [-4, -4, -np.inf, -np.inf]
    assert space.high.tolist() == [5, 5, np.inf, np.inf]
    space = action_space(worlds)
    np.testing.assert_allclose(space.low, [-2, -np.pi / 2], rtol=1e-6)
    np.testing.assert_allclose(space.high, [4, np.pi / 2], rtol=1e-6)


def test_bounds_of_actions_are_those_of_the_model_before_its_variation(tmp_path: Path) -> None:
    plain = mjrun.gym.TaskEnv(write_cart(tmp_path))
    document = write_cart(tmp_path)
    document.write_text(document.read_text().replace("reset: {noise:", VARIED))
    assert mjrun.gym.TaskEnv(document).action_space == plain.action_space


def test_another_working_directory_changes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    document = write_cart(Path())
    document.write_text(document.read_text().replace("reset: {noise:", VARIED))
    env = mjrun.gym.TaskEnv(document)
    assert env.task.text == "task.yaml"
    before = env.reset(seed=3)[0], env.step(np.array([9, 0]))
    other = tmp_path / "other"
    other.mkdir()
    monkeypatch.chdir(other)
    Path("cart.xml").write_text(CART.replace('gear="2"', 'gear="3"'))
    for same in (env, pickle.loads(pickle.dumps(env))):
        np.testing.assert_equal((same.reset(seed=3)[0], same.step(np.array([9, 0]))), before)


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


@pytest.fixture(scope="module")
def task(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_cart(tmp_path_factory.mktemp("cart"))


def assert_same(ours: dict[str, Any], theirs: dict[str, Any]) -> None:
    """Compares infos: every key, mask and number, also of worlds that a mask leaves out."""
    assert ours.keys() == theirs.keys()
    for name, values in theirs.items():
        if isinstance(values, dict):
            assert_same(ours[name], values)
            continue
        assert (ours[name].dtype, ours[name].shape) == (values.dtype, values.shape), name
        for value, expected in zip(ours[name], values, strict=True):
            np.testing.assert_equal(value, expected, name)


@pytest.mark.slow
@settings(max_examples=6, deadline=None)
@given(
    mode=st.sampled_from(AutoresetMode),
    count=st.integers(1, 4),
    seed=st.integers(0, 2**31 - 10),
    step_count=st.integers(1, 25),
)
@example(mode=AutoresetMode.SAME_STEP, count=3, seed=11, step_count=40)
@example(mode=AutoresetMode.NEXT_STEP, count=3, seed=11, step_count=40)
@example(mode=AutoresetMode.DISABLED, count=3, seed=11, step_count=40)
def test_it_is_gymnasiums_own_vector_of_environments(
    task: Path, mode: AutoresetMode, count: int, seed: int, step_count: int
) -> None:
    ours = mjrun.gym.make_vec(task, count, autoreset_mode=mode)
    theirs = SyncVectorEnv([lambda: mjrun.gym.TaskEnv(task)] * count, autoreset_mode=mode)
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    assert ours.metadata["autoreset_mode"] == mode
    np.testing.assert_array_equal(ours.reset(seed=seed)[0], theirs.reset(seed=seed)[0])

    theirs.action_space.seed(seed)
    for _ in range(step_count):
        actions = theirs.action_space.sample()
        observations, rewards, terminated, truncated, infos = ours.step(actions)
        expected = theirs.step(actions)
        for value, other in zip((observations, rewards, terminated, truncated), expected[:4], strict=True):
            np.testing.assert_array_equal(value, other)
        assert_same(infos, expected[4])
        over = terminated | truncated
        if mode == AutoresetMode.DISABLED and over.any():
            with pytest.raises(ValueError, match="reset_mask"):
                ours.step(actions)
            again = ours.reset(options={"reset_mask": over.copy()})[0]
            np.testing.assert_array_equal(again, theirs.reset(options={"reset_mask": over.copy()})[0])


def test_episodes_end_in_every_way_there_is(task: Path) -> None:
    worlds = mjrun.gym.make_vec(task, 5)
    worlds.reset(seed=11)
    worlds.action_space.seed(0)
    endings: set[str] = set()
    for _ in range(40):
        infos = worlds.step(worlds.action_space.sample())[4]
        endings |= {*infos.get("ending", ())} - {None}
    assert endings == {"fallen", "there", "timeout"}


def test_gymnasium_makes_it_by_its_name(tmp_path: Path) -> None:
    task = str(write_cart(tmp_path))
    made = gymnasium.make_vec("mjrun/Task-v0", 3, vectorization_mode="vector_entry_point", task=task)
    assert isinstance(made.unwrapped, mjrun.gym.TaskVectorEnv)
    observations, _ = made.reset(seed=[4, 5, 6])  # type: ignore[arg-type]
    np.testing.assert_array_equal(observations, mjrun.gym.make_vec(task, 3).reset(seed=4)[0])


def test_masks_and_seeds_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    made = mjrun.gym.make_vec(write_cart(tmp_path), 2)
    for mask in (np.array([True]), [True, False], np.array([False, False])):
        with pytest.raises(ValueError, match="reset_mask"):
            made.reset(options={"reset_mask": mask})
    with pytest.raises(ValueError, match="3 seeds"):
        made.reset(seed=[1, 2, 3])


def test_values_that_do_not_fit_are_refused_by_name(tmp_path: Path) -> None:
    task = write_cart(tmp_path)
    for name, value in (("num_envs", "3"), ("num_envs", 1.5), ("num_envs", True), ("num_envs", None), ("threads", -1)):
        with pytest.raises(UsageError, match=f"^{name}: '{value}' is not a whole number of at least"):
            mjrun.gym.make_vec(task, **{name: value})  # type: ignore[arg-type]
    with pytest.raises(UsageError, match=r"^no autoreset_mode 'SAME_STEP' \(did you mean 'SameStep'\?\)\nmodes: Next"):
        mjrun.gym.make_vec(task, 2, autoreset_mode="SAME_STEP")
    for env in (mjrun.gym.make(task), mjrun.gym.make_vec(task, 2)):
        with pytest.raises(UsageError, match=r"^seed: '1180591620717411303424' is not a whole number from 0 to"):
            env.reset(seed=2**70)
    for seed, wrong in ((1.5, "1.5"), ("7", "7"), ([1, 1.5], "1.5"), ([1, "x"], "x")):
        with pytest.raises(UsageError, match=f"^seed: '{wrong}' is not a whole number from 0 to"):
            mjrun.gym.make_vec(task, 2).reset(seed=seed)  # type: ignore[arg-type]


def test_a_refused_action_of_one_world_skips_no_episode_of_another(tmp_path: Path) -> None:
    """The next step begins the episode that it would have begun without the refused one."""
    task = write_cart(tmp_path)

    def first_after_an_end(*, refused: bool) -> np.ndarray:
        worlds = mjrun.gym.make_vec(task, 2)
        worlds.reset(seed=1)
        high, over = action_space(worlds.worlds).high, np.zeros(2, bool)
        actions = np.stack([high, 0 * high])  # which end one episode earlier
        while not over.any():
            _, _, terminated, truncated, _ = worlds.step(actions)
            over = terminated | truncated
        assert not over.all()
        if refused:
            with pytest.raises(ValueError, match="finite"):
                worlds.step(np.where(over[:, None], actions, np.nan))
        return worlds.step(actions)[0]

    np.testing.assert_array_equal(first_after_an_end(refused=True), first_after_an_end(refused=False))
