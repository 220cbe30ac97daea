"""Equal stretches of two sequences."""

from hypothesis import given
from hypothesis import strategies as st

from mjrun.diff.sequence_alignment import equal_blocks

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
