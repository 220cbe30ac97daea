"""The actions that users take in a window, and the status that it shows."""

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import option


@dataclass(frozen=True)
class SetPaused:
    """An action that pauses or resumes."""

    paused: bool


@dataclass(frozen=True)
class TakeStep:
    """An action that pauses and takes one step."""


@dataclass(frozen=True)
class SetSpeed:
    """An action that sets the speed: simulated seconds per second of wall time."""

    speed: float


@dataclass(frozen=True)
class ResetSimulation:
    """An action that restarts from time 0.

    Attributes:
      key: index of the keyframe to start from; None for the simulation's start.
    """

    key: int | None = None


@dataclass(frozen=True)
class PullBodies:
    """An action that pulls bodies with the mouse, until the next such action.

    Attributes:
      forces: forces [N] and torques [N m] in the world frame, `(nbody, 6)`.
    """

    forces: np.ndarray


@dataclass(frozen=True)
class SetStateNumbers:
    """An action that sets numbers of the state.

    Attributes:
      state: the integration state after the edit `(nstate,)`.
      changed: mask of the edited numbers `(nstate,)`.
    """

    state: np.ndarray
    changed: np.ndarray


@dataclass(frozen=True)
class UnsupportedAction:
    """An action that a view does not support; `what` is the sentence about it."""

    what: str


PHYSICS_SETTINGS = UnsupportedAction(
    f"physics settings cannot change while a simulation runs: start it with {option('set')}, as in opt.gravity=0,0,-1"
)
Action = SetPaused | TakeStep | SetSpeed | ResetSimulation | PullBodies | SetStateNumbers | UnsupportedAction


@dataclass(frozen=True)
class SimulationStatus:
    """The status of a simulation, shown beside its image.

    Attributes:
      time: simulated time [s].
      paused: whether it is paused.
      speed: requested simulated seconds per second of wall time.
      achieved: achieved simulated seconds per second of wall time.
      message: the reason why it ended, if it has.
    """

    time: float
    paused: bool
    speed: float
    achieved: float
    message: str = ""
