"""Objects are matched by name, and unnamed ones by their place."""

import mujoco
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.diff.model_matching import ModelObjects, ObjectMatching
from tests.diff.models import compared


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


def test_names_come_first() -> None:
    assert pairs(model("a/1", "b/2"), model("b/1", "a/2")) == [(0, 1), (1, 0)]


def test_unnamed_objects_that_are_equal_come_next() -> None:
    assert pairs(model("-/1", "-/2"), model("-/3", "-/1", "-/2")) == [(0, 1), (1, 2)]
    assert pairs(model("-/1", "-/2", "-/3"), model("-/1", "-/3")) == [(0, 0), (2, 1)]


def test_the_rest_is_matched_in_order() -> None:
    assert pairs(model("-/1", "-/2", "-/3"), model("-/1", "-/5", "-/3")) == [(0, 0), (1, 1), (2, 2)]
    assert pairs(model("-/1", "-/2"), model("-/2", "-/2")) == [(0, 0), (1, 1)]


def test_a_named_object_that_is_replaced_by_another_is_not_the_same() -> None:
    assert pairs(model("a/1"), model("b/2")) == []
    assert pairs(model("a/1"), model("b/1")) == [(0, 0)]


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
