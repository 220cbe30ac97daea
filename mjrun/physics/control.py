"""The controls of a simulation, step by step, whatever they come from.

Controls belong to an instant: those set at step k act from step k to k + 1, and on what is derived at k.
"""

from dataclasses import dataclass
from fractions import Fraction
from typing import Protocol

import numpy as np

from mjrun.physics.control_noise import ControlNoise
from mjrun.physics.controller import PeriodicController

NEVER = 2**62  # a step that no simulation reaches


class KnownInputs(Protocol):
    """Applied forces, mocap poses and whatever else acts on a simulation, known beforehand."""

    def at(self, step: int) -> np.ndarray:
        """All inputs at `step`, as `state.INPUTS` has them."""
        ...

    def next_change(self, step: int) -> int:
        """A step after `step` up to which all inputs but the controls stay as they are."""
        ...


class KnownControls(Protocol):
    """Controls that are known beforehand."""

    def apply(self, ctrl: np.ndarray, first: int, timestep: Fraction) -> None:
        """Puts the controls of the steps from `first` on into `ctrl` `(n, nu)`, as far as they are known."""
        ...


@dataclass
class ControlSignal:
    """All that drives a simulation: a table, noise that is added, a controller, and constants for the rest.

    Attributes:
      timestep: of the simulation [s], exact.
      constant: controls `(nu,)` that hold where nothing else says; the stepper keeps those of the controller here.
      table, noise, controller: what there is besides.
      inputs: what acts besides controls, if it is known beforehand.
    """

    timestep: Fraction
    constant: np.ndarray
    table: KnownControls | None = None
    noise: ControlNoise | None = None
    controller: PeriodicController | None = None
    inputs: KnownInputs | None = None

    @property
    def varies(self) -> bool:
        """Whether the controls change from step to step, without a controller."""
        return self.table is not None or self.noise is not None

    def rows(self, first: int, count: int) -> np.ndarray:
        """The controls of the steps from `first` on, `(count, nu)`, until the controller is called again."""
        ctrl = np.tile(self.constant, (count, 1))
        if self.table:
            self.table.apply(ctrl, first, self.timestep)
        if self.noise:
            ctrl += self.noise.rows(first, count)
        return ctrl

    def next_call(self, step: int) -> int:
        """The first step after `step` at which the controller is called."""
        return self.controller.next_call(step) if self.controller else NEVER

    def is_due(self, step: int) -> bool:
        """Whether the controller is called at `step`."""
        return self.controller is not None and self.controller.is_due(step)
