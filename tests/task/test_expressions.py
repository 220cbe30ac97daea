"""Expressions of a task: what they read, the first termination that holds, and what the worlds are told."""

import mujoco
import numpy as np

from mjrun.probe.task_expression import TaskVocabulary, parse_task_value
from mjrun.task.expressions import RUNNING, ExpressionInputs, TaskExpressions
from mjrun.task.task import Action, Command, Observation, Reward, Task, Termination

MODEL = mujoco.MjModel.from_xml_string(
    """<mujoco><worldbody><body name="b"><joint name="j" type="slide"/><geom size=".1"/></body></worldbody>
    <actuator><motor name="m" joint="j"/></actuator></mujoco>"""
)
TASK = Task(
    MODEL,
    control_dt=0.25,
    duration=1,
    observations=[Observation(name="x", probe="qpos")],
    actions=[Action(actuators="*")],
    commands={"goal": Command(constant=[1, 2])},
    rewards={"a": "qpos/j - command/goal/1", "b": Reward(value="time * action/m", weight=2)},
    terminations={
        "far": Termination(when="qpos/j > 1", as_="failure"),
        "further": Termination(when="qpos/j > 0.5", as_="success"),
    },
)


def test_rewards_and_terminations_of_several_worlds() -> None:
    columns = TaskVocabulary(MODEL, ["action/m", "command/goal/0", "command/goal/1"], 0.25)
    seen = {"twice": parse_task_value("2 * rate(qvel/j)", columns, "value")}
    made = TaskExpressions(TASK, columns, seen, (["m"], ["goal/0", "goal/1"]), 3)
    assert made.measured == ["qpos/j", "qvel/j"]
    assert [(each.name, each.kind) for each in made.endings] == [
        *(("far", "failure"), ("further", "success"), ("timeout", "timeout"), ("unstable", "failure"))
    ]
    start = made.columns(np.zeros((3, 2)), ExpressionInputs(np.zeros(3, int), np.zeros((3, 1)), np.zeros((3, 2))))
    assert made.begin(start, None, 3).tolist() == [-1, -1, -1]
    zeros = ExpressionInputs(np.zeros(3, int), np.zeros((3, 1)), np.zeros((3, 2)))
    made.values(made.columns(np.zeros((3, 2)), zeros), None, first=True)

    inputs = ExpressionInputs(np.array([1, 3]), np.array([[5.0], [6.0]]), np.array([[1.0, 2.0]] * 2))
    measured = np.array([[2.0, 1.0], [0.75, 2.0]])
    now = made.columns(measured, inputs)
    ids = np.array([2, 0])
    terms, codes = made.advance(now, ids, 2)
    np.testing.assert_array_equal(terms, [[0, -1.25], [2 * 0.25 * 5, 2 * 0.75 * 6]])
    assert codes.tolist() == [0, 1]
    np.testing.assert_array_equal(made.values(now, ids, first=False)["twice"], [8, 16])
    now = made.columns(np.zeros((3, 2)), ExpressionInputs(np.zeros(3, int), np.zeros((3, 1)), np.zeros((3, 2))))
    assert made.advance(now, None, 3)[1].tolist() == [RUNNING] * 3
