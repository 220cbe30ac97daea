"""A model whose numbers are not finite is refused before anything moves, and the number is named."""

import mujoco
import pytest

from mjrun.model.finiteness import fault

BODY = (
    '<worldbody><body name="arm"><joint name="hip" {}/><geom name="bob" size=".1" pos="0 0 1" {}/></body></worldbody>'
)


def model(option: str = "", joint: str = "", geom: str = "") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(f"<mujoco><option {option}/>{BODY.format(joint, geom)}</mujoco>")


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        ({"option": 'gravity="0 nan 0"'}, "its opt.gravity is nan"),
        ({"option": 'wind="inf 0 0"'}, "its opt.wind is inf"),
        ({"option": 'density="nan"'}, "its opt.density is nan"),
        ({"option": 'tolerance="nan"'}, "its opt.tolerance is nan"),
        ({"joint": 'damping="nan"'}, "its dof_damping is nan, of joint 'hip'"),
        ({"joint": 'armature="inf"'}, "its dof_armature is inf, of joint 'hip'"),
        ({"joint": 'range="0 nan"'}, "its jnt_range is nan, of joint 'hip'"),
        ({"joint": 'ref="nan"'}, "its qpos0 is nan"),
        ({"geom": 'mass="inf"'}, "its body_inertia is inf, of body 'arm'"),
        ({"geom": 'friction="nan"'}, "its geom_friction is nan, of geom 'bob'"),
    ],
)
def test_what_is_not_finite_is_named(parts: dict[str, str], says: str) -> None:
    assert fault(model(**parts)) == says


def test_bounds_may_be_infinite_and_keyframes_are_not_looked_at() -> None:
    assert fault(model(joint='range="-inf inf"', option='tolerance="inf"')) is None
    key = '<keyframe><key qpos="nan"/></keyframe>'
    assert fault(mujoco.MjModel.from_xml_string(f"<mujoco>{BODY.format('', '')}{key}</mujoco>")) is None
