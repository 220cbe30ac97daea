"""Theorems about names: every object answers to one, and enum members to MuJoCo's own spelling."""

import mujoco
import numpy as np
import pytest

from mjrun.errors import UnknownNameError
from mjrun.model.names import (
    BALL,
    COUNTS,
    FREE,
    KINDS,
    PLURALS,
    QPOS_COMPONENTS,
    QVEL_COMPONENTS,
    enum_members,
    enum_value,
    identify,
    is_enum,
    matching,
    names,
)
from tests.cases import cases

MODEL = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><camera/><camera name="top"/>
<body name="arm"><joint name="knee"/><joint name="1" axis="1 0 0"/><joint axis="0 1 0"/><geom size="1"/><site/></body>
<body name="a[0]"><joint name="knee_2"/><geom name="Ball" size="1"/></body></worldbody>
<actuator><motor joint="knee"/></actuator><keyframe><key/><key name="home"/></keyframe></mujoco>""")


@cases("kind, expected")
def test_every_object_has_a_name_and_answers_to_it(kind: str, expected: list[str]) -> None:
    assert names(MODEL, kind) == expected
    assert [identify(MODEL, kind, name) for name in expected] == list(range(len(expected)))


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_countable_and_an_empty_model_says_that_there_are_none(kind: str) -> None:
    empty = mujoco.MjModel.from_xml_string("<mujoco/>")
    assert COUNTS.keys() == KINDS.keys()
    if kind == "body":
        assert names(empty, kind) == ["world"]
    else:
        assert names(empty, kind) == []
        with pytest.raises(UnknownNameError, match=f"there are no {PLURALS.get(kind, kind + 's')}"):
            identify(empty, kind, "0")


@pytest.mark.parametrize(
    ("name", "found"),
    [("0", 0), ("2", 2), ("3", 3), ("joint:0", 0), ("joint:1", 1), ("joint:2", 2), ("joint:3", 3), ("02", 2)],
)
def test_an_object_also_answers_to_its_index_named_or_not(name: str, found: int) -> None:
    assert identify(MODEL, "joint", name) == found


def test_a_name_that_looks_like_an_index_is_a_name_first() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><camera name="1"/><camera name="0"/></worldbody></mujoco>'
    )
    assert [identify(model, "camera", name) for name in ("0", "1")] == [1, 0]


@pytest.mark.parametrize("name", ["", "Knee", "-1", "4", "joint:4", "joint:", "geom:0", "²", "٣", "1.0", "knee*"])
def test_what_names_no_object_is_refused_with_all_that_do(name: str) -> None:
    with pytest.raises(UnknownNameError) as caught:
        identify(MODEL, "joint", name)
    assert caught.value.exit_code == 2
    assert caught.value.valid == ("knee", "1", "joint:2", "knee_2")
    assert str(caught.value).endswith("\njoints: knee, 1, joint:2, knee_2")


def test_the_plural_of_body_is_bodies() -> None:
    with pytest.raises(UnknownNameError, match="bodies: world, arm"):
        identify(MODEL, "body", "leg")


@cases("kind, pattern, found")
def test_a_pattern_means_all_it_matches_in_order_but_an_exact_name_means_itself(
    kind: str, pattern: str, found: list[int] | None
) -> None:
    if found is not None:
        assert matching(MODEL, kind, pattern) == found
    else:
        with pytest.raises(UnknownNameError, match=f"no {kind} "):
            matching(MODEL, kind, pattern)


def test_a_name_with_wild_characters_means_itself_and_not_what_it_would_match() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><camera name="a1"/><camera name="a*"/><camera name="a?"/></worldbody></mujoco>'
    )
    assert [matching(model, "camera", name) for name in ("a1", "a*", "a?", "a[1*]")] == [[0], [1], [2], [0, 1]]


@pytest.mark.parametrize(
    "enum",
    [
        mujoco.mjtCone,
        mujoco.mjtDisableBit,
        mujoco.mjtEnableBit,
        mujoco.mjtIntegrator,
        mujoco.mjtSolver,
        mujoco.mjtVisFlag,
        mujoco.mjtRndFlag,
        mujoco.mjtLabel,
        mujoco.mjtFrame,
        mujoco.mjtGeom,
        mujoco.mjtTexture,
    ],
)
def test_every_member_of_an_enum_answers_to_its_short_and_to_its_full_name(enum: type) -> None:
    wanted = {name: int(value) for name, value in enum.__members__.items() if not name.startswith("mjN")}
    assert wanted
    assert list(enum_members(enum).values()) == list(wanted.values())
    for name, value in wanted.items():
        short = name.split("_", 1)[1]
        assert [enum_value(enum, "x", n) for n in (name, short, short.lower(), short.upper())] == [value] * 4


def test_counters_are_no_members() -> None:
    assert "mjNVISFLAG" in mujoco.mjtVisFlag.__members__
    assert len(enum_members(mujoco.mjtVisFlag)) == int(mujoco.mjtVisFlag.mjNVISFLAG)


@pytest.mark.parametrize("name", ["", "contactpoin", "mjNVISFLAG", "mjVIS_", "vis_joint", "0"])
def test_what_is_no_member_is_refused_with_those_that_are(name: str) -> None:
    with pytest.raises(UnknownNameError) as caught:
        enum_value(mujoco.mjtVisFlag, "flag", name)
    assert caught.value.valid == tuple(enum_members(mujoco.mjtVisFlag))


def test_an_enum_member_is_reported_from_a_number() -> None:
    assert is_enum(mujoco.mjtCone.mjCONE_ELLIPTIC)
    assert not is_enum(1)
    assert not is_enum("elliptic")


JOINT_COMPONENTS_MODEL = mujoco.MjModel.from_xml_string("""<mujoco><option gravity="0 0 0"/><worldbody>
<body><freejoint/><geom size="1"/></body><body pos="9 0 0"><joint type="ball"/><geom size="1"/></body>
</worldbody></mujoco>""")


@pytest.mark.parametrize("joint", [0, 1])
def test_there_is_a_name_for_each_number(joint: int) -> None:
    kind = int(JOINT_COMPONENTS_MODEL.jnt_type[joint])
    qpos = np.diff([*JOINT_COMPONENTS_MODEL.jnt_qposadr, JOINT_COMPONENTS_MODEL.nq])[joint]
    qvel = np.diff([*JOINT_COMPONENTS_MODEL.jnt_dofadr, JOINT_COMPONENTS_MODEL.nv])[joint]
    assert (len(QPOS_COMPONENTS[kind]), len(QVEL_COMPONENTS[kind])) == (qpos, qvel)


def test_a_component_is_what_its_name_says() -> None:
    data = mujoco.MjData(JOINT_COMPONENTS_MODEL)
    data.qvel[QVEL_COMPONENTS[FREE].index("vy")] = 2
    data.qvel[6 + QVEL_COMPONENTS[BALL].index("wz")] = 3
    mujoco.mj_step(JOINT_COMPONENTS_MODEL, data)
    dt = JOINT_COMPONENTS_MODEL.opt.timestep
    moved = dict(zip(QPOS_COMPONENTS[FREE], data.qpos[:7], strict=True))
    turned = dict(zip(QPOS_COMPONENTS[BALL], data.qpos[7:], strict=True))
    assert moved == pytest.approx({"x": 0, "y": 2 * dt, "z": 0, "qw": 1, "qx": 0, "qy": 0, "qz": 0})
    assert turned == pytest.approx({"qw": np.cos(1.5 * dt), "qx": 0, "qy": 0, "qz": np.sin(1.5 * dt)})
