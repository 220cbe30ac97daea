"""Theorems about fixes of all ranges in a text."""

import mujoco
import numpy as np
import pytest

from tests.check.fixes import fixed
from tests.check.models import hinged

MOTOR = '<actuator><motor name="m" joint="j" {}/></actuator>'


@pytest.mark.parametrize(
    ("text", "old", "new"),
    [
        (hinged('range="0 1" actuatorfrcrange="0 1"'), '1"/>', '1" limited="true" actuatorfrclimited="true"/>'),
        (hinged(before='<default><joint range="0 1"/></default>'), '1"/></d', '1" limited="true"/></d'),
        (hinged(after=MOTOR.format('ctrlrange="0 1"')), '0 1"', '0 1" ctrllimited="true"'),
        (hinged(before='<default><joint limited="false"/></default>'), "", ""),
    ],
)
def test_ranges_without_a_limit_are_enabled(text: str, old: str, new: str) -> None:
    text = text.replace("<mujoco>", '<mujoco><compiler autolimits="false"/>')
    after = fixed(text)
    assert after == (text.replace(old, new, 1) if old else text)
    free = mujoco.MjModel.from_xml_string(text.replace(' autolimits="false"', ""))
    model = mujoco.MjModel.from_xml_string(after)
    for name in ("jnt_limited", "jnt_actfrclimited", "jnt_range", "actuator_ctrllimited"):
        np.testing.assert_array_equal(getattr(model, name), getattr(free, name))


@pytest.mark.parametrize(
    "text",
    [
        hinged('limited="true" range="2 1"'),
        hinged('actuatorfrclimited="true" actuatorfrcrange="2 1"'),
        hinged(after=MOTOR.format('ctrllimited="true" ctrlrange="2 1"')),
        hinged(after='<tendon><fixed limited="true" range="2 1"><joint joint="j" coef="1"/></fixed></tendon>'),
    ],
)
def test_reversed_ranges_that_keep_a_model_from_loading_are_swapped(text: str) -> None:
    assert fixed(text) == text.replace("2 1", "1 2")
