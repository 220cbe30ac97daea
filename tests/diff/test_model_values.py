"""A change of any number in any field of a compiled model is told, and where it is."""

import mujoco
import numpy as np
import pytest

from mjrun.diff.model_differences import ArrayDifference, FieldDifference
from mjrun.model.fields import ModelField, model_fields
from tests.diff.models import compared, spec

RICH = """
<mujoco>
  <option><flag energy="enable"/></option>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" width="8" height="8" rgb1="1 0 0"/>
    <texture name="chequer" type="2d" builtin="checker" width="8" height="8" rgb1="1 0 0"/>
    <material name="paint" texture="chequer"/>
    <mesh name="wedge" vertex="0 0 0  1 0 0  0 1 0  0 0 1" texcoord="0 0 1 0 0 1 1 1" face="0 2 1 0 1 3 0 3 2 1 2 3"/>
    <hfield name="hill" nrow="3" ncol="4" size="1 1 1 1" elevation="0 1 2 3 4 5 6 7 8 9 10 11"/>
  </asset>
  <worldbody>
    <geom name="hill" type="hfield" hfield="hill" material="paint"/>
    <light name="sun"/> <camera name="eye"/>
    <body name="a" pos="0 0 2"><freejoint name="root"/><geom type="mesh" mesh="wedge"/><site name="s"/></body>
    <body name="b" pos="1 0 2"><joint name="hinge"/><geom name="peg" size=".1"/></body>
    <body name="m" mocap="true"><geom size=".1"/></body>
    <flexcomp name="cloth" type="grid" count="3 3 1" spacing=".1 .1 .1" dim="2" mass="1" radius=".01" pos="0 0 4">
      <edge equality="true"/>
    </flexcomp>
  </worldbody>
  <tendon><spatial name="rope"><site site="s"/><geom geom="peg"/><site site="s"/></spatial></tendon>
  <actuator><general name="servo" joint="hinge" dyntype="filter" dynprm="1" biastype="affine"/></actuator>
  <sensor><framepos name="where" objtype="site" objname="s"/></sensor>
  <custom>
    <numeric name="gains" data="7 8 9"/> <text name="note" data="hello"/>
    <tuple name="both"><element objtype="body" objname="a" prm="1"/></tuple>
  </custom>
  <keyframe><key name="start"/></keyframe>
</mujoco>
"""


@pytest.fixture(scope="module")
def rich() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(RICH)


@pytest.mark.parametrize("seed", range(4))
def test_any_number_of_any_field_that_changes_is_told(rich: mujoco.MjModel, seed: int) -> None:
    generator, other = np.random.default_rng(seed), mujoco.MjModel.from_xml_string(RICH)
    assert compared(rich, other).equal
    changed = set()
    for field in model_fields():
        values = getattr(other, field.name)
        if isinstance(values, np.ndarray) and values.size and changeable(field, values):
            place = tuple(generator.integers(size) for size in values.shape)
            values[place] = not values[place] if field.boolean else values[place] + 1
            changed.add(field.name)
    result = compared(rich, other)
    assert {each.field for each in (*result.fields, *result.arrays, *result.computed)} == changed
    assert len(changed) > 150
    assert sum(len(each.a) for each in result.fields) == len(result.fields)  # one number of each


def changeable(field: ModelField, values: np.ndarray) -> bool:
    """Whether a number of the field can be another and still mean something."""
    return field.boolean or (np.issubdtype(values.dtype, np.floating) and field.name != "wrap_prm")


def test_values_are_told_in_mujocos_words() -> None:
    a, b = spec().compile(), spec()
    b.geom("chest").friction = [0.5, 0.005, 0.1]
    b.joint("knee").type = mujoco.mjtJoint.mjJNT_SLIDE
    b.geom("chest").material = ""
    b.joint("hip").limited = 0
    result = {each.field: each for each in compared(a, b.compile()).fields}
    assert result["geom_friction"] == FieldDifference(
        "geom_friction", "chest", ("slide", "roll"), (1.0, 0.0001), (0.5, 0.1)
    )
    assert (result["jnt_type"].a, result["jnt_type"].b) == (("hinge",), ("slide",))
    assert (result["geom_matid"].a, result["geom_matid"].b) == (("steel",), ("none",))
    assert (result["jnt_limited"].a, result["jnt_limited"].b) == ((True,), (False,))


def test_texts_numbers_and_tuples_of_the_user(rich: mujoco.MjModel) -> None:
    text = RICH.replace("7 8 9", "7 5 9").replace("hello", "good bye").replace('objname="a" prm', 'objname="b" prm')
    result = compared(rich, mujoco.MjModel.from_xml_string(text))
    assert [(each.field, each.object, each.components, each.a, each.b) for each in result.fields] == [
        ("numeric_data", "gains", ("1",), (8.0,), (5.0,)),
        ("text_data", "note", (), ("hello",), ("good bye",)),
        ("tuple_objid", "both", (), ("a",), ("b",)),
    ]


def test_assets_are_told_by_their_hash_and_largest_difference(rich: mujoco.MjModel) -> None:
    other = mujoco.MjModel.from_xml_string(RICH.replace("9 10 11", "9 5 11"))
    (array,) = compared(rich, other).arrays
    assert isinstance(array, ArrayDifference)
    assert (array.field, array.object, array.shape_a, array.count) == ("hfield_data", "hill", (12, 1), 1)
    assert array.largest == pytest.approx(5 / 11)
    assert array.sha256_a != array.sha256_b

    wider = mujoco.MjModel.from_xml_string(RICH.replace('"checker" width="8"', '"checker" width="16"'))
    result = compared(rich, wider)
    (array,) = result.arrays
    assert (array.field, array.object, array.count, array.largest) == ("tex_data", "chequer", None, None)
    assert [(each.field, each.a, each.b) for each in result.fields] == [("tex_width", (8,), (16,))]


def test_an_asset_before_another_shifts_nothing(rich: mujoco.MjModel) -> None:
    first = '<mesh name="first" vertex="0 0 0  2 0 0  0 2 0  0 0 2"/><mesh name="wedge"'
    other = mujoco.MjModel.from_xml_string(RICH.replace('<mesh name="wedge"', first))
    result = compared(rich, other)
    assert not [*result.fields, *result.arrays]
    assert [(each.kind, each.name) for each in result.only_b] == [("mesh", "first")]


def test_numbers_within_the_tolerance_agree() -> None:
    a, b = spec().compile(), spec().compile()
    b.body_mass[1] *= 1 + 1e-6
    assert not compared(a, b, rtol=1e-7).equal
    assert compared(a, b, rtol=1e-5).equal
    assert compared(a, b, atol=1e-4).equal


def test_integers_and_ids_have_no_tolerance() -> None:
    a, b = spec().compile(), spec().compile()
    b.geom_condim[0] += 1
    b.sensor_objid[1] = b.sensor_objid[2]
    assert [each.field for each in compared(a, b, rtol=9, atol=9).fields] == ["geom_condim", "sensor_objid"]
