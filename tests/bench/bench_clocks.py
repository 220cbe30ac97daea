"""A small model, and clocks that make wall times exact."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch

from mjrun.bench.bench import Bench
from mjrun.bench.block_timing import MJCF
from mjrun.model.source import ModelSource
from tests.cases import mjcf

MODEL = mjcf("spring")


def bench(model: Path | ModelSource | mujoco.MjModel, **changed: Any) -> Bench:
    """A small benchmark."""
    return Bench(model, **{"steps": 20, "repeats": 8, "threads": (1, 2), **changed})


class FakeClock:
    """Advances by `tick` [s] at every reading, plus up to `noise` of it."""

    def __init__(self, tick: float = 1.0, noise: float = 0.0, seed: int = 0) -> None:
        self.now, self._tick, self._noise = 0.0, tick, noise
        self._random = np.random.default_rng(seed)

    def __call__(self) -> float:
        self.now += self._tick * (1 + self._noise * self._random.random())
        return self.now


class BlockClock:
    """Advances by the next of some durations [s] at every second reading, and counts readings."""

    def __init__(self, *durations: float) -> None:
        self.now, self.readings, self._durations = 0.0, 0, iter(durations)

    def __call__(self) -> float:
        self.readings += 1
        if self.readings % 2 == 0:  # at the end of a block
            self.now += next(self._durations)
        return self.now


class SimulatedMachine:
    """A clock that advances with the steps that `mujoco.batch` takes, at the speed of another machine.

    Args:
      subject: cost of a step of another model, relative to the reference workload.
      slowdown: factor of all costs, as a function of the time so far [s].
      noise: standard deviation of the logarithm of every wall time.
    """

    STEP = 2.0**-10  # [s]

    def __init__(
        self,
        subject: float = 1.0,
        slowdown: Callable[[float], float] = lambda now: 1.0,
        noise: float = 0.0,
        seed: int = 0,
    ) -> None:
        self.now, self._subject, self._slowdown, self._noise = 0.0, subject, slowdown, noise
        self._random = np.random.default_rng(seed)
        self._workload = mujoco.MjModel.from_xml_string(MJCF).nv

    def __call__(self) -> float:
        return self.now

    def took(self, batch: Batch, steps: int) -> None:
        """Advances by the cost of steps of all simulations in a batch."""
        is_workload = batch.model.nv == self._workload
        cost = self.STEP * (1.0 if is_workload else self._subject)
        self.now += cost * steps * self._slowdown(self.now) * np.exp(self._noise * self._random.standard_normal())
