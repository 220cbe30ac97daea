"""Every array of a compiled model is of one sort, and every id is known to refer to something."""

from decimal import Decimal

import mujoco
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mjrun.model.description import limited_ranges, without_trailing_zeros
from mjrun.model.fields import (
    COMPUTED,
    REFERENCES,
    STRETCHES,
    array,
    decimal_float,
    is_layout,
    model_fields,
    plain_values,
    referred_kinds,
    stretch,
)
from mjrun.model.names import KIND_OF_COUNT, enum_name, names, object_name, object_names
from tests.diff.models import spec

NAMES = [field.name for field in model_fields()]


def test_every_array_of_mujoco_is_compared_or_is_layout() -> None:
    model = spec().compile()
    arrays = [name for name in dir(model) if isinstance(getattr(model, name), np.ndarray) and name[0] != "_"]
    assert set(arrays) - set(NAMES) == {name for name in arrays if is_layout(name)}
    assert {*COMPUTED, *REFERENCES} <= set(NAMES)


def test_every_id_refers_to_something() -> None:
    others = {"body_mocapid", "geom_fluid", "skin_bonevertid", "flex_rigid", "flexedge_rigid"}
    assert {name for name in NAMES if name.endswith("id")} - others <= set(REFERENCES)


def test_rows_belong_to_objects_or_parts_of_these_unless_they_are_computed() -> None:
    parts = {"nq", "nv", "nu", "nout", "na", "ntree"}
    elsewhere = [
        f.name for f in model_fields() if f.rows not in {*KIND_OF_COUNT, *STRETCHES, *parts} and not f.computed
    ]
    assert elsewhere == []


def test_ids_are_those_of_the_type_that_another_field_says() -> None:
    model = spec().compile()
    joint, site = int(mujoco.mjtObj.mjOBJ_JOINT), int(mujoco.mjtObj.mjOBJ_SITE)
    assert np.asarray(referred_kinds(model, "sensor_objid")).tolist() == [site, joint, joint]
    assert np.asarray(referred_kinds(model, "actuator_trnid"))[:, 0].tolist() == [joint, joint]
    assert np.asarray(referred_kinds(model, "eq_obj1id")).tolist() == [joint]
    assert np.asarray(referred_kinds(model, "wrap_prm")).tolist() == [0, 0]  # coefficients
    assert referred_kinds(model, "geom_size") is None
    torso, ball = (mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) for name in ("torso", "ball"))
    assert sorted(array(model, "exclude_signature")[0].tolist()) == sorted([torso, ball])


def test_a_stretch_is_what_belongs_to_one_object() -> None:
    mesh = '<mesh name="{}" vertex="0 0 0  1 0 0  0 1 0  0 0 1 {}"/>'
    assets = mesh.format("a", "") + mesh.format("b", "2 2 2")
    geoms = '<geom type="mesh" mesh="a"/><geom type="mesh" mesh="b"/>'
    xml = f"<mujoco><asset>{assets}</asset><worldbody>{geoms}</worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(xml)
    for i in range(2):
        start, count = int(model.mesh_vertadr[i]), int(model.mesh_vertnum[i])
        assert stretch(model, "nmeshvert", i) == slice(start, start + count)
        assert stretch(model, "nmeshtexcoord", i) == slice(0, 0)


def test_a_flex_without_nodes_has_none_of_the_next_one() -> None:
    flex = '<flexcomp name="{}" type="grid" count="3 3 {}" spacing=".1 .1 .1" radius=".01" dim="{}" {}/>'
    flexes = flex.format("cloth", 1, 2, "") + flex.format("block", 3, 3, 'dof="trilinear"')
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{flexes}</worldbody></mujoco>")
    stretches = [stretch(model, "nflexnode", flex) for flex in range(2)]
    assert [each.stop - each.start for each in stretches] == model.flex_nodenum.tolist() == [0, 8]


MODEL = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><geom size="1"/><body name="b"><geom name="g" size="1"/>
</body></worldbody><keyframe><key/></keyframe></mujoco>""")


@pytest.mark.parametrize(
    ("enum", "value", "name"),
    [
        (mujoco.mjtJoint, mujoco.mjtJoint.mjJNT_HINGE, "hinge"),
        (mujoco.mjtGeom, 2, "sphere"),
        (mujoco.mjtGeom, 98765, "98765"),
    ],
)
def test_a_member_of_an_enum_is_named_as_in_mjcf(enum: type, value: int, name: str) -> None:
    assert enum_name(enum, value) == name


def test_an_object_has_its_name_or_its_kind_and_id() -> None:
    assert names(MODEL, "geom") == object_names(MODEL, "geom", range(2)) == ["geom:0", "g"]
    assert object_name(MODEL, mujoco.mjtObj.mjOBJ_GEOM, -1) is None
    assert object_name(MODEL, mujoco.mjtObj.mjOBJ_KEY, 0) == "keyframe:0"
    assert [object_name(MODEL, mujoco.mjtObj.mjOBJ_XBODY, i) for i in range(2)] == ["world", "b"]


def test_values_are_reported_in_words() -> None:
    assert plain_values(MODEL, "geom_bodyid") == ["world", "b"]
    assert plain_values(MODEL, "geom_type") == ["sphere", "sphere"]
    assert plain_values(MODEL, "geom_matid") == [None, None]
    assert plain_values(MODEL, "geom_rgba")[0] == (0.5, 0.5, 0.5, 1.0)
    assert plain_values(MODEL, "body_mocapid") == [False, False]


def test_an_orientation_is_that_of_a_ball_joint_or_of_a_site() -> None:
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><site name="ref"/><body name="b">
        <joint name="ball" type="ball"/><geom size="1"/><site name="s"/></body></worldbody>
        <actuator><orientation joint="ball"/><orientation site="s" refsite="ref"/></actuator></mujoco>""")
    assert plain_values(model, "actuator_trnid") == [("ball", None), ("s", "ref")]


def significant_digits(value: float) -> int:
    return len(Decimal(repr(value)).normalize().as_tuple().digits)


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
@example(999999995904.0)  # which is 1e12
def test_single_precision_gives_the_shortest_decimal_that_rounds_to_it(value: float) -> None:
    assert np.float32(decimal_float(np.float32(value))) == np.float32(value)
    assert significant_digits(decimal_float(np.float32(value))) <= significant_digits(value)


def test_a_tenth_is_a_tenth_in_either_precision() -> None:
    assert decimal_float(np.float32(0.1)) == decimal_float(np.float64(0.1)) == 0.1


@given(st.lists(st.sampled_from([0.0, 1.0, -2.0])))
def test_only_zeros_at_the_end_go(values: list[float]) -> None:
    short = without_trailing_zeros(values)
    assert [*short, *[0.0] * (len(values) - len(short))] == values
    assert not short or short[-1] != 0


def test_a_range_counts_where_it_is_limited() -> None:
    assert limited_ranges([True, False], [(-1, 2), (-1, 2)]) == [(-1, 2), None]
