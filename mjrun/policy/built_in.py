"""The policies that need no file: random actions, and zeros."""

import numpy as np

from mjrun.options.policy import RANDOM, ZERO
from mjrun.policy.policy import ActionSpace, Actor, Policy

STREAM = 1_886_350_441  # keeps the random numbers of policies apart from those of tasks


class RandomPolicy(Policy):
    """Actions that are uniform within the clip of the task, or within [-1, 1] where there is none."""

    def __init__(self) -> None:
        super().__init__(RANDOM)

    def start(self, seed: int, actions: ActionSpace) -> Actor:
        low = np.where(np.isfinite(actions.low), actions.low, np.minimum(-1, actions.high - 2))
        high = np.where(np.isfinite(actions.high), actions.high, np.maximum(1, low + 2))
        generator = np.random.default_rng([seed, STREAM])
        return lambda observation: generator.uniform(low, high)


class ZeroPolicy(Policy):
    """Zeros, whatever is observed."""

    def __init__(self) -> None:
        super().__init__(ZERO)

    def start(self, seed: int, actions: ActionSpace) -> Actor:
        return lambda observation: np.zeros(len(actions.names))
