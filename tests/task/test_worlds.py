"""Worlds of a task: Gymnasium's environments to 1e-12, a bare loop of mj_step to the bit, and nothing of each other."""

import gc
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from weakref import ref

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.envs.mujoco import MujocoEnv
from gymnasium.spaces import Box

from mjrun.errors import UsageError
from mjrun.model.sources import parse_source
from mjrun.probe.fields import LAZY
from mjrun.task.task import Action, Command, Observation, Reset, Task, Termination
from mjrun.task.worlds import TaskWorlds
from tests.task import gymnasium_tasks

CART = """<mujoco><option timestep="0.01"/>
  <worldbody><geom name="floor" type="plane" size="5 5 .1"/>
    <body name="cart" pos="0 0 .2"><joint name="slide" type="slide" axis="1 0 0" damping=".1"/><geom size=".1"/>
      <body name="pole"><joint name="hinge" axis="0 1 0"/><geom type="capsule" size=".03" fromto="0 0 0 0 0 .6"/></body>
    </body>
    <body name="ball" pos="0 1 .5"><freejoint name="ball"/><geom size=".1"/><site name="rim" pos=".1 0 0"/></body>
  </worldbody>
  <actuator><motor name="push" joint="slide" gear="2"/><motor name="turn" joint="hinge"/></actuator>
  <keyframe><key name="home" qpos=".5 .3 0 1 .5 1 0 0 0" ctrl=".1 .2"/></keyframe></mujoco>"""
MODEL = mujoco.MjModel.from_xml_string(CART)
TURN = [Action(actuators=["turn"])]


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


def replace_model(task: Task, path: Path) -> Task:
    """The same task, with a model that can vary."""
    return replace(task, model=parse_source(str(path)))


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
    step = None
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
    assert step
    assert [ending and ending.name for ending in step.ended] == ["timeout"] * 3


EVERYTHING = {
    "observations": [
        Observation(name="joints", joints=["*"], noise="normal(0, 0.01)", delay=2, history=3),
        Observation(name="ball", probe="cvel/ball", frame="pole", clip=[-5, 5]),
        Observation(name="goal", command="goal"),
        Observation(name="gait", phase=0.7),
        Observation(name="contact", probe=["contact/ncon", "cfrc_ext/ball", "contact_force"]),
        Observation(name="whole", probe=["momentum", "speed", "energy", "com"]),
        Observation(name="change", value="rate(norm('qvel/*')) + exp(-qpos/slide^2) * command/goal/0"),
    ],
    "actions": [
        Action(joints="hinge", target="position", kp=20, kd=[0.5], scale=0.25, offset="home"),
        Action(actuators="push", clip=[-1, 1]),
    ],
    "commands": {"goal": Command(random="uniform(-1, 1)", size=2, every=0.15)},
    "rewards": {"a": "tanh(rate(xpos/ball/z)) - sum('action/*'^2)", "b": "exp(-norm('qpos/*', command/goal/1))"},
    "terminations": {"away": Termination(when="abs(qpos/slide - command/goal/0) > 1.5", as_="failure")},
    "reset": Reset(
        noise={"qpos/ball": "uniform(-.1, .1)"},
        vary={"geom/floor.friction[0]": "uniform(0.1, 1)", "opt.gravity[2]": "uniform(-12, -8)"},
    ),
}
DISTURBED = {
    **EVERYTHING,
    "actions": [
        Action(joints="hinge", target="position", kp=20, kd=[0.5], scale=0.25, offset="home", delay=2),
        Action(actuators="push", clip=[-1, 1], delay=1),
    ],
    "ctrl_noise": 0.2,
    "ctrl_noise_time": 0.02,
    "push": ["ball=0/5/0@0.04+0.1", "site:rim=0/1/1@0.1+0.07", "pole=1/0/0@0.3+1"],
}


@pytest.mark.parametrize("probes", [["cacc", "cfrc_int"], ["contact_force", "cacc", "cfrc_int"], ["qfrc_inverse"]])
def test_lagged_quantities_are_those_of_the_state_before_the_last_step(probes: list[str]) -> None:
    task = cart(observations=[Observation(name=probe, probe=probe) for probe in probes], derived="lagged", actions=TURN)
    fields = [probe for probe in probes if probe in LAZY]
    worlds, data, before = TaskWorlds(task, 1), mujoco.MjData(MODEL), mujoco.MjData(MODEL)
    worlds.reset([3])
    mujoco.mj_setState(MODEL, data, worlds.state(0), mujoco.mjtState.mjSTATE_INTEGRATION)
    for action in random_actions(5, 1):
        data.ctrl[1] = action[0]
        mujoco.mj_step(MODEL, data, nstep=worlds.control_steps - 1)
        mujoco.mj_copyData(before, MODEL, data)
        mujoco.mj_forward(MODEL, before)
        mujoco.mj_step(MODEL, data)

        expected = []
        for field in fields:
            LAZY[field](MODEL, before)
            expected += [getattr(before, field).ravel()]
        observed = worlds.step(action[None]).observations[0]
        np.testing.assert_array_equal(observed[-np.concatenate(expected).size :], np.concatenate(expected))


@pytest.mark.parametrize("derived", ["current", "lagged"])
def test_a_sensor_of_kinetic_energy_shows_the_same_instant_as_the_energy(tmp_path: Path, derived: str) -> None:
    text = CART.replace("<keyframe>", '<sensor><e_kinetic name="all"/></sensor><keyframe>')
    (tmp_path / "cart.xml").write_text(text)
    observed = [Observation(name=name, probe=name) for name in ("sensor/all", "energy/kinetic")]
    worlds = TaskWorlds(replace_model(cart(observations=observed, derived=derived), tmp_path / "cart.xml"), 1)
    seen = [worlds.reset([3])] + [worlds.step(action).observations for action in random_actions(5, 1, 2)]
    sensed, kinetic = np.concatenate(seen).T
    np.testing.assert_array_equal(sensed, kinetic)
    assert np.unique(sensed).size == sensed.size


@pytest.mark.parametrize("flag", ["", '<option><flag sleep="enable"/></option>'], ids=["awake", "asleep"])
@pytest.mark.parametrize("derived", ["current", "lagged"])
def test_a_quantity_does_not_depend_on_what_else_is_observed(tmp_path: Path, derived: str, flag: str) -> None:
    (tmp_path / "cart.xml").write_text(CART.replace("<worldbody>", f"{flag}<worldbody>"))
    inner = Observation(name="inner", probe="cfrc_int")
    both = [inner, Observation(name="contact", probe="contact_force")]
    tasks = [replace_model(cart(observations=each, derived=derived), tmp_path / "cart.xml") for each in ([inner], both)]
    one, other = (TaskWorlds(task, 1) for task in tasks)
    np.testing.assert_array_equal(other.reset([3])[:, : one.observations.size], one.reset([3]))
    for action in random_actions(5, 1, 2):
        observed = one.step(action).observations
        np.testing.assert_array_equal(other.step(action).observations[:, : observed.size], observed)


@pytest.mark.parametrize(("derived", "values"), [("current", DISTURBED), ("lagged", EVERYTHING)])
def test_an_episode_is_the_same_alone_and_among_others(
    tmp_path: Path, derived: str, values: Mapping[str, object]
) -> None:
    (tmp_path / "cart.xml").write_text(CART)
    task = replace_model(cart(**values, derived=derived), tmp_path / "cart.xml")
    actions = random_actions(20, 5, 2)
    several, alone = TaskWorlds(task, 5, threads=2), TaskWorlds(task, 1)
    first = several.reset([1, 2, 3, 4, 5])
    together = [several.step(action) for action in actions[:7]]
    several.reset([9], ids=[1])  # in the middle of the others
    ids = np.array([4, 3, 0])
    together += [several.step(action[ids], ids) for action in actions[7:12]]

    np.testing.assert_array_equal(alone.reset([4]), first[[3]])
    assert alone.model(0).opt.gravity[2] == several.model(3).opt.gravity[2] != several.model(4).opt.gravity[2]
    for k, step in enumerate(together):
        row = 3 if k < 7 else 1
        expected = alone.step(actions[k, [3]])
        np.testing.assert_array_equal(step.observations[row], expected.observations[0])
        np.testing.assert_array_equal(step.reward_terms[row], expected.reward_terms[0])
        assert step.ended[row] == expected.ended[0]
    np.testing.assert_array_equal(several.state(3), alone.state(0))


def test_a_measured_momentum_has_the_masses_of_each_world(tmp_path: Path) -> None:
    (tmp_path / "cart.xml").write_text(CART)
    vary = Reset(vary={"geom/*.density": "uniform(100, 5000)"})
    observed = [Observation(name="momentum", probe=["momentum/px", "momentum/pz"])]
    task = replace_model(cart(observations=observed, reset=vary), tmp_path / "cart.xml")
    worlds = TaskWorlds(task, 3)
    worlds.reset([1, 2, 3])
    steps = [worlds.step(action) for action in random_actions(4, 3, 2)]

    for world in range(3):
        model, data = worlds.model(world), mujoco.MjData(worlds.model(world))
        mujoco.mj_setState(model, data, worlds.state(world), mujoco.mjtState.mjSTATE_INTEGRATION)
        mujoco.mj_forward(model, data)
        mujoco.mj_subtreeVel(model, data)
        momentum = model.body_subtreemass[0] * data.subtree_linvel[0]
        np.testing.assert_allclose(steps[-1].observations[world], momentum[[0, 2]], rtol=1e-9, atol=1e-12)
    assert len({worlds.model(world).body_subtreemass[0] for world in range(3)}) == 3


def test_delays_that_vary_act_as_in_models_with_these_delays(tmp_path: Path) -> None:
    (tmp_path / "cart.xml").write_text(CART)
    delays = {
        "actuator/push.delay": "uniform(0, 0.05)",
        "scale:actuator/turn.delay": "2",
        "actuator/t*.delay": "choice(0s, 40ms)",
    }
    reset = Reset(key="home", set={"ctrl/push": "3"}, vary=delays)
    task = replace_model(cart(actions=[Action(actuators="turn")], reset=reset), tmp_path / "cart.xml")
    worlds, seeds = TaskWorlds(task, 4), [1, 2, 3, 4]
    worlds.reset(seeds)
    actions = random_actions(10, 4, 1)
    for action in actions:
        worlds.step(action)
    drawn = np.array([worlds.model(world).actuator_delay for world in range(4)])
    assert len({*drawn[:, 0]}) == 4
    assert {*drawn[:, 1]} == {0, 0.04}
    for world in range(4):
        spec = mujoco.MjSpec.from_string(CART)
        for actuator, delay in zip(spec.actuators, drawn[world], strict=True):
            actuator.delay, actuator.nsample = delay, 9
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        data.ctrl[0] = 3
        for action in actions:
            data.ctrl[1] = action[world, 0]
            mujoco.mj_step(model, data, 3)
        np.testing.assert_array_equal(worlds.state(world)[1 : 1 + model.nq], data.qpos)


@pytest.mark.parametrize(
    ("path", "values", "message"),
    [
        ("actuator/push.delay", "normal(0.1, 0.01)", "a delay must have a limit"),
        ("actuator/push.nsample", "integers(1, 9)", "states of the same size"),
        ("actuator/push.dyntype", "choice(integrator, none)", "states of the same size"),
        ("size.memory", "choice(1M, 2M)", "states of the same size"),
    ],
)
@pytest.mark.parametrize("observed", ["qpos", "contact_force"])  # the second one reads an MjData
def test_models_that_do_not_fit_one_world_are_refused(
    path: str, values: str, message: str, observed: str, tmp_path: Path
) -> None:
    (tmp_path / "cart.xml").write_text(CART)
    reset, observations = Reset(vary={path: values}), [Observation(name="seen", probe=observed)]
    task = replace_model(cart(observations=observations, reset=reset), tmp_path / "cart.xml")
    with pytest.raises(UsageError, match=message) as caught:
        TaskWorlds(task, 9).reset(range(9))
    assert caught.value.path == ("reset", "vary", path)


def test_position_targets_are_held_by_torques_at_every_step() -> None:
    hold = Action(joints="hinge", target="position", kp=20, kd=0.5, scale=0.25, offset="home")
    worlds = TaskWorlds(cart(actions=[hold]), 2)
    worlds.reset([1, 2])
    data = mujoco.MjData(MODEL)
    mujoco.mj_setState(MODEL, data, worlds.state(1), mujoco.mjtState.mjSTATE_INTEGRATION)
    for action in random_actions(10, 2, 1):
        worlds.step(action)
        for _ in range(3):
            data.ctrl[1] = 20 * (action[1, 0] * 0.25 + 0.3 - data.qpos[1]) - 0.5 * data.qvel[1]
            mujoco.mj_step(MODEL, data)
        np.testing.assert_array_equal(worlds.state(1)[1 : 1 + MODEL.nq], data.qpos)


def test_an_unstable_world_ends_as_a_failure_and_the_others_go_on() -> None:
    task = cart(actions=[Action(actuators="push", scale=1e9)], terminations={}, duration=6)
    worlds = TaskWorlds(task, 2)
    before = worlds.reset([1, 2])
    step = worlds.step(np.array([[0.0], [1.0]]))
    while not step.over.any():
        before = step.observations
        step = worlds.step(np.array([[0.0], [1.0]]))
    assert [ending and (ending.name, ending.kind) for ending in step.ended] == [None, ("unstable", "failure")]
    assert np.isfinite(step.rewards).all()
    assert step.terminated.tolist() == [False, True]
    np.testing.assert_array_equal(step.observations[1], before[1])
    with pytest.raises(ValueError, match="reset it"):
        worlds.step(np.zeros((2, 1)))
    worlds.reset([3], ids=[1])
    assert worlds.step(np.zeros((2, 1))).ended == (None, None)


def test_actions_that_cannot_be_are_refused() -> None:
    worlds = TaskWorlds(cart(), 2)
    with pytest.raises(ValueError, match="reset it"):
        worlds.step(np.zeros((2, 2)))
    worlds.reset([1, 2])
    with pytest.raises(ValueError, match=r"shape \(2, 2\), not a tuple \(list, NoneType\)"):
        worlds.step(([0, 0], None))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"shape \(2, 2\), not \(2, 3\)"):
        worlds.step(np.zeros((2, 3)))
    with pytest.raises(ValueError, match="push is nan in world 1"):
        worlds.step(np.array([[0, 0], [0, np.nan]]))


def test_mistakes_are_told_where_they_stand() -> None:
    for values, path in (
        ({"rewards": {"x": "qpos/slid"}}, ("rewards", "x", "value")),
        ({"terminations": {"x": Termination(when="1 + 1", as_="failure")}}, ("terminations", "x", "when")),
        ({"control_dt": 0.025}, ("control_dt",)),
        ({"reset": Reset(key="hom")}, ("reset", "key")),
    ):
        with pytest.raises(UsageError) as caught:
            TaskWorlds(cart(**values), 1).reset([0])
        assert caught.value.path == path


def test_names_say_what_the_numbers_are() -> None:
    worlds = TaskWorlds(cart(), 1)
    assert worlds.observation_names == [
        *("joints/hinge", "joints/slide", "ball/x", "ball/y", "ball/z", "last/turn", "last/push")
    ]
    assert worlds.action_names == ["turn", "push"]
    assert worlds.reward_names == ["near", "effort"]
    assert worlds.control_steps == 3
    assert (worlds.observed[3].source, worlds.observed[3].unit, worlds.observed[3].scale) == ("xpos/ball/y", "m", 2)


@pytest.mark.slow
@pytest.mark.parametrize("environment", gymnasium_tasks.TASKS)
def test_tasks_equal_gymnasiums_environments(environment: str) -> None:
    task = gymnasium_tasks.TASKS[environment]()
    with warnings.catch_warnings(action="ignore"):
        worlds = TaskWorlds(task, 2)
        env = gymnasium.make(environment).unwrapped
    assert isinstance(env, MujocoEnv)
    space = env.action_space
    assert isinstance(space, Box)
    seeds = iter(range(1000, 9000, 2))
    ours, theirs = [], []

    def begin() -> None:
        observations = worlds.reset([seed := next(seeds), seed + 1])
        state, nq, nv = worlds.state(1), env.model.nq, env.model.nv
        env.reset()
        env.set_state(state[1 : 1 + nq], state[1 + nq : 1 + nq + nv])
        mujoco.mj_rnePostConstraint(env.model, env.data)  # forces of contacts, which Gymnasium begins with zeros
        ours.append([*observations[1], 0, 0])
        theirs.append([*env._get_obs(), 0, 0])  # type: ignore[attr-defined]

    begin()
    for action in np.random.default_rng(1).uniform(space.low, space.high, (30, 2, *space.shape)):
        step = worlds.step(action)
        observation, reward, terminated, _, _ = env.step(action[1])
        ours.append([*step.observations[1], step.rewards[1], step.terminated[1]])
        theirs.append([*observation, reward, terminated])
        if step.over.any():
            begin()
    np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-12)


def test_worlds_are_freed_at_once() -> None:
    worlds = TaskWorlds(cart(), 3)
    worlds.reset([0, 1, 2])
    worlds.step(random_actions(3, 2))
    freed = ref(worlds)
    gc.disable()  # it would run now and then, after many objects that take little memory
    try:
        del worlds
        assert freed() is None
    finally:
        gc.enable()
