"""A single world gives what worlds side by side give, to the last bit, whatever a task is made of."""

import copy
import pickle
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from mjrun.errors import ModelError, UsageError
from mjrun.model import state
from mjrun.task.single_world import SingleWorld
from mjrun.task.task import Action, Observation, Task
from mjrun.task.worlds import TaskWorlds
from tests.task import gymnasium_tasks
from tests.task.test_worlds import CART, DISTURBED, EVERYTHING, cart, replace_model

FORCED = {
    "actions": [Action(joints="hinge", target="torque", scale=3), Action(joints="slide", target="velocity", kd=2)],
    "observations": [
        Observation(name="x", probe="qpos/slide", noise="uniform(-1, 1)"),
        Observation(name="force", probe="qfrc_actuator/hinge", history=2),
        Observation(name="left", value="time^2"),
    ],
    "rewards": {"r": "time - rate(action/hinge) / qpos/slide", "nothing": "1/0 - log(-qpos/slide)"},
}


def assert_same(task: Task, scale: float = 1.0) -> None:
    """Plays two episodes in both."""
    single, worlds = SingleWorld(task), TaskWorlds(task, 1)
    generator = np.random.default_rng(2)
    for seed in (3, 4):
        np.testing.assert_array_equal(single.start(seed), worlds.reset([seed])[0])
        assert single.ended_at_start == worlds.ended_at_start
        for _ in range(20):
            action = scale * generator.uniform(-1, 1, len(worlds.action_names))
            ours, theirs = single.act(action.astype(np.float32)), worlds.step(action.astype(np.float32)[None])
            np.testing.assert_array_equal(ours.observations, theirs.observations[0])
            np.testing.assert_array_equal(
                [ours.rewards, *ours.reward_terms], [theirs.rewards[0], *theirs.reward_terms[0]]
            )
            assert ours.codes == theirs.codes[0]
            np.testing.assert_array_equal(single.state(0), worlds.state(0))
            if theirs.over[0]:
                break


@pytest.mark.parametrize("derived", ["current", "lagged"])
@pytest.mark.parametrize("values", [{}, DISTURBED, FORCED], ids=["plain", "disturbed", "forced"])
def test_it_is_one_of_many(tmp_path: Path, values: Mapping[str, object], derived: str) -> None:
    (tmp_path / "cart.xml").write_text(CART)
    assert_same(replace_model(cart(**values, derived=derived), tmp_path / "cart.xml"))


@pytest.mark.parametrize("derived", ["current", "lagged"])
@pytest.mark.parametrize("values", [{}, EVERYTHING, FORCED], ids=["plain", "everything", "forced"])
def test_a_control_period_can_be_stepped_in_parts(values: Mapping[str, object], derived: str, tmp_path: Path) -> None:
    (tmp_path / "cart.xml").write_text(CART)
    task = replace_model(cart(**values, derived=derived), tmp_path / "cart.xml")
    whole, parts = SingleWorld(task), SingleWorld(task)
    np.testing.assert_array_equal(whole.start(1), parts.start(1))
    model = parts.model(0)
    data = mujoco.MjData(model)
    for k in range(5):
        action = np.sin(k + np.arange(len(whole.action_names)))
        step = whole.act(action)
        parts.apply(action)
        for _ in range(whole.control_steps):
            state.restore(model, data, parts.state(0))
            parts.hold(data.qpos, data.qvel)
            parts.advance(1)
        state.restore(model, data, parts.state(0))
        mujoco.mj_forward(model, data)
        other = parts.conclude() if derived == "lagged" else parts.conclude_in(model, data)
        np.testing.assert_array_equal(step.observations, other.observations)
        np.testing.assert_array_equal([step.rewards, *step.reward_terms], [other.rewards, *other.reward_terms])
        np.testing.assert_array_equal(whole.state(0), parts.state(0))


@pytest.mark.parametrize("make", [gymnasium_tasks.hopper, gymnasium_tasks.ant])
def test_it_is_one_of_many_for_gymnasiums_tasks(make: Callable[[], Task]) -> None:
    with warnings.catch_warnings(action="ignore"):
        assert_same(make())


def test_an_unstable_world_ends_as_among_others() -> None:
    task = cart(actions=[Action(actuators="push", scale=1e9)])
    assert_same(task)
    single = SingleWorld(task)
    before = single.start(0)
    step = single.act(np.ones(1))
    assert step.endings[step.codes].name == "unstable"
    assert step.rewards == 0
    np.testing.assert_array_equal(step.observations, before)


def test_actions_that_cannot_be_are_refused() -> None:
    single = SingleWorld(cart())
    with pytest.raises(ValueError, match="reset it"):
        single.act(np.zeros(2))
    single.start(1)
    with pytest.raises(ValueError, match=r"shape \(2,\), not a tuple \(list, NoneType\)"):
        single.act(([0, 0], None))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"shape \(2,\), not \(3,\)"):
        single.act(np.zeros(3))
    with pytest.raises(ValueError, match=r"push is nan$"):
        single.act(np.array([0, np.nan]))
    single.act(np.array([1e200, 0]))  # whose square is not finite


def pickled(thing: Any) -> Any:
    return pickle.loads(pickle.dumps(thing))


@pytest.mark.parametrize(
    ("values", "derived", "copied"),
    [({}, "current", copy.deepcopy), (DISTURBED, "lagged", copy.copy), (FORCED, "current", pickled)],
)
def test_copies_go_on_with_the_same_bits(
    tmp_path: Path, values: Mapping[str, object], derived: str, copied: Callable[[Any], Any]
) -> None:
    (tmp_path / "cart.xml").write_text(CART)
    task = replace_model(cart(**values, derived=derived), tmp_path / "cart.xml")
    single, several = SingleWorld(task), TaskWorlds(task, 3)
    actions = np.random.default_rng(4).normal(size=(18, 3, len(single.action_names)))  # noise is drawn 16 at a time
    for steps in (0, 1, 5):
        single.start(7)
        several.reset([7, 8], [0, 2])
        for action in actions[:steps]:
            single.act(action[0])
            several.step(action[[2, 0]], [2, 0])
        single_copy, several_copy = copied(single), copied(several)
        np.testing.assert_array_equal(single_copy.model(0).geom_friction, single.model(0).geom_friction)
        for action in actions[steps:]:
            np.testing.assert_equal(single_copy.act(action[0])[:4], single.act(action[0])[:4])
            expected = several.step(action[[0, 2]], [0, 2])
            np.testing.assert_equal(several_copy.step(action[[0, 2]], [0, 2])[:4], expected[:4])
        np.testing.assert_array_equal(single_copy.state(0), single.state(0))
        np.testing.assert_array_equal(single_copy.start(9), single.start(9))


def test_a_copy_of_another_model_is_refused(tmp_path: Path) -> None:
    (tmp_path / "cart.xml").write_text(CART)
    single = SingleWorld(replace_model(cart(), tmp_path / "cart.xml"))
    before, text = single.start(1), pickle.dumps(single)
    (tmp_path / "cart.xml").write_text(CART.replace('gear="2"', 'gear="3"'))
    np.testing.assert_array_equal(single.start(1), before)  # which has read its model once
    with pytest.raises(ModelError, match=r"cart.xml is not the model of the copied environment"):
        pickle.loads(text)


def test_copies_with_bodies_that_sleep_are_refused_within_an_episode(tmp_path: Path) -> None:
    asleep = CART.replace('<option timestep="0.01"/>', '<option timestep="0.01"><flag sleep="enable"/></option>')
    (tmp_path / "cart.xml").write_text(asleep)
    single = SingleWorld(replace_model(cart(), tmp_path / "cart.xml"))
    copy.deepcopy(single).start(1)
    single.start(1)
    with pytest.raises(UsageError, match="cannot be copied within an episode"):
        copy.deepcopy(single)
