"""Hinges that turn a link through its parent: a bar on an arm, whose angles inside follow from their sizes."""

import numpy as np
import pytest

from mjrun.check.rules import sweeps
from tests.check.models import lint, mjcf

PARENT = '<geom type="box" size="0.8 1 {half}" pos="1 0 0"/>'
LINK = '<body name="link">{joint}<geom size="0.1" pos="-1 0 0"/></body>'


def reported(half: float, joint: str) -> bool:
    """Returns whether a ball 1 m from the hinge of a parent with a box of this half height is found to pass through."""
    joint = f'<joint name="j" axis="0 1 0" {joint}/>'
    world = f"<body><freejoint/>{PARENT.format(half=half)}{LINK.format(joint=joint)}</body>"
    return [f.object for f in lint(mjcf(world)) if f.code == "MJ313"] == ["joint 'j'"]


STEP = 360 / sweeps.SAMPLES  # [degrees]


@pytest.mark.parametrize(("angle", "passes"), [(30 - STEP / 2, False), (30 + STEP, True)])
def test_the_ball_is_in_the_box_for_more_than_30_degrees(angle: float, passes: bool) -> None:
    half = float(np.sin(np.radians(angle / 2)) / sweeps.INNER)
    assert reported(half, "") == passes
    assert reported(half, 'range="0 330"') == passes
    assert not reported(half, 'range="0 170"')
    assert not reported(half, 'range="-190 -10" ref="-100"')
