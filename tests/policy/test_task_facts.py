"""What contradicts: each thing that a file says of itself, beside a task that says otherwise; both sides are shown."""

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
from mjrun.policy.load import ZeroPolicy
from mjrun.policy.loaders.leapp import LeappPolicy
from mjrun.policy.loaders.onnx import OnnxPolicy
from mjrun.policy.policy import ActionSpace, ObservationFacts, Policy, PolicyFacts
from mjrun.policy.task_facts import check_agreement, inferred_task
from mjrun.task.task import Action, Command, Observation, Task
from mjrun.task.worlds import TaskWorlds
from tests.policy.leapp_packages import package
from tests.policy.networks import linear

MODEL = """
<mujoco>
  <option timestep=".005"/>
  <worldbody>
    <body name="base" pos="0 0 1">
      <freejoint name="root"/><geom size=".1"/>
      <body><joint name="{0}hip" axis="0 1 0" armature=".1"/><geom size=".05" pos=".1 0 0"/>
        <body><joint name="{0}knee" axis="0 1 0" armature=".1"/><geom size=".05" pos=".2 0 0"/></body>
      </body>
    </body>
  </worldbody>
  <actuator>{1}</actuator>
  <keyframe><key name="home" qpos="0 0 1 1 0 0 0 .1 -.2"/></keyframe>
</mujoco>
"""
MOTORS = '<motor name="h" joint="{0}hip"/><motor name="k" joint="{0}knee"/>'
SERVOS = '<position name="h" joint="{0}hip" kp="20" kv="1"/><position name="k" joint="{0}knee" kp="30" kv="1.5"/>'
METADATA = {
    "joint_names": "hip,knee",
    "joint_stiffness": "20.000,30.000",
    "joint_damping": "1.000,1.500",
    "default_joint_pos": "0.100,-0.200",
    "observation_names": "joint_pos,joint_vel,actions",
    "observation_terms_scale": "1.000,0.050,1.000",
    "observation_terms_clip": "-inf;inf,-inf;inf,-inf;inf",
    "observation_terms_history_length": "0.000,0.000,0.000",
    "action_scale": "0.250,0.500",
}
DEFAULT = (0.1, -0.2)
JOINT_POS = Observation(name="joint_pos", joints=["hip", "knee"], offset=DEFAULT)
JOINT_VEL = Observation(name="joint_vel", joints=["hip", "knee"], of="qvel", scale=0.05)
LAST = Observation(name="actions", action="previous")
ACTION = Action(joints=["hip", "knee"], target="position", kp=[20, 30], kd=[1, 1.5], scale=[0.25, 0.5], offset=DEFAULT)
TERMS = (JOINT_POS, JOINT_VEL, LAST)
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


def model(prefix: str = "", actuators: str = MOTORS) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MODEL.format(prefix, actuators.format(prefix)))


def task(terms: tuple[Observation, ...] = TERMS, action: Action = ACTION, of: mujoco.MjModel | None = None) -> Task:
    return Task(of or model(), control_dt="0.02", duration=1, observations=terms, actions=[action])


@pytest.fixture
def policy(tmp_path: Path) -> OnnxPolicy:
    return OnnxPolicy(linear(tmp_path / "walk.onnx", np.ones((2, 6), np.float32), metadata=METADATA), "walk.onnx")


def contradictions(task: Task, policy: Policy) -> str:
    with pytest.raises(UsageError, match=r"^policy .* contradicts") as error:
        check_agreement(task, policy)
    assert error.value.path == ("policy",)
    return str(error.value).partition("\n")[2]


def changed(term: Observation | Action, **values: object) -> tuple[Observation, ...] | Action:
    """The task's term of this name with other values, among the other terms."""
    new = replace(term, **values)  # type: ignore[arg-type]
    return new if isinstance(new, Action) else tuple(new if each is term else each for each in TERMS)


def test_what_agrees_passes(policy: OnnxPolicy) -> None:
    check_agreement(task(), policy)
    servo = Action(actuators=["h", "k"], scale=[0.25, 0.5], offset="home")
    by_actuator = replace(servo, offset=DEFAULT)
    check_agreement(task(action=by_actuator, of=model(actuators=SERVOS)), policy)
    in_scene = [replace(term, joints=["robot/*"]) if term.joints else term for term in TERMS]
    robot = replace(ACTION, joints=["robot/hip", "robot/knee"])
    check_agreement(task(tuple(in_scene), robot, model("robot/")), policy)
    check_agreement(task(), ZeroPolicy())


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"terms": changed(JOINT_POS, joints=("knee", "hip"), offset=(-0.2, 0.1))},
         "order of joints in joint_pos: the policy has hip, knee; the task has knee, hip"),
        ({"terms": (JOINT_VEL, JOINT_POS, LAST)},
         "order of observations: the policy has joint_pos, joint_vel, actions; "
         "the task has joint_vel, joint_pos, actions"),
        ({"terms": changed(JOINT_VEL, scale=(1.0,))}, "scale of joint_vel: the policy has 0.05; the task has 1"),
        ({"terms": changed(JOINT_VEL, clip=((-1.0,), (1.0,)))},
         "lower clip of joint_vel: the policy has -inf; the task has -1\n"
         "  upper clip of joint_vel: the policy has inf; the task has 1"),
        ({"terms": changed(JOINT_POS, offset=(0.0,))},
         "default pose in joint_pos: the policy has hip 0.1, knee -0.2; the task has 0"),
        ({"terms": changed(LAST, history=2)},
         "history of actions: the policy has 1; the task has 2\n"
         "  observations: the policy has 6 numbers; the task has 8: joint_pos (2), joint_vel (2), actions (4)"),
        ({"terms": TERMS[:2]}, "observations: the policy has 6 numbers; the task has 4: joint_pos (2), joint_vel (2)"),
        ({"action": replace(ACTION, joints=("hip",), kp=(20.0,), kd=(1.0,), scale=(0.25,), offset=(0.1,))},
         "actions: the policy has 2 numbers; the task has 1: hip"),
        ({"action": replace(ACTION, joints=("knee", "hip"))},
         "order of actions: the policy has hip, knee; the task has knee, hip"),
        ({"action": replace(ACTION, scale=(0.25,))},
         "scale of actions: the policy has knee 0.5; the task has knee 0.25"),
        ({"action": replace(ACTION, offset=(0.1, 0.2))},
         "default pose in actions: the policy has knee -0.2; the task has knee 0.2"),
        ({"action": replace(ACTION, kp=(20.0, 31.0))}, "kp: the policy has knee 30; the task has knee 31"),
        ({"action": Action(joints=["hip", "knee"], target="control", scale=[0.25, 0.5], offset=DEFAULT)},
         "target of actions: the policy has position; the task has torque"),
        ({"terms": tuple(replace(each, name=f"my_{each.name}", scale=(1.0,)) for each in TERMS)},
         "scale of my_joint_vel: the policy has 0.05; the task has 1"),
    ],
)  # fmt: skip
def test_what_contradicts_shows_both_sides(policy: OnnxPolicy, change: Mapping[str, object], expected: str) -> None:
    message = contradictions(task(**change), policy)  # type: ignore[arg-type]
    assert f"  {expected}\n" in f"{message}\n"


def test_numbers_that_the_file_rounds_agree(policy: OnnxPolicy) -> None:
    third = replace(ACTION, scale=(0.2503, 0.4998))
    check_agreement(task(action=third), policy)


class Said(ZeroPolicy):
    """Says of itself what a test says."""

    def __init__(self, **facts: object) -> None:
        super().__init__()
        self.facts = PolicyFacts(**facts)  # type: ignore[arg-type]


def test_a_control_period_that_is_off_by_four() -> None:
    check_agreement(task(), Said(control_dt=Fraction(1, 50)))
    assert contradictions(task(), Said(control_dt=Fraction(1, 200))) == (
        "  control_dt: the policy has 0.005 s; the task has 0.02 s"
    )


def test_the_order_of_quaternions() -> None:
    root = Observation(name="state", probe="qpos")  # which holds one in the middle
    assert "quaternion in state" in contradictions(task((root,)), Said(quaternion_order="xyzw"))
    wxyz = Observation(name="attitude", probe="xquat/base")
    xyzw = Observation(name="attitude", probe=[f"xquat/base/q{axis}" for axis in "xyzw"])
    for terms, order in ((wxyz, "wxyz"), (xyzw, "xyzw")):
        check_agreement(task((terms,)), Said(quaternion_order=order))
    assert contradictions(task((wxyz,)), Said(quaternion_order="xyzw")) == (
        "  quaternion in attitude: the policy has xyzw; the task has wxyz"
    )


def test_parts_of_the_observation_are_named_by_the_task() -> None:
    parts = (ObservationFacts("state", 4), ObservationFacts("actions", 2))
    named = (replace(JOINT_POS, name="state/position"), replace(JOINT_VEL, name="state/velocity"), LAST)
    check_agreement(task(named), Said(observations=parts))
    assert contradictions(task(), Said(observations=parts)).startswith(
        "  parts of the observation: the policy has state (4), actions (2); "
        "the task has joint_pos (2), joint_vel (2), actions (2); name the observations of the task as the policy does"
    )


def test_elements_of_a_part_are_in_the_order_of_the_file() -> None:
    part = ObservationFacts("joint_pos", 2, elements=("knee", "hip"))
    assert contradictions(task((JOINT_POS,)), Said(observations=(part,))) == (
        "  order of joint_pos: the policy has knee, hip; the task has hip, knee"
    )
    check_agreement(task((JOINT_POS,)), Said(observations=(replace(part, elements=("a/hip", "a/knee")),)))


def test_more_terms_than_names_are_told_even_where_the_numbers_are_as_many(policy: OnnxPolicy) -> None:
    split = (replace(JOINT_VEL, joints=("hip",)), replace(JOINT_VEL, joints=("knee",), name="other"))
    assert "parts of the observation: the policy has joint_pos, joint_vel, actions; the task has joint_pos (2), " in (
        contradictions(task((JOINT_POS, *split, LAST)), policy)
    )
    named = [replace(term, name=f"joint_vel/{i}") for i, term in enumerate(split)]
    check_agreement(task((JOINT_POS, *named, LAST)), policy)
    scaled = [replace(named[0], scale=(1.0,)), named[1]]
    assert "scale of joint_vel/0: the policy has 0.05; the task has 1" in (
        contradictions(task((JOINT_POS, *scaled, LAST)), policy)
    )


def test_velocities_are_no_positions(policy: OnnxPolicy) -> None:
    """Five names beside five terms, of which two have changed places and names."""
    swapped = replace(JOINT_VEL, name="first"), replace(JOINT_POS, name="second"), LAST
    assert "quantity in first: the policy has qpos; the task has qvel" in contradictions(task(swapped), policy)


def test_commands_have_the_names_of_the_file(tmp_path: Path) -> None:
    def exported(names: str) -> OnnxPolicy:
        metadata = {**METADATA, "command_names": names}
        return OnnxPolicy(linear(tmp_path / "walk.onnx", np.ones((2, 6), np.float32), metadata=metadata), "walk.onnx")

    commanded = replace(task(), commands={"twist": Command(constant=[1.0])})
    check_agreement(commanded, exported("twist"))
    check_agreement(task(), exported("twist"))  # a task may say otherwise what a command would
    assert "commands: the policy has speed; the task has twist" in contradictions(commanded, exported("speed"))
    assert "commands: the policy has none; the task has twist" in contradictions(commanded, exported(""))


@pytest.mark.parametrize("prefix", ["", "robot/"])
def test_names_of_joints_agree_with_and_without_what_a_scene_puts_before_them(tmp_path: Path, prefix: str) -> None:
    metadata = {**METADATA, "joint_names": "robot/hip,robot/knee"}
    policy = OnnxPolicy(linear(tmp_path / "walk.onnx", np.ones((2, 6), np.float32), metadata=metadata), "walk.onnx")
    joints = [f"{prefix}hip", f"{prefix}knee"]
    terms = tuple(replace(term, joints=joints) if term.joints else term for term in TERMS)
    check_agreement(task(terms, replace(ACTION, joints=joints), model(prefix)), policy)
    backwards = replace(ACTION, joints=joints[::-1])
    assert "order of actions: the policy has hip, knee; the task has knee, hip" in (
        contradictions(task(terms, backwards, model(prefix)), policy)
    )
    moved = (replace(terms[0], joints=joints[::-1], offset=DEFAULT[::-1]), *terms[1:])
    assert "order of joints in joint_pos" in contradictions(
        task(moved, replace(ACTION, joints=joints), model(prefix)), policy
    )


# --- LEAPP: states and targets of joints are in SI units -------------------------------------------

POSITION = ObservationFacts("q", 2, "state/joint/position", ("hip", "knee"), offset=(0.0,), scale=(1.0,))
SPEED = ObservationFacts("v", 2, "state/joint/velocity", ("hip", "knee"), offset=(0.0,), scale=(1.0,))
Q = Observation(name="q", joints=["hip", "knee"])
V = Observation(name="v", joints=["hip", "knee"], of="qvel")
SI = {"action_scale": (1.0,), "action_offset": (0.0,), "action_size": 2, "action_joints": ("hip", "knee")}


@pytest.mark.parametrize(
    ("terms", "expected"),
    [
        ((replace(Q, scale=(57.3,)), V), "scale of q: the policy has 1; the task has 57.3"),
        ((replace(Q, offset=DEFAULT), V), "offset of q: the policy has 0; the task has hip 0.1, knee -0.2"),
        ((Q, replace(V, scale=(1.0, 0.05))), "scale of v: the policy has knee 1; the task has knee 0.05"),
        ((Observation(name="q", probe=["qpos/hip", "qpos/knee"], scale=-1), V),
         "scale of q: the policy has 1; the task has -1"),
        ((replace(Q, of="qvel"), V), "quantity in q: the policy has qpos; the task has qvel"),
        ((replace(Q, joints=("hip",), name="q/a", scale=(2.0,)), replace(Q, joints=("knee",), name="q/b"), V),
         "scale of q/a: the policy has 1; the task has 2"),
    ],
)  # fmt: skip
def test_states_of_joints_are_observed_in_their_units(terms: tuple[Observation, ...], expected: str) -> None:
    facts = Said(observations=(POSITION, SPEED))
    check_agreement(task((Q, V)), facts)
    assert contradictions(task(terms), facts) == f"  {expected}"


def test_targets_of_joints_are_in_their_units() -> None:
    plain = Action(joints=["hip", "knee"], target="position", kp=[20, 30], kd=[1, 1.5])
    targets = Said(action_target="position", **SI)
    check_agreement(task(action=plain), targets)
    assert contradictions(task(action=replace(plain, scale=(0.25,))), targets) == (
        "  scale of actions: the policy has 1; the task has 0.25"
    )
    assert contradictions(task(action=replace(plain, offset="home")), targets) == (
        "  offset of actions: the policy has 0; the task has hip 0.1, knee -0.2"
    )
    assert "squash of actions" in contradictions(task(action=replace(plain, squash="tanh")), targets)


def test_units_of_controls_are_those_of_their_actuators() -> None:
    """A motor with a gear turns half a unit of its control into a newton metre; a servo with a gear, an angle too."""
    geared = '<motor name="h" joint="{0}hip" gear="2"/><motor name="k" joint="{0}knee" gear="2"/>'
    torques = Said(action_target="torque", **SI)
    controls = Action(actuators=["h", "k"])
    check_agreement(task(action=replace(controls, scale=(0.5,)), of=model(actuators=geared)), torques)
    check_agreement(task(action=Action(joints=["hip", "knee"], target="torque"), of=model(actuators=geared)), torques)
    assert contradictions(task(action=controls, of=model(actuators=geared)), torques) == (
        "  scale of actions: the policy has 1; the task has 2"
    )
    servos = SERVOS.replace("kp=", 'gear="4" kp=')
    positions = Said(action_target="position", **SI)
    check_agreement(task(action=controls, of=model(actuators=SERVOS)), positions)
    check_agreement(task(action=replace(controls, scale=(4.0,)), of=model(actuators=servos)), positions)
    assert "scale of actions" in contradictions(task(action=controls, of=model(actuators=servos)), positions)


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
