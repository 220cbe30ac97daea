"""Gaussian noise on controls, reproducible from its seed."""

import math

import numpy as np

BLOCK = 1024  # steps of noise drawn at a time
STREAM = 1  # keeps the noise on controls apart from other noise of the same seed


class ControlNoise:
    """Gaussian noise on every control: white, or an Ornstein-Uhlenbeck process.

    Any step can be asked for at any time: the same seed gives the same noise at the same step.

    Args:
      std: standard deviation, in the actuators' own units.
      smooth: time in which the process forgets [s]; 0 is white noise, new at every step.
      seed: of the noise.
      timestep: of the simulation [s].
      actuators: how many.
    """

    def __init__(self, std: float, smooth: float, seed: int, timestep: float, actuators: int) -> None:
        self._std, self._seed, self._actuators = std, seed, actuators
        self._keep = math.exp(-timestep / smooth) if smooth else 0.0
        self._last = [np.zeros(actuators)]  # the value before each block
        self._block, self._values = -1, np.empty(0)

    def rows(self, first: int, count: int) -> np.ndarray:
        """The noise of the steps from `first` on, `(count, nu)`."""
        out = np.empty((count, self._actuators))
        step = first
        while step < first + count:
            block, at = divmod(step, BLOCK)
            part = self._noise(block)[at : at + first + count - step]
            out[step - first : step - first + len(part)] = part
            step += len(part)
        return out

    def _noise(self, block: int) -> np.ndarray:
        for wanted in range(min(block, len(self._last) - 1), block + 1):
            if wanted != self._block:
                self._block, self._values = wanted, self._draw(wanted)
                if wanted + 1 == len(self._last):
                    self._last.append(self._values[-1])
        return self._values

    def _draw(self, block: int) -> np.ndarray:
        generator = np.random.default_rng([self._seed, STREAM, block])
        values = self._std * generator.standard_normal((BLOCK, self._actuators))
        if self._keep:
            value = self._last[block]
            values[block == 0 :] *= math.sqrt(1 - self._keep**2)  # so that the deviation is std from the start
            for row in values:
                row += self._keep * value
                value = row
        return values
