"""Metadata as mjlab writes them: read as its own writer made them, and refused where they are otherwise."""

from pathlib import Path

import pytest

from mjrun.errors import FileError
from mjrun.policy.loaders.onnx import is_mjlab, mjlab_facts
from mjrun.policy.policy import ObservationFacts

PATH = Path("walk.onnx")
INFINITE = (float("-inf"), float("inf"))
# As `list_to_csv_str` and `attach_metadata_to_onnx` of mjlab 1.6 write it.
METADATA = {
    "run_path": "local",
    "joint_names": "hip,knee,wheel",
    "joint_stiffness": "20.000,30.000",
    "joint_damping": "1.000,1.500",
    "default_joint_pos": "0.100,-0.200,0.000",
    "command_names": "twist",
    "observation_names": "joint_pos,joint_vel,actions,command",
    "observation_terms_scale": "1.000,0.050,1.000,2.000;2.000;0.250",
    "observation_terms_flatten_history_dim": "1.000,1.000,1.000,1.000",
    "observation_terms_history_length": "0.000,3.000,0.000,0.000",
    "observation_terms_clip": "-inf;inf,-100.000;100.000,-inf;inf,-inf;inf",
    "action_scale": "0.250,0.500",
}


def test_it_is_told_by_its_keys() -> None:
    assert is_mjlab(METADATA)
    assert not is_mjlab({"run_path": "local"})


def test_part_of_it_counts_in_brackets_too_and_says_nothing_else() -> None:
    assert is_mjlab({"joint_names": "hip"})
    facts = mjlab_facts({"joint_names": '["hip", "knee"]', "action_scale": "[0.5, 0.25]"}, PATH)
    assert (facts.joints, facts.action_scale) == (("hip", "knee"), (0.5, 0.25))
    assert (facts.action_target, facts.quaternion_order, facts.action_size) == (None, None, None)


def test_lists_are_facts() -> None:
    facts = mjlab_facts(METADATA, PATH)
    assert facts.joints == ("hip", "knee", "wheel")
    assert facts.action_joints is None  # of three joints two have actuators, and the file does not say which
    assert (facts.action_size, facts.action_scale) == (2, (0.25, 0.5))
    assert (facts.stiffness, facts.damping, facts.default_position) == ((20, 30), (1, 1.5), (0.1, -0.2, 0))
    assert (facts.quaternion_order, facts.control_dt, facts.action_target) == ("wxyz", None, "position")
    assert facts.observations == (
        ObservationFacts("joint_pos", scale=(1,), clip=INFINITE, history=1),
        ObservationFacts("joint_vel", scale=(0.05,), clip=(-5, 5), history=3),  # mjlab clips before it scales
        ObservationFacts("actions", scale=(1,), clip=INFINITE, history=1),
        ObservationFacts("command", scale=(2, 2, 0.25), clip=None, history=1),
    )


def test_clips_of_older_versions_and_one_scale_for_all_actions() -> None:
    older = {
        "observation_terms_history_length": "0,3,0,0",
        "observation_terms_clip": "[-inf, inf],[-100, 100],[-1.5, 2],[-inf, inf]",
        "action_scale": "0.5",
    }
    facts = mjlab_facts({**METADATA, **older, "observation_terms_scale": "1.0,-0.05,1.0,1.0"}, PATH)
    assert facts.action_scale == (0.5,)
    assert [part.history for part in facts.observations or ()] == [1, 3, 1, 1]
    assert [part.clip for part in facts.observations or ()] == [INFINITE, (-5, 5), (-1.5, 2), INFINITE]


def test_what_is_not_said_is_not_known() -> None:
    facts = mjlab_facts({key: METADATA[key] for key in ("joint_names", "observation_names", "action_scale")}, PATH)
    assert facts.default_position is facts.stiffness is facts.action_size is None
    assert facts.observations is not None
    assert facts.observations[1] == ObservationFacts("joint_vel")


@pytest.mark.parametrize(
    ("key", "text", "message"),
    [
        ("joint_stiffness", "20,x\x1b", r"the metadata joint_stiffness is '20,x\\x1b', not a list of numbers"),
        ("joint_damping", "1.0", "joint_damping has 1 number, and joint_stiffness 2"),
        ("default_joint_pos", "1.0", "default_joint_pos has 1 number, and joint_names 3"),
        ("observation_terms_scale", "1.0,1.0", "observation_terms_scale has 2 entries for 4 observations"),
        ("observation_terms_scale", "1.0,one,1.0,1.0", "observation_terms_scale is '1.0,one,1.0,1.0', which cannot"),
        ("observation_terms_clip", "1;2,1,1;2,1;2", "which cannot be read"),
        ("observation_terms_history_length", "0,0,0,1.5", "which cannot be read"),
        ("observation_terms_history_length", "0,0,0,inf", "which cannot be read"),
    ],
)
def test_what_is_otherwise_is_refused(key: str, text: str, message: str) -> None:
    with pytest.raises(FileError, match=rf"^walk.onnx: .*{message}"):
        mjlab_facts({**METADATA, key: text}, PATH)
