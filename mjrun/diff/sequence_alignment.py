"""Which stretches of two sequences are equal."""

from collections.abc import Hashable, Sequence
from difflib import SequenceMatcher
from itertools import takewhile
from typing import NamedTuple


class EqualBlock(NamedTuple):
    """`size` items from `a` on in one sequence that equal those from `b` on in the other."""

    a: int
    b: int
    size: int


def equal_blocks(a: Sequence[Hashable], b: Sequence[Hashable]) -> list[EqualBlock]:
    """The equal stretches of two sequences, in order; the last is empty, at the end of both.

    What both begin and end with is equal; a longest common stretch is looked for in between, so that one item that
    has changed to what comes next is a change, not one removed and one added.
    """
    start = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(a, b, strict=False)))
    rest = min(len(a), len(b)) - start
    tails = zip(reversed(a), reversed(b), strict=False)
    end = min(rest, sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], tails)))

    inner_a, inner_b = a[start : len(a) - end], b[start : len(b) - end]
    between = SequenceMatcher(None, inner_a, inner_b, autojunk=False).get_matching_blocks()[:-1]
    blocks = [EqualBlock(0, 0, start), *(EqualBlock(start + i, start + j, size) for i, j, size in between)]
    return [*blocks, EqualBlock(len(a) - end, len(b) - end, end), EqualBlock(len(a), len(b), 0)]
