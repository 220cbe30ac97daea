"""Options of disturbances as plain values."""

import pytest

from mjrun.errors import UsageError
from mjrun.options.disturbance import NO_DISTURBANCES
from mjrun.options.evaluation import EvaluationOptions
from mjrun.simulation.simulation import Simulation


def test_no_noise_differs_from_noise_that_is_not_specified() -> None:
    assert Simulation("a.xml").disturbances == NO_DISTURBANCES
    assert Simulation("a.xml", ctrl_noise=0).disturbances.ctrl_noise == 0 != None
    (push,) = EvaluationOptions("t.yaml", "out", push="torso=1/2/3@0+1").disturbances.push
    assert (push.target, push.force) == ("torso", (1, 2, 3))


def test_a_negative_deviation_is_refused() -> None:
    with pytest.raises(UsageError, match="at least 0"):
        Simulation("a.xml", ctrl_noise=-1)
