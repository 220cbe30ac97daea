"""The interface of windows that show a live simulation, and the actions that users take there."""

from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np

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
class Reset:
    """An action that restarts from time 0.

    Attributes:
      key: index of the keyframe to start from; None for the simulation's start.
    """

    key: int | None = None


@dataclass(frozen=True)
class Pull:
    """An action that pulls bodies with the mouse, until the next such action.

    Attributes:
      forces: forces [N] and torques [N m] in the world frame, `(nbody, 6)`.
    """

    forces: np.ndarray


@dataclass(frozen=True)
class Edit:
    """An action that sets numbers of the state.

    Attributes:
      state: the integration state after the edit `(nstate,)`.
      changed: mask of the edited numbers `(nstate,)`.
    """

    state: np.ndarray
    changed: np.ndarray


@dataclass(frozen=True)
class Refuse:
    """An action that a view does not support; `what` is the sentence about it."""

    what: str


Action = SetPaused | TakeStep | SetSpeed | Reset | Pull | Edit | Refuse


@dataclass(frozen=True)
class Status:
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


class Window(Protocol):
    """A window that shows a model and receives user actions.

    Attributes:
      kind: `window` or `browser`.
    """

    kind: str

    @property
    def is_open(self) -> bool:
        """True until a user closes it."""
        ...

    @property
    def is_seen(self) -> bool:
        """True once a user could see it."""
        ...

    def show(self, instant: mujoco.MjData, status: Status) -> list[Action]:
        """Shows an instant, and returns the user's actions since the previous one.

        Args:
          instant: an MjData whose fields all belong to its state; it is copied.
        """
        ...

    def close(self) -> None:
        """Closes it, and waits until all its resources are freed."""
        ...


PHYSICS_SETTINGS = Refuse(
    f"physics settings cannot change while a simulation runs: start it with {option('set')}, as in opt.gravity=0,0,-1"
)
