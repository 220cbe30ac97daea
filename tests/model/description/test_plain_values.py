"""Theorems about plain values: names and numbers of a model as MuJoCo and MJCF write them."""

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.model.description.plain_values import (
    GEOM,
    body_name,
    decimal_float,
    enum_name,
    limited_range,
    object_name,
    object_names,
    without_trailing_zeros,
)

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
    assert object_names(MODEL, GEOM, 0, 2) == ("geom:0", "g")
    assert object_name(MODEL, GEOM, -1) is None
    assert object_name(MODEL, mujoco.mjtObj.mjOBJ_KEY, 0) == "keyframe:0"
    assert [body_name(MODEL, i) for i in range(2)] == ["world", "b"]


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_single_precision_gives_the_shortest_decimal_that_rounds_to_it(value: float) -> None:
    assert np.float32(decimal_float(np.float32(value))) == np.float32(value)
    assert len(repr(decimal_float(np.float32(value)))) <= len(repr(value))


def test_a_tenth_is_a_tenth_in_either_precision() -> None:
    assert decimal_float(np.float32(0.1)) == decimal_float(np.float64(0.1)) == 0.1


@given(st.lists(st.sampled_from([0.0, 1.0, -2.0])))
def test_only_zeros_at_the_end_go(values: list[float]) -> None:
    short = without_trailing_zeros(values)
    assert [*short, *[0.0] * (len(values) - len(short))] == values
    assert not short or short[-1] != 0


def test_a_range_counts_where_it_is_limited() -> None:
    assert limited_range(True, np.array([-1, 2])) == (-1, 2)
    assert limited_range(False, np.array([-1, 2])) is None
