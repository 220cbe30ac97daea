"""Theorems about masses and inertias."""

import pytest

from tests.check.models import Case, hinged, mjcf


def pair(size: str) -> str:
    """A sphere of 1 m that turns, and on it one of `size` that turns by itself."""
    small = f'<body name="q"><joint name="q"/>\n<geom size="{size}"/></body>'
    return f'<body name="r"><joint name="r"/><geom size="1"/>\n{small}</body>'


CASES = [
    Case(
        "MJ203",
        mjcf('<body name="b"><joint name="j"/><geom size=".1"/>\n<geom name="g" size=".1" mass="0"/></body>'),
        5,
        "it collides, but adds no mass to 'b'",
        mjcf(
            '<body><freejoint name="j"/><geom size=".1"/><geom size=".1" mass="0" contype="0" conaffinity="0"/></body>'
        ),
    ),
    Case(
        "MJ204",
        hinged(geom='type="capsule" size=".0001 1"'),
        4,
        "differ by a factor of",
        hinged(geom='type="capsule" size=".01 1"'),
    ),
    Case(
        "MJ205",
        mjcf(pair(".001")),
        5,
        "and joint 'r' of the same tree",
        mjcf(pair(".5")),
    ),
]


@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_rule_finds_what_it_is_for_at_its_line_and_nothing_in_a_correct_model(case: Case) -> None:
    case.check()
