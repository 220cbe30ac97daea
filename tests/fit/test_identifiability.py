"""What measurements tell, and what they do not, where the answer is known beforehand."""

import numpy as np
import pytest

from mjrun.fit.identifiability import sensitivity
from mjrun.fit.shooting import SHORTEST
from tests.fit.logs import NOISE
from tests.fit.problems import THREE, segments, shooting


def unidentifiable(*texts: tuple[str, str]) -> list[tuple[str, ...]]:
    shoot, parameters = shooting(texts)
    parts = shoot.cut(segments(), 4 * SHORTEST)
    start = np.array([each.first_coordinate for each in parameters])
    look = shoot.look(parts, start, shoot.guessed(parts, None), np.array([NOISE]))
    return [each.paths for each in sensitivity([look], parameters).unidentifiable]


def test_what_shows_in_the_motion_can_be_told() -> None:
    assert unidentifiable(*THREE) == []


def test_the_gear_of_a_motor_that_is_never_driven_cannot() -> None:
    assert unidentifiable(THREE[0], ("actuator/motor.gear[0]", "0.5..2")) == [("actuator/motor.gear[0]",)]


def test_two_names_of_one_thing_cannot_be_told_apart() -> None:
    (mixed,) = unidentifiable(THREE[0], ("geom/rod.mass", "0.5..2"), ("scale:geom/*.mass", "0.5..2"))
    assert set(mixed) == {"geom/rod.mass", "scale:geom/*.mass"}


def test_a_prior_tells_what_measurements_do_not() -> None:
    assert unidentifiable(THREE[0], ("actuator/motor.gear[0]", "0.5..2~normal(1, 0.05)")) == []


def test_a_pendulum_that_swings_freely_does_not_tell_its_mass() -> None:
    """Mass, armature, damping and friction can all be scaled: the motion is the same."""
    (mixed,) = unidentifiable(*THREE, ("geom/rod.mass", "0.5..2"))
    assert set(mixed) == {"geom/rod.mass", *(path for path, _ in THREE)}


def test_messages_name_the_parameters() -> None:
    shoot, parameters = shooting((THREE[0], ("actuator/motor.gear[0]", "0.5..2")))
    parts = shoot.cut(segments(), 4 * SHORTEST)
    look = shoot.look(parts, np.array([0.5, 0.5]), shoot.guessed(parts, None), np.array([NOISE]))
    found = sensitivity([look], parameters)
    assert found.unidentifiable[0].message == "the measurements say nothing of actuator/motor.gear[0]"
    assert found.effects[0] > 100
    assert found.effects[1] == pytest.approx(0, abs=1e-6)
    assert np.isinf(found.condition)
