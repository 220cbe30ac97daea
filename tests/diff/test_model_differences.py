"""The size of a difference."""

from mjrun.diff.model_differences import FieldDifference


def test_the_largest_difference_is_that_of_numbers() -> None:
    assert FieldDifference("body_pos", "b", (), (1.0, 2.0), (1.5, 0.0)).largest == 2
    assert FieldDifference("geom_matid", "g", (), ("steel",), ("none",)).largest is None
    assert FieldDifference("jnt_limited", "j", (), (True,), (False,)).largest is None
