"""What windows report is plain values."""

import numpy as np

from mjrun.errors import spelled
from mjrun.viewer.window import PHYSICS_SETTINGS, Pull, Reset


def test_actions_are_values() -> None:
    forces = np.zeros((2, 6))
    assert Pull(forces).forces is forces
    assert Reset() == Reset(None) != Reset(0)


def test_what_is_refused_says_which_option_does_it() -> None:
    assert "set, as in opt.gravity" in spelled(PHYSICS_SETTINGS.what)
