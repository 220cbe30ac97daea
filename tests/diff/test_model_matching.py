"""Objects are matched by name, and unnamed ones by their place."""

import mujoco
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.diff.model_matching import ModelObjects, ModelRowMatching, ObjectMatching, equal_blocks
from tests.diff.models import CRATE, compared, spec


def model(*geoms: str) -> mujoco.MjModel:
    """A body with these geoms, each as its name and its size; those of `-` have none."""
    parts = []
    for geom in geoms:
        name, size = geom.split("/")
        written = "" if name == "-" else f"name='{name}'"
        parts.append(f"<geom {written} size='{size}'/>")
    return mujoco.MjModel.from_xml_string(f"<mujoco><worldbody><body>{''.join(parts)}</body></worldbody></mujoco>")


def pairs(a: mujoco.MjModel, b: mujoco.MjModel) -> list[tuple[int, int]]:
    match = ObjectMatching(ModelObjects(a), ModelObjects(b)).matches["geom"]
    return [*zip(match.a.tolist(), match.b.tolist(), strict=True)]


@pytest.mark.parametrize(
    ("a", "b", "matched"),
    [
        ("a/1 b/2", "b/1 a/2", [(0, 1), (1, 0)]),  # by name
        ("-/1 -/2", "-/3 -/1 -/2", [(0, 1), (1, 2)]),  # equal ones
        ("-/1 -/2 -/3", "-/1 -/3", [(0, 0), (2, 1)]),
        ("-/1 -/2 -/3", "-/1 -/5 -/3", [(0, 0), (1, 1), (2, 2)]),  # the rest in order
        ("-/1 -/2", "-/2 -/2", [(0, 0), (1, 1)]),
        ("a/1", "b/2", []),  # a named object that another one replaces
        ("a/1", "b/1", [(0, 0)]),
    ],
)
def test_objects_are_matched_by_name_then_equality_then_order(a: str, b: str, matched: list[tuple[int, int]]) -> None:
    assert pairs(model(*a.split()), model(*b.split())) == matched


def test_unnamed_tendons_of_other_lengths_are_matched_by_their_paths() -> None:
    def ropes(*lengths: float) -> mujoco.MjModel:
        sites = "".join(f'<site name="s{i}" pos="{i} 0 0"/>' for i in range(len(lengths) + 1))
        rope = '<spatial springlength="{}"><site site="s0"/><site site="s{}"/></spatial>'
        tendons = "".join(rope.format(length, i) for i, length in enumerate(lengths, 1))
        return mujoco.MjModel.from_xml_string(
            f'<mujoco><worldbody><geom size="1"/>{sites}</worldbody><tendon>{tendons}</tendon></mujoco>'
        )

    a, b = ropes(1, 2, 1, 1, 2, 2), ropes(2, 1, 1, 2, 2, 1)
    match = ObjectMatching(ModelObjects(a), ModelObjects(b)).matches["tendon"]
    assert (match.a.tolist(), match.b.tolist()) == ([*range(6)], [*range(6)])
    assert {each.field for each in compared(a, b).fields} == {"tendon_lengthspring"}


@settings(max_examples=30, deadline=None)
@given(sizes=st.lists(st.integers(1, 3), min_size=2, max_size=6), at=st.integers(0, 5))
def test_one_unnamed_object_more_is_one_difference(sizes: list[int], at: int) -> None:
    geoms = [f"-/{size}" for size in sizes]
    more = [*geoms[:at], "-/9", *geoms[at:]]
    a = mujoco.MjSpec.from_string(xml(geoms)).compile()
    b = mujoco.MjSpec.from_string(xml(more)).compile()
    result = compared(a, b)
    assert [each.kind for each in result.only_b] == ["geom"]
    assert not [each for each in result.fields if each.field.startswith("geom")]
    assert not result.only_a


def xml(geoms: list[str]) -> str:
    parts = "".join(f'<geom size="{geom.partition("/")[2]}"/>' for geom in geoms)
    inertia = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    return f'<mujoco><worldbody><body name="b">{inertia}{parts}</body></worldbody></mujoco>'


def rows_of(a: mujoco.MjModel, b: mujoco.MjModel) -> ModelRowMatching:
    return ModelRowMatching(ObjectMatching(ModelObjects(a), ModelObjects(b)))


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


ITEMS = st.lists(st.integers(0, 3), max_size=8)


@given(ITEMS, ITEMS)
def test_blocks_are_equal_in_order_and_end_with_both(a: list[int], b: list[int]) -> None:
    end_a = end_b = 0
    for block in equal_blocks(a, b):
        assert block.a >= end_a
        assert block.b >= end_b
        end_a, end_b = block.a + block.size, block.b + block.size
        assert a[block.a : end_a] == b[block.b : end_b]
    assert (end_a, end_b) == (len(a), len(b))


@given(ITEMS, st.integers(0, 8), st.integers(9, 10))
def test_one_changed_item_leaves_all_others(items: list[int], at: int, new: int) -> None:
    changed = [*items[:at], new, *items[at + 1 :]]
    expected = len(items) - (at < len(items))
    assert sum(block.size for block in equal_blocks(items, changed)) == expected


def test_an_item_that_becomes_its_neighbour_has_changed() -> None:
    assert [block for block in equal_blocks("hk", "kk") if block.size] == [(1, 1, 1)]
