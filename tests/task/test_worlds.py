"""Worlds of a task: Gymnasium's environments to 1e-12, a bare loop of mj_step to the bit, and nothing of each other."""

import warnings

import gymnasium
import mujoco
import numpy as np
import pytest

from mjrun.task.task import Task
from mjrun.task.terms import Action, Observation, Reset, Termination
from mjrun.task.worlds import TaskWorlds
from tests.task import gymnasium_tasks

CART = """<mujoco><option timestep="0.01"/>
  <worldbody><geom type="plane" size="5 5 .1"/>
    <body name="cart" pos="0 0 .2"><joint name="slide" type="slide" axis="1 0 0" damping=".1"/><geom size=".1"/>
      <body name="pole"><joint name="hinge" axis="0 1 0"/><geom type="capsule" size=".03" fromto="0 0 0 0 0 .6"/></body>
    </body>
    <body name="ball" pos="0 1 .5"><freejoint name="ball"/><geom size=".1"/></body>
  </worldbody>
  <actuator><motor name="push" joint="slide" gear="2"/><motor name="turn" joint="hinge"/></actuator>
  <keyframe><key name="home" qpos=".5 .3 0 1 .5 1 0 0 0" ctrl=".1 .2"/></keyframe></mujoco>"""
MODEL = mujoco.MjModel.from_xml_string(CART)


def cart(**values: object) -> Task:
    given = {
        "control_dt": 0.03,
        "duration": 0.6,
        "observations": [
            Observation(name="joints", joints=["hinge", "slide"]),
            Observation(name="ball", probe="xpos/ball", scale=[1, 2, 3], offset=0.5, clip=[-2, 2]),
            Observation(name="last", action="previous"),
        ],
        "actions": [Action(actuators=["turn", "push"], squash="tanh", scale=[0.5, 2], offset="home")],
        "rewards": {"near": "exp(-norm(qpos/slide, xpos/pole/z - 1))", "effort": "-rate(qpos/hinge)^2"},
        "terminations": {"away": Termination(when="abs(qpos/slide) > 3", as_="failure")},
        "reset": Reset(key="home", noise={"qpos/ball": "uniform(-.1, .1)", "qvel/hinge": "normal(0, 1)"}),
        **values,
    }
    return Task(MODEL, **given)  # type: ignore[arg-type]


def random_actions(*shape: int) -> np.ndarray:
    return np.random.default_rng(5).normal(size=shape)


def test_observations_rewards_and_states_are_those_of_a_bare_loop() -> None:
    worlds = TaskWorlds(cart(), 3)
    first = worlds.reset([7, 8, 9])
    data = mujoco.MjData(MODEL)
    mujoco.mj_setState(MODEL, data, worlds.state(1), mujoco.mjtState.mjSTATE_INTEGRATION)
    mujoco.mj_forward(MODEL, data)
    assert abs(np.linalg.norm(data.qpos[5:9]) - 1) < 1e-15
    assert (data.qpos[:2] == [0.5, 0.3]).all()
    instant = mujoco.MjData(MODEL)

    def observed(last: np.ndarray) -> np.ndarray:
        mujoco.mj_copyData(instant, MODEL, data)
        mujoco.mj_forward(MODEL, instant)
        ball = np.clip((instant.xpos[3] - 0.5) * [1, 2, 3], -2, 2)
        return np.concatenate([data.qpos[[1, 0]], ball, last])

    np.testing.assert_array_equal(first[1], observed(np.zeros(2)))
    actions = random_actions(20, 3, 2)
    for k in range(20):
        before = data.qpos[1]
        data.ctrl[[1, 0]] = np.tanh(actions[k, 1]) * [0.5, 2] + [0.2, 0.1]
        for _ in range(3):
            mujoco.mj_step(MODEL, data)
        step = worlds.step(actions[k])
        np.testing.assert_array_equal(step.observations[1], observed(actions[k, 1]))
        near = np.exp(-np.hypot(data.qpos[0], instant.xpos[2, 2] - 1))
        np.testing.assert_allclose(step.reward_terms[1], [near, -(((data.qpos[1] - before) / 0.03) ** 2)], rtol=1e-12)
        assert step.rewards[1] == step.reward_terms[1, 0] + step.reward_terms[1, 1]
        state = np.empty_like(worlds.state(1))
        mujoco.mj_getState(MODEL, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        np.testing.assert_array_equal(worlds.state(1), state)
        assert step.truncated.all() == (k == 19)
    assert [ending and ending.name for ending in step.ended] == ["timeout"] * 3


def test_names_say_what_the_numbers_are() -> None:
    worlds = TaskWorlds(cart(), 1)
    assert worlds.observation_names == [
        *("joints/hinge", "joints/slide", "ball/x", "ball/y", "ball/z", "last/turn", "last/push")
    ]
    assert worlds.action_names == ["turn", "push"]
    assert worlds.reward_names == ["near", "effort"]
    assert worlds.control_steps == 3
    assert (worlds.observed[3].source, worlds.observed[3].unit, worlds.observed[3].scale) == ("xpos/ball/y", "m", 2)


@pytest.mark.parametrize("environment", gymnasium_tasks.TASKS)
def test_tasks_equal_gymnasiums_environments(environment: str) -> None:
    task = gymnasium_tasks.TASKS[environment]()
    with warnings.catch_warnings(action="ignore"):
        worlds = TaskWorlds(task, 2)
        env = gymnasium.make(environment).unwrapped
    env.reset(seed=0)
    seeds = iter(range(1000, 3000, 2))

    def begin() -> None:
        observations = worlds.reset([seed := next(seeds), seed + 1])
        state, nq, nv = worlds.state(1), env.model.nq, env.model.nv
        env.set_state(state[1 : 1 + nq], state[1 + nq : 1 + nq + nv])
        np.testing.assert_allclose(observations[1], env._get_obs(), rtol=0, atol=1e-12)

    begin()
    space = env.action_space
    actions = np.random.default_rng(1).uniform(space.low, space.high, (1000, 2, *space.shape))
    for action in actions:
        step = worlds.step(action)
        observation, reward, terminated, _, _ = env.step(action[1])
        np.testing.assert_allclose(step.observations[1], observation, rtol=0, atol=1e-12)
        assert abs(step.rewards[1] - reward) < 1e-12
        assert bool(step.terminated[1]) == terminated
        if step.over.any():
            begin()
