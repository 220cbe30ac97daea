"""Random numbers of an episode depend on its seed and their purpose alone."""

import numpy as np
import pytest

from mjrun.task.random_streams import BLOCK, COMMANDS, OBSERVATIONS, START, ObservationNoise, stream


@pytest.mark.parametrize("seed", [0, 5, 2**31, 2**32 - 1, 2**32, 2**70])
def test_streams_are_the_children_of_the_seeds_generator(seed: int) -> None:
    children = np.random.default_rng(seed).spawn(4)
    for purpose in (START, COMMANDS, OBSERVATIONS):
        assert stream(seed, purpose).random() == children[purpose].random()


def test_noise_is_that_of_the_world_whatever_is_beside_it() -> None:
    texts = [None, "normal(0, 1)", None, "uniform(2, 3)"]
    several, alone = ObservationNoise(texts, 3), ObservationNoise(texts, 1)
    for world, seed in enumerate((7, 8, 9)):
        several.begin(world, seed)
    alone.begin(0, 8)
    assert several.columns.tolist() == [1, 3]
    expected = [alone.next(np.array([0]))[0] for _ in range(2 * BLOCK + 3)]
    several.next(np.array([2]))  # which is now ahead
    for row in expected:
        noise = several.next(np.array([0, 1]))
        np.testing.assert_array_equal(noise[1], row)
        assert 2 <= noise[0, 1] <= 3
    assert abs(np.mean(expected, axis=0)[0]) < 0.6
