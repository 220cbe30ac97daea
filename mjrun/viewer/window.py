"""What a live simulation is shown in, and what people do there."""

from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np

from mjrun.errors import option


@dataclass(frozen=True)
class SetPaused:
    """Pause, or go on."""

    paused: bool


@dataclass(frozen=True)
class TakeStep:
    """Pause, and take one step."""


@dataclass(frozen=True)
class SetSpeed:
    """Another speed: simulated seconds per second of wall time."""

    speed: float


@dataclass(frozen=True)
class Reset:
    """Start again from time 0.

    Attributes:
      key: index of the keyframe to start from; None for the simulation's own start.
    """

    key: int | None = None


@dataclass(frozen=True)
class Pull:
    """The mouse pulls at bodies, until it says otherwise.

    Attributes:
      forces: forces [N] and torques [N m] in the world frame, `(nbody, 6)`.
    """

    forces: np.ndarray


@dataclass(frozen=True)
class Edit:
    """Numbers of the state were set by hand.

    Attributes:
      state: the integration state with them `(nstate,)`.
      changed: which of its numbers they are `(nstate,)`.
    """

    state: np.ndarray
    changed: np.ndarray


@dataclass(frozen=True)
class Refuse:
    """Something that a view does not do; `what` is the sentence about it."""

    what: str


Action = SetPaused | TakeStep | SetSpeed | Reset | Pull | Edit | Refuse


@dataclass(frozen=True)
class Status:
    """What is said of a simulation beside its image.

    Attributes:
      time: simulated time [s].
      paused: whether it stands still.
      speed: simulated seconds per second of wall time that are asked for.
      achieved: those that are reached.
      message: what ended it, if something did.
    """

    time: float
    paused: bool
    speed: float
    achieved: float
    message: str = ""


class Window(Protocol):
    """Shows a model, and takes what people do there.

    Attributes:
      kind: `window` or `browser`.
    """

    kind: str

    @property
    def is_open(self) -> bool:
        """Whether nobody has closed it."""
        ...

    @property
    def is_seen(self) -> bool:
        """Whether somebody has been able to look at it yet."""
        ...

    def show(self, instant: mujoco.MjData, status: Status) -> list[Action]:
        """Shows an instant, and returns what was done since the last one was shown.

        Args:
          instant: every field belongs to its state; it is copied.
        """
        ...

    def close(self) -> None:
        """Closes it, and waits until nothing of it is left."""
        ...


PHYSICS_SETTINGS = Refuse(
    f"physics settings are not changed while a simulation runs: start it with {option('set')}, as in opt.gravity=0,0,-1"
)
