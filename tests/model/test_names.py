"""Theorems about names of objects, of controls of actuators with several inputs, and of enum members."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.errors import BadValueError, UnknownNameError
from mjrun.formats.table_reader import read_table
from mjrun.model.names import (
    BALL,
    COUNTS,
    FREE,
    KINDS,
    PLURALS,
    QPOS_COMPONENTS,
    QVEL_COMPONENTS,
    control_names,
    control_slices,
    enum_members,
    enum_value,
    identify,
    is_enum,
    matching,
    names,
)
from mjrun.outputs.trace import Trace
from mjrun.probe.fields import field_probe
from mjrun.simulation.simulation import Simulation
from tests.cases import cases
from tests.check.models import lint_file

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


TEXT = """
<mujoco>
  <worldbody>
    <body name="a"><joint name="ball" type="ball" range="0 1"/><geom size=".1"/></body>
    <body name="b" pos="1 0 0"><joint name="hinge"/><geom size=".1"/></body>
  </worldbody>
  <actuator>
    <orientation name="turn" joint="ball"/><motor name="push" joint="hinge" ctrlrange="-3 3"/>
  </actuator>
  <keyframe><key name="far" ctrl="0 0 0 9"/></keyframe>
</mujoco>
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    found = tmp_path / "turn.xml"
    found.write_text(TEXT)
    return found


def test_every_control_has_the_name_of_the_actuator_at_its_address(path: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(path))
    assert model.nu > model.nactuator
    names = control_names(model)
    assert len(names) == model.nu
    for actuator, name in enumerate(("turn", "push")):
        (part,) = control_slices(model, name)
        address = model.actuator_ctrladr[actuator]
        assert (part.start, part.stop) == (address, address + model.actuator_ctrlnum[actuator])
        assert {found.partition("/")[0] for found in names[part]} == {name}
    assert control_slices(model, "turn/1") == [slice(1, 2)]
    with pytest.raises(UnknownNameError, match="no actuator 'turn/3'"):
        control_slices(model, "turn/3")


def test_controls_by_name_drive_what_they_name(path: Path, tmp_path: Path) -> None:
    simulation = Simulation(path, steps=5, ctrl={"push": 2.0, "turn/2": 0.5})
    data = simulation.start.data(simulation.load())
    assert list(data.ctrl) == [0, 0, 0.5, 2]
    Trace(simulation, f"{tmp_path}/a.csv", probe=["ctrl", "qpos", "actuator_force"]).run()
    table = read_table(tmp_path / "a.csv", lambda name: True)
    model = mujoco.MjModel.from_xml_path(str(path))
    bare = mujoco.MjData(model)
    bare.ctrl[model.actuator("push").id + 2] = 2
    bare.ctrl[2] = 0.5
    mujoco.mj_step(model, bare, nstep=5)
    assert table["qpos/hinge"][-1] == bare.qpos[-1]
    assert (table["ctrl/push"] == 2).all()
    mujoco.mj_forward(model, bare)
    assert table["actuator_force/push"][-1] == bare.actuator_force[model.actuator_outadr[1]]
    again = Simulation(path, steps=5, ctrl_from=tmp_path / "a.csv")
    Trace(again, f"{tmp_path}/b.csv", probe=["ctrl", "qpos", "actuator_force"]).run()
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_an_actuator_of_three_inputs_takes_three_numbers(path: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(path))
    assert list(Simulation(path, ctrl={"turn": (1, 2, 3)}).start.data(model).ctrl[:3]) == [1, 2, 3]
    with pytest.raises(BadValueError, match="3 numbers"):
        Simulation(path, ctrl={"turn": 1}).start.data(model)


def test_columns_of_outputs_belong_to_their_actuators(path: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(path))
    columns = field_probe(model, "actuator_force").columns
    owners = np.repeat(np.arange(model.nactuator), model.actuator_outnum)
    assert [column.id for column in columns] == owners.tolist()
    assert {column.kind for column in columns} == {"actuator"}


def test_a_keyframe_beyond_the_range_of_a_control_names_its_actuator(path: Path) -> None:
    found = lint_file(path)
    assert "MJ005" not in {one.code for one in found}
    (beyond,) = [one for one in found if one.code == "MJ403"]
    assert "actuator 'push'" in beyond.message
