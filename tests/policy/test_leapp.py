"""LEAPP packages: what flows between networks and from call to call, against the same sums in NumPy."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import FileError, UsageError
from mjrun.policy.leapp import LeappPolicy
from mjrun.policy.load import load_policy
from tests.policy.action_spaces import unbounded
from tests.policy.leapp_packages import GAIN, INITIAL, package

JOINTS = unbounded(["hip", "knee"])


def test_networks_run_in_order_and_feed_back(tmp_path: Path) -> None:
    policy = LeappPolicy(package(tmp_path / "walk"), "walk")
    observations = np.random.default_rng(0).normal(size=(4, 6)).astype(np.float32)  # the quaternion, the joints
    one, other = policy.episode(0, JOINTS), policy.episode(1, JOINTS)
    memory = INITIAL[0]
    for observation in observations:
        memory = observation[4:] @ GAIN + observation[:2] + memory
        assert np.allclose(one.act(observation.astype(float)), memory, atol=1e-6)
        assert np.allclose(other.act(observation.astype(float)), memory, atol=1e-6)
    first = policy.episode(0, JOINTS).act(np.zeros(6))
    assert first.tolist() == INITIAL[0].tolist()


def test_a_package_says_much_of_itself(tmp_path: Path) -> None:
    facts = load_policy(str(package(tmp_path / "walk").parent)).facts  # by its folder
    assert (facts.observation_size, facts.action_size, facts.control_dt) == (6, 2, Fraction(1, 50))
    assert facts.quaternion_order == "xyzw"
    assert (facts.action_joints, facts.stiffness, facts.damping) == (("hip", "knee"), (20, 30), (1, 1.5))
    assert (facts.action_target, facts.action_scale, facts.action_offset) == ("position", (1,), (0,))
    assert facts.observations is not None
    assert [(part.offset, part.scale) for part in facts.observations] == [(None, None), ((0,), (1,))]
    assert [(part.name, part.kind, part.elements) for part in facts.observations] == [
        ("quaternion", "state/body/rotation", ("qx", "qy", "qz", "qw")),
        ("joint_pos", "state/joint/position", ("hip", "knee")),
    ]


def test_an_observation_of_another_size_shows_both_sides(tmp_path: Path) -> None:
    actor = LeappPolicy(package(tmp_path / "walk"), "walk").episode(0, JOINTS)
    with pytest.raises(UsageError, match=r"walk observes 6 numbers, and the task gives 5: quaternion \(4\), joint_pos"):
        actor.act(np.zeros(5))


def test_gains_that_change_are_refused(tmp_path: Path) -> None:
    memory = "{name: memory_out, dtype: float32, shape: [1, 2], type: tensor"
    path = package(tmp_path, lambda text: text.replace(memory, f"{memory}, kind: kd").replace("kp, kd]", "memory_out]"))
    with pytest.raises(UsageError, match="its gains kd change with what is observed"):
        LeappPolicy(path, "walk")


def test_what_is_no_policy_of_numbers_is_refused(tmp_path: Path) -> None:
    gains = package(tmp_path / "gains", lambda text: text.replace("kind: target/joint/position", "kind: kp"))
    with pytest.raises(UsageError, match="it has no inputs or outputs"):
        LeappPolicy(gains, "walk")
    joint_pos = "{name: joint_pos, dtype: float32"
    integer = package(tmp_path / "integer", lambda text: text.replace(joint_pos, joint_pos.replace("float32", "int64")))
    with pytest.raises(UsageError, match="policy/joint_pos holds no floating-point numbers"):
        LeappPolicy(integer, "walk")


def test_a_network_with_other_tensors_than_described_is_refused(tmp_path: Path) -> None:
    described = (
        "    - {name: kd, dtype: float32, shape: [1, 2], type: tensor, kind: kd, element_names: [[hip, knee]]}\n"
    )
    path = package(tmp_path, lambda text: text.replace(described, "").replace("kp, kd]", "kp]"))
    with pytest.raises(
        FileError, match="tensors are target, memory_out, kp, kd, and the package describes target, mem"
    ):
        LeappPolicy(path, "walk")
