"""Tasks out of files that say everything: played as a task document plays, bit for bit; and what files do not say."""

from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.document.task import read_task
from mjrun.errors import UnknownNameError, UsageError
from mjrun.model.sources import source_of
from mjrun.policy.loaders.leapp import LeappPolicy
from mjrun.policy.loaders.onnx import OnnxPolicy
from mjrun.policy.policy import ActionSpace, Policy
from mjrun.policy.task_facts import check_agreement, inferred_task
from mjrun.task.task import Task
from mjrun.task.worlds import TaskWorlds
from tests.policy.leapp_packages import package
from tests.policy.networks import linear
from tests.policy.test_task_agreement import METADATA, MODEL, MOTORS, SERVOS

DT = Fraction(1, 50)
WEIGHTS = np.random.default_rng(0).normal(size=(2, 6)).astype(np.float32)
DOCUMENT = """
model: robot.xml
control_dt: 0.02
duration: 1
reset: {qpos: {hip: 0.1, knee: -0.2}}
observations:
  - {name: joint_pos, joints: [hip, knee], offset: [0.1, -0.2]}
  - {name: joint_vel, joints: [hip, knee], of: qvel, scale: 0.05}
  - {name: actions, action: previous}
actions:
  - {joints: [hip, knee], target: position, kp: [20, 30], kd: [1, 1.5], scale: [0.25, 0.5], offset: [0.1, -0.2]}
"""


def played(task: Task, policy: Policy, periods: int = 50) -> np.ndarray:
    """The states of an episode: `(periods, nstate)`."""
    check_agreement(task, policy)
    worlds = TaskWorlds(task, 1, threads=1)
    actor = policy.episode(3, ActionSpace(worlds.action_names, worlds.actions.low, worlds.actions.high))
    observations, states = worlds.reset([3]), []
    for _ in range(periods):
        observations = worlds.step(actor(observations[0])[None]).observations
        states.append(worlds.state(0))
    return np.array(states)


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    path = tmp_path / "robot.xml"
    path.write_text(MODEL.format("", MOTORS.format("")))
    return path


def exported(folder: Path, **metadata: str) -> OnnxPolicy:
    """A policy with metadata of mjlab's."""
    return OnnxPolicy(linear(folder / "walk.onnx", WEIGHTS, bias=1, metadata={**METADATA, **metadata}), "walk.onnx")


def test_metadata_play_as_a_task_document_does_to_the_bit(tmp_path: Path, robot: Path) -> None:
    (tmp_path / "task.yaml").write_text(DOCUMENT)
    policy = exported(tmp_path)
    made = inferred_task(policy, source_of(robot), control_dt=DT, duration=Fraction(1))
    states = played(made, policy)
    assert np.ptp(states[:, 8:10], axis=0).min() > 0.01  # the joints, after the time and the free joint
    assert np.array_equal(states, played(read_task(tmp_path / "task.yaml"), policy))
    plain = OnnxPolicy(linear(tmp_path / "plain.onnx", WEIGHTS, bias=1), "plain.onnx")  # which says nothing of itself
    assert np.array_equal(states, played(read_task(tmp_path / "task.yaml"), plain))


@pytest.mark.parametrize(
    ("old", "new"),
    [("joints: [hip, knee], of: qvel", "joints: [knee, hip], of: qvel"), ("scale: 0.05", "scale: 0.5"),
     ("[0.25, 0.5]", "[0.5, 0.25]"), ("knee], offset: [0.1, -0.2]", "knee]"), ("kp: [20, 30]", "kp: [30, 20]")],
)  # fmt: skip
def test_what_is_lost_is_an_error_with_metadata_and_another_motion_without(
    tmp_path: Path, robot: Path, old: str, new: str
) -> None:
    (tmp_path / "right.yaml").write_text(DOCUMENT)
    (tmp_path / "wrong.yaml").write_text(DOCUMENT.replace(old, new, 1))
    right, wrong = (read_task(tmp_path / f"{name}.yaml") for name in ("right", "wrong"))
    with pytest.raises(UsageError, match=r"^policy walk.onnx contradicts"):
        check_agreement(wrong, exported(tmp_path))
    plain = OnnxPolicy(linear(tmp_path / "plain.onnx", WEIGHTS, bias=1), "plain.onnx")
    assert np.abs(played(right, plain) - played(wrong, plain)).max() > 1e-3


def test_servos_of_the_model_are_used_as_they_are(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_string(MODEL.format("robot/", SERVOS.format("robot/")))
    policy = exported(tmp_path)
    task = inferred_task(policy, source_of(model), control_dt=DT)
    (action,) = task.actions
    assert (action.target, action.joints, action.kp) == ("control", ("robot/hip", "robot/knee"), None)
    check_agreement(task, policy)
    weak = mujoco.MjModel.from_xml_string(MODEL.format("", SERVOS.format("").replace('kp="30"', 'kp="3"')))
    with pytest.raises(UsageError, match=r"kp: the policy has knee 30; the task has knee 3"):
        check_agreement(inferred_task(policy, source_of(weak), control_dt=DT), policy)


def test_what_a_file_does_not_say_is_asked_for_and_not_guessed(tmp_path: Path, robot: Path) -> None:
    policy = exported(tmp_path, observation_names="base_lin_vel,joint_vel,actions", action_scale="0.25")
    with pytest.raises(
        UsageError, match=r"^policy walk.onnx does not specify its control period, the sources of these obs"
    ) as error:
        inferred_task(policy, source_of(robot))
    lines = str(error.value).splitlines()
    assert lines[0].endswith("the sources of these observations: base_lin_vel")
    assert "  control_dt: # unknown" in lines
    assert '    - {name: "base_lin_vel"}  # from where?' in lines
    assert '    - {name: "joint_vel", joints: ["hip", "knee"], of: "qvel", scale: 0.05}' in lines
    assert '    - {name: "actions", action: "previous"}' in lines
    silent = OnnxPolicy(linear(tmp_path / "silent.onnx", WEIGHTS), "silent.onnx")
    with pytest.raises(
        UsageError, match="does not specify its control period, its observations, the targets of its actions"
    ):
        inferred_task(silent, source_of(robot))


def test_the_lines_of_the_draft_are_a_task_document(tmp_path: Path, robot: Path) -> None:
    policy = exported(tmp_path)
    with pytest.raises(UsageError) as error:
        inferred_task(policy, source_of(robot))
    assert str(error.value).splitlines()[:2] == [
        "policy walk.onnx does not specify its control period",
        f"set control_dt, or write a task document, and play the policy on it instead of on {robot}:",
    ]
    text = "\n".join(line[2:] for line in str(error.value).splitlines()[2:])
    path = tmp_path / "draft.yaml"
    path.write_text(text.replace("control_dt: # unknown", "control_dt: 0.02"))
    made = inferred_task(policy, source_of(robot), control_dt=DT)
    assert np.array_equal(played(read_task(path), policy), played(made, policy))


def test_a_joint_that_the_model_lacks_is_named(tmp_path: Path, robot: Path) -> None:
    policy = exported(tmp_path, joint_names="hip,ankle")
    with pytest.raises(UnknownNameError, match=r"no joint 'ankle' in the model"):
        inferred_task(policy, source_of(robot), control_dt=DT)


def test_a_leapp_package_is_a_task_where_it_names_bodies(tmp_path: Path, robot: Path) -> None:
    named = "[[base], [qx, qy, qz, qw]]"
    path = package(tmp_path / "walk", lambda text: text.replace("[[qx, qy, qz, qw]]", named))
    policy = LeappPolicy(path, "walk")
    task = inferred_task(policy, source_of(robot))
    assert (task.control_dt, [term.name for term in task.observations]) == (DT, ["quaternion", "joint_pos"])
    assert played(task, policy, 5).shape[0] == 5
    wxyz = replace(task.observations[0], probe=("xquat/base",))
    values: Mapping[str, object] = {"control_dt": task.control_dt, "duration": 1, "actions": task.actions}
    turned = Task(task.model, observations=[wxyz, *task.observations[1:]], **values)  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="order of quaternion: the policy has qx, qy, qz, qw; the task has qw, qx"):
        check_agreement(turned, policy)
    unnamed = LeappPolicy(package(tmp_path / "unnamed"), "unnamed")
    with pytest.raises(UsageError, match="does not specify the sources of these observations: quaternion"):
        inferred_task(unnamed, source_of(robot))


def test_a_joint_that_may_be_either_of_two_is_asked_for(tmp_path: Path) -> None:
    body = '<body><joint name="{0}/{1}" armature=".1"/><geom size=".1"/></body>'
    bodies = "".join(body.format(side, name) for side in ("left", "right") for name in ("hip", "knee"))
    path = tmp_path / "two.xml"
    path.write_text(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    with pytest.raises(UsageError, match="joint 'hip' of the policy may be 'left/hip' or 'right/hip' of the model"):
        inferred_task(exported(tmp_path), source_of(path), control_dt=DT)
