"""Rows of a dimension belong to the same part of the same object."""

import mujoco

from mjrun.diff.model_matching import ModelObjects, ObjectMatching
from mjrun.diff.model_rows import RowMatching
from tests.diff.models import CRATE, spec


def rows_of(a: mujoco.MjModel, b: mujoco.MjModel) -> RowMatching:
    return RowMatching(ObjectMatching(ModelObjects(a), ModelObjects(b)))


def test_degrees_of_freedom_follow_their_joints() -> None:
    a, b = spec().compile(), spec(CRATE).compile()
    matching = rows_of(a, b)
    positions, velocities = matching.rows("nq"), matching.rows("nv")
    assert positions is not None
    assert velocities is not None
    assert positions.labels[:3] == ["hip", "knee", "root/x"]
    assert (positions.b - positions.a).tolist() == [7] * a.nq
    assert (velocities.b - velocities.a).tolist() == [6] * a.nv
    assert velocities.labels[2:] == [f"root/{name}" for name in ("vx", "vy", "vz", "wx", "wy", "wz")]


def test_parts_of_another_number_have_no_rows_in_common() -> None:
    other = spec()
    other.joint("knee").type = mujoco.mjtJoint.mjJNT_BALL
    other.delete(other.keys[0])
    for each in (*other.equalities, *other.tendons, *other.sensors, *other.actuators):
        other.delete(each)
    rows = rows_of(spec().compile(), other.compile()).rows("nv")
    assert rows is not None
    assert rows.labels[:2] == ["hip", "root/vx"]


def test_what_belongs_to_no_object_has_no_rows() -> None:
    model = spec().compile()
    assert rows_of(model, model).rows("nmeshpoly") is None


def test_trees_are_those_of_their_first_bodies() -> None:
    rows = rows_of(spec().compile(), spec(CRATE).compile()).rows("ntree")
    assert rows is not None
    assert [*zip(rows.labels, rows.a.tolist(), rows.b.tolist(), strict=True)] == [("torso", 0, 1), ("ball", 1, 2)]
