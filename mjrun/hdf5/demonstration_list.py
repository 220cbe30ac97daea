"""The list of the demonstrations in a file, each with its facts, and the origin of the file."""

from collections.abc import Mapping, Sequence

from mjrun.dataclass import dataclass


@dataclass(frozen=True)
class DemonstrationFileOrigin:
    """The origin of demonstrations, according to their file; empty or None where it states nothing.

    Attributes:
      task: the name of the environment.
      instruction: the task in natural language.
      mujoco: the version of MuJoCo.
      robosuite: the version of robosuite.
      robots: the names of the robots.
      control_rate: actions per second [Hz].
      is_robosuite: whether the environment is one of robosuite, or of a program that is based on it.
    """

    task: str = ""
    instruction: str = ""
    mujoco: str = ""
    robosuite: str = ""
    robots: Sequence[str] = ()
    control_rate: float | None = None
    is_robosuite: bool = False


@dataclass(frozen=True)
class DemonstrationListEntry:
    """A demonstration in a file, as `mjrun info` lists it.

    Attributes:
      name: its name in the file.
      states: the number of states.
      duration: the time from the first state to the last [s]; None if a time is not finite.
      instruction: its task in natural language, if the episode has its own.
      reward: the sum of its rewards; None if the file has none, or one is not finite.
      images: the names of the images among its observations.
    """

    name: str
    states: int
    duration: float | None = None
    instruction: str = ""
    reward: float | None = None
    images: Sequence[str] = ()


@dataclass(frozen=True)
class DemonstrationList:
    """The demonstrations in a file.

    Attributes:
      path: the path of the file.
      origin: what the file states about all of them.
      cameras: the cameras of the model of the first one.
      subsets: the number of demonstrations in each subset, by name.
      demonstrations: the demonstrations, in order.
    """

    path: str
    origin: DemonstrationFileOrigin
    cameras: Sequence[str]
    subsets: Mapping[str, int]
    demonstrations: Sequence[DemonstrationListEntry]
