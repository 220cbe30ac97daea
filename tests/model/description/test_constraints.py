"""Theorems about described tendons, equalities, contact pairs and excludes: they are what the source says."""

from mjrun.model.info import ModelDescription


def test_a_tendon_passes_what_the_source_lists(mixed: ModelDescription) -> None:
    total, both, rope = mixed.tendons
    assert [tuple(vars(point).values()) for point in total.path] == [("joint", "hinge", 2)]
    assert [tuple(vars(point).values()) for point in both.path] == [("joint", "hinge", 1), ("joint", "slide", -0.5)]
    assert [(point.kind, point.name) for point in rope.path] == [
        ("site", "s"), ("sphere", "car"), ("site", "ref"), ("pulley", None), ("site", "s"), ("site", "ref"),
    ]  # fmt: skip
    assert rope.path[3].coefficient == 2
    assert [tendon.unit for tendon in mixed.tendons] == ["rad", "", "m"]
    assert [tendon.range for tendon in mixed.tendons] == [(0, 1), None, None]
    assert rope.stiffness == 5


def test_equalities_pairs_and_excludes_name_what_they_bind(mixed: ModelDescription) -> None:
    bound = [(e.type, e.object_kind, e.object1, e.object2, e.active) for e in mixed.equalities]
    assert bound == [
        ("connect", "body", "car", "world", True),
        ("weld", "site", "s", "ref", False),
        ("joint", "joint", "hinge", "slide", True),
        ("tendon", "tendon", "rope", None, True),
    ]
    assert mixed.equalities[0].data[:3] == (1, 2, 3)
    assert [(p.name, p.geom1, p.geom2, p.friction) for p in mixed.pairs] == [("pair:0", "tip", "car", (1, 2, 3, 4, 5))]
    assert [(e.name, e.body1, e.body2) for e in mixed.excludes] == [("exclude:0", "car", "goal")]
