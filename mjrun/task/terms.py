"""The terms of a task as values: checked in themselves, but not yet against a model."""

from typing import cast

from mjrun.errors import UsageError, clean, option
from mjrun.options.option import is_given, options
from mjrun.options.task import (
    COMMANDED,
    CONTROL,
    OBSERVED,
    POSITION,
    VELOCITY,
    ActionOptions,
    CommandOptions,
    ObservationOptions,
    ResetOptions,
    RewardOptions,
    TerminationOptions,
)
from mjrun.physics.distribution import parse_distribution
from mjrun.task.episode import Ending, EndingKind

TIMED_OUT, UNSTABLE = Ending("timeout", "timeout"), Ending("unstable", "failure")  # which every task has
RESERVED = (TIMED_OUT.name, UNSTABLE.name)  # names that terminations of a task cannot have


@options
class Reset(ResetOptions):
    """The state at which an episode starts, and what is random in it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for each in ("noise", "set", "vary"):
            for path, text in vars(self)[each]:
                check_random(text, f"{each} {clean(path)}", (each, path), is_number=each != "vary")


@options
class Observation(ObservationOptions):
    """A term of the observation.

    Raises:
      UsageError: it has no source, or more than one, or what does not go with it.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_one(self, OBSERVED, "an observation is taken from")
        if is_given(self, "of") and self.joints is None:
            raise UsageError(f"{option('of')} goes with {option('joints')}", ("of",))
        if self.noise is not None:
            check_random(self.noise, "noise", ("noise",))

    @property
    def source(self) -> str:
        """What it is taken from: `probe`, `joints`, `action`, `command`, `phase` or `value`."""
        return next(name for name in OBSERVED if is_given(self, name))


@options
class Action(ActionOptions):
    """Some numbers of the action.

    Raises:
      UsageError: it drives nothing, or gains are missing or too many.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_one(self, ("actuators", "joints"), "an action drives")
        if self.joints is not None and self.target is None:
            raise UsageError(f"say the {option('target')} of joints: control, position, velocity or torque")
        if self.actuators is not None and self.target not in (None, CONTROL):
            raise UsageError(f"a {option('target')} {self.target} is one of {option('joints')}", ("target",))
        wanted = {POSITION: ("kp", "kd"), VELOCITY: ("kd",)}.get(self.target or CONTROL, ())
        gains = {"kp": self.kp, "kd": self.kd}
        for name, gain in gains.items():
            if gain is not None and name not in wanted:
                raise UsageError(f"{option(name)} is no gain of the target {self.target or CONTROL}", (name,))
        missing = [name for name in wanted if gains[name] is None]
        if missing:
            raise UsageError(f"the target {self.target} takes {' and '.join(map(option, missing))}", ("target",))


@options
class Command(CommandOptions):
    """A command.

    Raises:
      UsageError: it has no values, or more than one kind of them.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_one(self, COMMANDED, "a command comes from")
        for name, of in (("size", "random"), ("every", "random"), ("interpolation", "table")):
            if is_given(self, name) and not is_given(self, of):
                raise UsageError(f"{option(name)} goes with {option(of)}", (name,))
        for index, text in enumerate(self.random or ()):
            check_random(text, "random", ("random", index))
        if self.random is not None and self.size is not None and len(self.random) not in (1, self.size):
            raise UsageError(f"{option('random')} has {len(self.random)} distributions, not {self.size}", ("size",))


@options
class Reward(RewardOptions):
    """A term of the reward."""


@options
class Termination(TerminationOptions):
    """What ends an episode."""

    def ending(self, name: str) -> Ending:
        """How an episode ends by it, if it is called `name`."""
        return Ending(name, cast("EndingKind", self.as_))


def check_random(text: str, place: str, path: tuple[str | int, ...], *, is_number: bool = True) -> None:
    """Checks that `text` is a distribution, or a number.

    Args:
      place: what messages call it.
      path: of the option.
      is_number: whether its values must be numbers.

    Raises:
      UsageError: it is neither.
    """
    try:
        distribution = parse_distribution(text, place)
        values = distribution.arguments if distribution else (text,)
        if is_number:
            _ = [float(value) for value in values]
        elif distribution is None and not text.strip():
            raise ValueError
    except UsageError as error:
        error.path = path
        raise
    except ValueError:
        message = f"{place}: {clean(text)} is neither a number nor a distribution such as uniform(-0.1, 0.1)"
        raise UsageError(message, path) from None


def _require_one(term: ObservationOptions | ActionOptions | CommandOptions, names: tuple[str, ...], what: str) -> None:
    """Checks that exactly one of the options `names` is given."""
    given = [name for name in names if is_given(term, name)]
    if len(given) != 1:
        message = f"{what} one of {', '.join(map(option, names))}"
        got = f", not {' and '.join(map(option, given))}" if given else ""
        raise UsageError(message + got, (given[1] if given else names[0],))
