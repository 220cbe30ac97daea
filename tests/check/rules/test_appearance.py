"""Scenes without light, and geoms with the same surface."""

import pytest

from mjrun.check.rules.appearance import SHOWN_GROUPS
from tests.check.models import lint, mjcf

BOX = '<geom name="{}" type="box" size="1 2 3" rgba="{} 0 0 1" {}/>'
DARK = '<visual><headlight ambient="0 0 0" diffuse="0 0 0"/></visual>'


def codes(world: str, before: str = "") -> list[str]:
    return [finding.code for finding in lint(mjcf(world, before=before)) if finding.code.startswith("MJ60")]


@pytest.mark.parametrize(
    ("light", "headlight", "found"),
    [
        ("", "", []),
        ("", DARK, ["MJ602"]),
        ("<light/>", DARK, []),
        ('<light active="false"/>', DARK, ["MJ602"]),
        ("", '<visual><headlight active="0"/></visual>', ["MJ602"]),
    ],
)
def test_a_light_or_the_headlight_shines(light: str, headlight: str, found: list[str]) -> None:
    assert codes(f'{light}<geom size="1"/>', headlight) == found


@pytest.mark.parametrize(
    ("other", "found"),
    [
        (BOX.format("b", 1, ""), ["MJ603"]),
        (BOX.format("b", 1, 'pos="1e-9 0 0"'), ["MJ603"]),
        (BOX.format("b", 1, 'pos="1e-3 0 0"'), []),
        (BOX.format("b", 1, f'group="{SHOWN_GROUPS}"'), []),
        (BOX.format("b", 0, ""), []),
        (BOX.format("b", 1, "").replace("1 2 3", "1 2 3.1"), []),
        (f"<body>{BOX.format('b', 1, '')}</body>", []),
    ],
)
def test_geoms_flicker_where_their_surfaces_are_the_same_and_their_colours_are_not(
    other: str, found: list[str]
) -> None:
    assert codes(BOX.format("a", 0, "") + other) == found
