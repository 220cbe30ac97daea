"""The interface of policies: a function from observations to actions, and facts from its file."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import field
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np

from mjrun.confinement.confinement import require_unconfined
from mjrun.dataclass import dataclass
from mjrun.errors import ControllerError, MjrunError, UsageError, clean, counted, described_type, listing, option
from mjrun.formats.input_file import require_file
from mjrun.task.episode import Actor

Numbers = tuple[float, ...]


@dataclass(frozen=True)
class ObservationFacts:
    """Properties that a policy file specifies for a part of the observation; None where unspecified.

    Attributes:
      name: the name of the part in the file.
      size: the number of values, history included.
      kind: the kind of the quantity in the file: `state/joint/position`.
      elements: the names of these values: joints, or x, y, z.
      offset, scale, clip, history: as in the observations of a task; the clip follows the scale.
    """

    name: str
    size: int | None = None
    kind: str | None = None
    elements: tuple[str, ...] | None = None
    offset: Numbers | None = None
    scale: Numbers | None = None
    clip: tuple[float, float] | None = None
    history: int | None = None


@dataclass(frozen=True)
class PolicyFacts:
    """The facts of a file about its policy; None where unspecified.

    Attributes:
      observation_size, action_size: the number of values in each.
      observations: the parts of the observation, in order.
      joints: all joints of the robot except a free one, in the order of observations.
      default_position: the default positions of these joints [m, rad].
      action_joints: the joints that actions move, in order.
      action_target: the quantity that scaled actions specify: `position`, `velocity` or `torque`.
      action_scale, action_offset: the factor of actions, and the offset added after it, that give positions [m, rad],
        velocities or torques in SI units; one number, or one for each.
      commands: their names.
      stiffness, damping: gains of the joints that actions move [N m/rad, N m s/rad].
      control_dt: time between two actions [s].
      quaternion_order: `wxyz` or `xyzw`, of quaternions in observations.
      rounding: the largest error of numbers in the file.
    """

    observation_size: int | None = None
    action_size: int | None = None
    observations: tuple[ObservationFacts, ...] | None = None
    joints: tuple[str, ...] | None = None
    default_position: Numbers | None = None
    action_joints: tuple[str, ...] | None = None
    action_target: str | None = None
    action_scale: Numbers | None = None
    action_offset: Numbers | None = None
    commands: tuple[str, ...] | None = None
    stiffness: Numbers | None = None
    damping: Numbers | None = None
    control_dt: Fraction | None = None
    quaternion_order: str | None = None
    rounding: float = 0.0


@dataclass(frozen=True)
class ActionSpace:
    """The space of the actions of a task.

    Attributes:
      names: the names of the values: actuators or joints.
      low, high: `(nact,)`, the clip of the task; infinite without one.
    """

    names: Sequence[str]
    low: np.ndarray = field(compare=False)
    high: np.ndarray = field(compare=False)


POLICY = ("policy",)  # path of the option, in errors at run time, which do not name it


class Policy(ABC):
    """A policy.

    Attributes:
      name: its text from the user.
      facts: facts from its file.
    """

    name: str
    facts: PolicyFacts

    def __init__(self, name: str, facts: PolicyFacts | None = None) -> None:
        self.name, self.facts = name, facts or PolicyFacts()

    def episode(self, seed: int, actions: ActionSpace) -> Actor:
        """Returns the policy at the start of an episode.

        Args:
          seed: the seed of its random numbers; equal seeds give equal actions, independent of other episodes.
          actions: the actions of the task.
        """
        return partial(self._checked, self.start(seed, actions), actions.names)

    @abstractmethod
    def start(self, seed: int, actions: ActionSpace) -> Actor:
        """Returns the policy at the start of an episode, without checks of its actions."""

    def _checked(self, actor: Actor, names: Sequence[str], observation: np.ndarray) -> np.ndarray:
        """Returns the action `(nact,)`, float64.

        Raises:
          UsageError: the action has the wrong size.
          ControllerError: the policy failed.
        """
        policy, takes = f"policy {clean(self.name)}", f"{counted(len(names), 'action')}: {listing(names)}"
        try:
            answer = cast("object", actor(observation))
        except MjrunError:
            raise
        except (TypeError, ValueError) as error:
            raise ControllerError.of(policy, error) from error
        try:
            if answer is None or np.iscomplexobj(cast("np.ndarray", answer)):
                raise TypeError  # NumPy would convert these to NaN, and to real parts
            action = np.array(answer, np.float64).reshape(-1)  # a copy, as the policy may write into its array again
        except (TypeError, ValueError, OverflowError):  # the latter of a whole number that is no float
            kind = described_type(answer)
            raise ControllerError(f"{policy} returned {kind}, not numbers\nthe task takes {takes}", POLICY) from None
        if len(action) != len(names):
            numbers = counted(len(action), "number")
            raise UsageError(f"{policy} returned {numbers}, and the task takes {takes}", POLICY)
        return action


@dataclass(frozen=True)
class PolicyFormat:
    """A format of policy files.

    Attributes:
      suffixes: the suffixes of its files.
      load: loads a policy from a path, its text from the user, whether files may run code when they are opened, and the
        file of its normalization, `none`, or None.
      reads_folders: whether a folder can be such a policy.
      files: lists the files of the policy at the path of a file, itself included.
      packages: the packages that compute its actions.
    """

    suffixes: Sequence[str]
    load: Callable[[Path, str, bool, str | None], Policy]
    reads_folders: bool = False
    files: Callable[[Path], list[Path]] = lambda path: [path]
    packages: Sequence[str] = ()


def require_trusted_file(path: Path, trust: bool) -> None:
    """Checks that `path` is a regular file that the user trusts, since it can run code when it is opened.

    Raises:
      FileError: it does not exist.
      UsageError: the user does not trust it.
    """
    require_file(path, "policy", [path.suffix.lower()])
    require_unconfined(f"{clean(str(path))} can run any code when it is opened")
    if not trust:
        raise UsageError(
            f"{clean(str(path))} can run any code when it is opened\n"
            f"set {option('trust')} if you trust its origin; ONNX policies do not need it",
            ("policy",),
        )
