"""Multiple shooting finds what a bare loop was simulated with."""

import numpy as np
import pytest

from tests.fit.cart import TRUTH as CART_TRUTH
from tests.fit.cart import cart_log, cart_shooting
from tests.fit.logs import NOISE, TRUTH
from tests.fit.problems import THREE, segments, shooting, solved


def test_without_noise_it_finds_the_truth() -> None:
    shoot, parameters = shooting(THREE)
    start = np.array([each.first_coordinate for each in parameters])
    stages = shoot.grown(segments(exact=True), start, np.array([1e-4]))
    values = [each.value(c) for each, c in zip(parameters, stages[-1].coordinates, strict=True)]
    assert values == pytest.approx(list(TRUTH.values()), rel=2e-4)
    assert len(stages[0].chunks) > len(stages[1].chunks) > 1
    assert len(stages[-1].chunks) == 1


def test_with_noise_it_finds_the_truth_and_the_noise() -> None:
    solution, parameters = solved()
    values = [each.value(c) for each, c in zip(parameters, solution.coordinates, strict=True)]
    assert values == pytest.approx(list(TRUTH.values()), rel=0.1)
    assert solution.noise[0] == pytest.approx(NOISE, rel=0.1)
    assert solution.cost == pytest.approx(1)


def test_the_better_of_two_starts_is_taken() -> None:
    shoot, parameters = shooting(THREE)
    truth = np.array([each.coordinate(value) for each, value in zip(parameters, TRUTH.values(), strict=True)])
    found = shoot.best_start(segments(), [np.array([0.99, 0.99, 0.99]), truth], np.array([NOISE]))
    assert found == pytest.approx(truth, abs=0.2)


def test_whole_segments_are_shot_from_other_starts_where_the_fit_is_wrong() -> None:
    """A cart that is not measured: from a solution far off, and from its start, to the truth of a bare loop."""
    log, _ = cart_log()
    shoot, _, _, parameters = cart_shooting()
    wrong, near = np.array([0.05, 0.05]), np.array([0.6, 0.4])
    parts, noise = shoot.cut([log], 10**6), np.array([1e-4])
    found = shoot.look(parts, wrong, shoot.guessed(parts, wrong), noise)
    solutions = shoot.searched(found, [near], noise)
    values = [each.value(c) for each, c in zip(parameters, solutions[-1].coordinates, strict=True)]
    assert values == pytest.approx(CART_TRUTH, rel=0.01)
    assert min(each.cost for each in solutions) == solutions[-1].cost < found.cost
    assert shoot.searched(solutions[-1], [wrong], noise) == []
