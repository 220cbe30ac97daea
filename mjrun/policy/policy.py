"""What a policy is: it answers observations with actions, and its file says something of itself."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import numpy as np

from mjrun.confinement.confinement import require_unconfined
from mjrun.errors import ControllerError, MjrunError, UsageError, clean, counted, listing, option
from mjrun.formats.input_file import require_file
from mjrun.task.episode import Actor

Numbers = tuple[float, ...]


@dataclass(frozen=True)
class ObservationFacts:
    """What a file says of a part of the observation; None where it is silent.

    Attributes:
      name: of the part, in the words of the file.
      size: how many numbers it has, history included.
      kind: in the words of the file: `state/joint/position`.
      elements: names of these numbers: joints, or x, y, z.
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
    """What the file of a policy says of itself; None where it is silent.

    Attributes:
      observation_size, action_size: how many numbers it takes and gives.
      observations: the parts of the observation, in order.
      joints: all joints of the robot but a free one, in the order in which observations hold them.
      default_position: of these joints [m, rad].
      action_joints: those that actions move, in their order.
      action_target: what they mean once scaled: `position`, `velocity` or `torque`.
      action_scale, action_offset: what actions are multiplied by, and what is added then, to get positions [m, rad],
        velocities or torques in SI units; one number, or one for each.
      commands: their names.
      stiffness, damping: gains of the joints that actions move [N m/rad, N m s/rad].
      control_dt: time between two actions [s].
      quaternion_order: `wxyz` or `xyzw`, of quaternions in observations.
      rounding: by how much numbers may be off as the file writes them.
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
    """The actions that a task takes.

    Attributes:
      names: of each number: an actuator or a joint.
      low, high: `(nact,)`, the clip of the task; infinite where it has none.
    """

    names: Sequence[str]
    low: np.ndarray = field(compare=False)
    high: np.ndarray = field(compare=False)


class Policy(ABC):
    """A policy.

    Attributes:
      name: as the user wrote it.
      facts: what its file says of itself.
    """

    name: str
    facts: PolicyFacts

    def __init__(self, name: str, facts: PolicyFacts | None = None) -> None:
        self.name, self.facts = name, facts or PolicyFacts()

    def episode(self, seed: int, actions: ActionSpace) -> Actor:
        """The policy at the start of an episode.

        Args:
          seed: of what is random in it; equal seeds give equal answers, whatever other episodes run beside.
          actions: those that the task takes.
        """
        actor = self.start(seed, actions)
        return lambda observation: self._checked(actor, observation, actions.names)

    @abstractmethod
    def start(self, seed: int, actions: ActionSpace) -> Actor:
        """The same, without checks of its answers."""

    def _checked(self, actor: Actor, observation: np.ndarray, names: Sequence[str]) -> np.ndarray:
        """The action `(nact,)`, float64.

        Raises:
          UsageError: what the policy answers is no list of numbers, or has another size.
          ControllerError: the policy failed.
        """
        try:
            answer: object = actor(observation)
            if answer is None:  # which NumPy takes for NaN
                raise TypeError("it answers nothing")
            action = np.asarray(answer, np.float64).reshape(-1)
        except MjrunError:
            raise
        except (TypeError, ValueError) as error:
            raise ControllerError.of(f"{option('policy')} {clean(self.name)}", error) from error
        if len(action) != len(names):
            raise UsageError(
                f"{option('policy')} {clean(self.name)} answers {counted(len(action), 'number')}, "
                f"and the task takes {counted(len(names), 'action')}: {listing(names)}"
            )
        return action


@dataclass(frozen=True)
class PolicyLoader:
    """A kind of policy files.

    Attributes:
      description: of such a file, for messages: `.zip of Stable-Baselines3`.
      suffixes: of such files.
      load: reads the policy of a file, which is named as the user wrote it; may files run code as they are opened; and
        the file of its normalization, `none`, or nothing.
      reads_folders: whether a folder is such a policy.
      files: lists the files of the policy at a path that is a file, itself included.
    """

    description: str
    suffixes: Sequence[str]
    load: Callable[[Path, str, bool, str | None], Policy]
    reads_folders: bool = False
    files: Callable[[Path], list[Path]] = lambda path: [path]


def require_trusted_file(path: Path, trust: bool) -> None:
    """Checks that `path` is a regular file that the user trusts, as it can run code when it is opened.

    Raises:
      FileError: there is none.
      UsageError: the user does not trust it.
    """
    require_file(path, "policy", [path.suffix.lower()])
    require_unconfined(f"{clean(str(path))} can run any code as it is opened")
    if not trust:
        raise UsageError(
            f"{clean(str(path))} can run any code as it is opened\n"
            f"{option('trust')} opens it, if you know where it comes from; a policy in ONNX needs no trust",
            ("policy",),
        )
