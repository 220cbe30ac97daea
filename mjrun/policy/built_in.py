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
        return _RandomActor(np.random.default_rng([seed, STREAM]), low, high)


class _RandomActor:
    def __init__(self, generator: np.random.Generator, low: np.ndarray, high: np.ndarray) -> None:
        self._generator, self._low, self._high = generator, low, high

    def act(self, observation: np.ndarray) -> np.ndarray:
        return self._generator.uniform(self._low, self._high)


class ZeroPolicy(Policy):
    """Zeros, whatever is observed."""

    def __init__(self) -> None:
        super().__init__(ZERO)

    def start(self, seed: int, actions: ActionSpace) -> Actor:
        return _ZeroActor(len(actions.names))


class _ZeroActor:
    def __init__(self, size: int) -> None:
        self._size = size

    def act(self, observation: np.ndarray) -> np.ndarray:
        return np.zeros(self._size)
