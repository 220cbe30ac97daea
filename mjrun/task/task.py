"""A task as a value: its model, and the observations, actions, rewards and endings of its episodes.

The terms of a task check their own options; names are looked up in the model later, by `mjrun.task.worlds`.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import field, replace
from fractions import Fraction
from pathlib import Path
from typing import Protocol, cast

import mujoco

from mjrun.dataclass import dataclass
from mjrun.errors import (
    BadValueError,
    FileError,
    ModelNotFoundError,
    UnknownNameError,
    UsageError,
    clean,
    concerning,
    option,
    quoted,
)
from mjrun.model.source import ModelSource
from mjrun.model.sources import source_of
from mjrun.options import task as options_of_tasks
from mjrun.options.number_kinds import ExactNumberKind
from mjrun.options.option import is_given, options
from mjrun.options.schema_validation import InvalidValueError
from mjrun.options.simulation import NO_DISTURBANCES, NOISE_REQUIREMENT, DisturbanceOptions, Disturbances, Push
from mjrun.options.task import COMMANDED, CONTROL, CURRENT, DERIVED, OBSERVED, POSITION, VELOCITY
from mjrun.physics.random_distribution import parse_distribution
from mjrun.task.episode import Ending, EndingKind
from mjrun.timeline import rational, unrounded

TIMED_OUT, UNSTABLE = Ending("timeout", "timeout"), Ending("unstable", "failure")  # endings of every task
RESERVED = (TIMED_OUT.name, UNSTABLE.name)
MOST_PERIODS = 10_000_000  # control periods of an episode
NO_COMMANDS: Mapping[str, "Command"] = {}
NO_REWARDS: Mapping[str, "Reward | str"] = {}
NO_TERMINATIONS: Mapping[str, "Termination"] = {}


@options
class Reset(options_of_tasks.ResetOptions):
    """The initial state of an episode, and its random parts."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for each in ("noise", "set", "vary"):
            for path, text in vars(self)[each]:
                _check_random(text, f"{each} {clean(path)}", (each, path), is_number=each != "vary")


@options
class Observation(options_of_tasks.ObservationOptions):
    """A term of the observation.

    Raises:
      UsageError: it has no source or several, or an option that does not apply to its source.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_one(self, OBSERVED, "an observation is taken from")
        if is_given(self, "of") and self.joints is None:
            raise UsageError(f"{option('of')} applies only with {option('joints')}", ("of",))
        if self.noise is not None:
            _check_random(self.noise, "noise", ("noise",))

    @property
    def source(self) -> str:
        """The option that names its source: `probe`, `joints`, `action`, `command`, `phase` or `value`."""
        return next(name for name in OBSERVED if is_given(self, name))


@options
class Action(options_of_tasks.ActionOptions):
    """A group of numbers of the action.

    Raises:
      UsageError: it drives nothing, a gain is missing, or a gain does not apply to its target.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_one(self, ("actuators", "joints"), "an action drives")
        if self.joints is not None and self.target is None:
            message = f"{option('joints')} requires a {option('target')}: control, position, velocity or torque"
            raise UsageError(message, ("target",))
        if self.actuators is not None and self.target not in (None, CONTROL):
            raise UsageError(f"{option('target')} {self.target} applies only with {option('joints')}", ("target",))
        wanted = {POSITION: ("kp", "kd"), VELOCITY: ("kd",)}.get(self.target or CONTROL, ())
        gains = {"kp": self.kp, "kd": self.kd}
        for name, gain in gains.items():
            if gain is not None and name not in wanted:
                raise UsageError(f"{option(name)} is not a gain of the target {self.target or CONTROL}", (name,))
        missing = [name for name in wanted if gains[name] is None]
        if missing:
            raise UsageError(f"the target {self.target} requires {' and '.join(map(option, missing))}", ("target",))


@options
class Command(options_of_tasks.CommandTermOptions):
    """A command to the policy.

    Raises:
      UsageError: it has no source of values or several, or an option that does not apply to its source.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_one(self, COMMANDED, "a command comes from")
        for name, of in (("size", "random"), ("every", "random"), ("interpolation", "table")):
            if is_given(self, name) and not is_given(self, of):
                raise UsageError(f"{option(name)} applies only with {option(of)}", (name,))
        for index, text in enumerate(self.random or ()):
            _check_random(text, "random", ("random", index))
        if self.random is not None and self.size is not None and len(self.random) not in (1, self.size):
            raise UsageError(f"{option('random')} has {len(self.random)} distributions, not {self.size}", ("size",))


@options
class Reward(options_of_tasks.RewardTermOptions):
    """A term of the reward."""


@options
class _TaskDisturbances(DisturbanceOptions):
    """Noise on the controls of a task, and pushes."""


@options
class Termination(options_of_tasks.TerminationOptions):
    """A condition that ends an episode."""

    def ending(self, name: str) -> Ending:
        """Returns the ending of an episode by this termination, which the task calls `name`."""
        return Ending(name, cast("EndingKind", self.as_))


LocatableError = UsageError | FileError | ModelNotFoundError


class Places(Protocol):
    """The positions at which a task is written, such as the lines of a document."""

    def located(self, error: LocatableError) -> LocatableError:
        """Returns `error` with the position that it concerns."""
        ...


class ErrorLocator(AbstractContextManager[None]):
    """A context that reports errors in a task where it is written; a class, because it is entered at every reset.

    Raises:
      LocatableError: the one raised within, at its line of the document if there is one.
    """

    def __init__(self, places: Places | None) -> None:
        self._places = places

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        if isinstance(error, LocatableError) and self._places:
            located = self._places.located(error)
            if located is not error:
                raise located from error


@dataclass(frozen=True)
class Task(ModelSource):
    """A task. It is accepted wherever a model is, and then represents its model.

    Args:
      model: its source.
      control_dt: the control period [s], a whole number of timesteps.
      duration: length of an episode [s].
      observations, actions: the terms in the order of the policy's input and output.
      rewards, commands, terminations: the terms by name; a reward may be an expression alone.
      reset: the initial state of episodes.
      derived: `current` or `lagged`: the instant of the observed quantities that MuJoCo derives from the state.
      ctrl_noise: standard deviation of Gaussian noise on every control, in the actuators' units; None for 0.
      ctrl_noise_time: correlation time of the noise [s]; None for 0, which makes it independent at every step.
      push: forces on bodies, as text, mappings or `Push`.
      path: the path of its document, or None.
      name: replaces the path in messages, such as `scene:car_drive`; empty for none.
      places: its positions in the document.

    Raises:
      UsageError: invalid values, or names that are used twice.
    """

    model: ModelSource
    control_dt: Fraction
    duration: Fraction
    observations: tuple[Observation, ...]
    actions: tuple[Action, ...]
    rewards: Mapping[str, Reward] = field(default_factory=dict[str, Reward])
    commands: Mapping[str, Command] = field(default_factory=dict[str, Command])
    terminations: Mapping[str, Termination] = field(default_factory=dict[str, Termination])
    reset: Reset = field(default_factory=Reset)
    derived: str = CURRENT
    ctrl_noise: float | None = None
    ctrl_noise_time: float | None = None
    push: tuple[Push, ...] = ()
    path: Path | None = None
    name: str = ""
    places: Places | None = field(default=None, compare=False, repr=False)

    def __init__(
        self,
        model: ModelSource | mujoco.MjModel | str | Path,
        *,
        control_dt: float | str | Fraction,
        duration: float | str | Fraction,
        observations: Sequence[Observation],
        actions: Sequence[Action],
        rewards: Mapping[str, Reward | str] = NO_REWARDS,
        commands: Mapping[str, Command] = NO_COMMANDS,
        terminations: Mapping[str, Termination] = NO_TERMINATIONS,
        reset: Reset | None = None,
        derived: str = CURRENT,
        ctrl_noise: float | None = None,
        ctrl_noise_time: float | None = None,
        push: Push | str | Mapping[str, object] | Sequence[Push | str | Mapping[str, object]] = (),
        path: Path | None = None,
        name: str = "",
        places: Places | None = None,
        overrides: Sequence[object] = (),
    ) -> None:
        disturbances = _TaskDisturbances(ctrl_noise=ctrl_noise, ctrl_noise_time=ctrl_noise_time, push=push)
        values: dict[str, object] = {
            "model": source_of(model),
            "control_dt": _seconds("control_dt", control_dt),
            "duration": _seconds("duration", duration),
            "observations": tuple(observations),
            "actions": tuple(actions),
            "rewards": {name: Reward(value=each) if isinstance(each, str) else each for name, each in rewards.items()},
            "commands": dict(commands),
            "terminations": dict(terminations),
            "reset": reset or Reset(),
            "derived": derived,
            "ctrl_noise": disturbances.ctrl_noise,
            "ctrl_noise_time": disturbances.ctrl_noise_time,
            "push": disturbances.push,
            "path": path,
            "name": name,
            "places": places,
            "overrides": tuple(overrides),
        }
        for attribute, value in values.items():
            object.__setattr__(self, attribute, value)
        self._check()

    def __hash__(self) -> int:
        return hash((self.model, self.overrides, self.control_dt, self.duration, self.path))

    @property
    def text(self) -> str:
        return self.name or (self.model.text if self.path is None else str(self.path))

    @property
    def stem(self) -> str:
        return self.model.stem if self.path is None else self.path.stem

    @property
    def main_file(self) -> Path | None:
        return self.model.main_file

    @property
    def files(self) -> tuple[Path, ...]:
        own = () if self.path is None else (self.path,)
        return (*self.model.files, *own, *self.tables)

    @property
    def tables(self) -> list[Path]:
        """The tables of commands."""
        return [Path(command.table) for command in self.commands.values() if command.table is not None]

    def stored_at(self, place: Callable[[Path], Path]) -> "Task":
        commands = {
            name: command if command.table is None else replace(command, table=str(place(Path(command.table))))
            for name, command in self.commands.items()
        }
        return replace(self, model=self.model.stored_at(place), commands=commands)

    def with_absolute_paths(self) -> "Task":
        """Returns the same task, which finds the files of its model and its tables from any working directory."""
        return self.stored_at(Path.absolute) if self.main_file else self

    def compile(self) -> tuple[mujoco.MjSpec | None, mujoco.MjModel]:
        return self.model_source.compile()

    @property
    def model_source(self) -> ModelSource:
        """The source of the model alone, with all overrides."""
        return replace(self.model, overrides=(*self.model.overrides, *self.overrides))

    def with_disturbances(self, disturbances: Disturbances) -> "Task":
        """Returns the same task with other noise, if `disturbances` specify any, and additional pushes.

        Raises:
          UsageError: they specify the correlation of noise without any noise.
        """
        if disturbances == NO_DISTURBANCES:
            return self
        noise, time = disturbances.ctrl_noise, disturbances.ctrl_noise_time
        if time is not None and noise is None and not self.ctrl_noise:
            raise UsageError(NOISE_REQUIREMENT.message(), (NOISE_REQUIREMENT.name,))
        return replace(
            self,
            ctrl_noise=self.ctrl_noise if noise is None else noise,
            ctrl_noise_time=self.ctrl_noise_time if time is None else time,
            push=(*self.push, *disturbances.push),
        )

    def located(self) -> ErrorLocator:
        """Reports errors raised within at the positions where the task is written."""
        return ErrorLocator(self.places)

    def control_steps(self, model: mujoco.MjModel) -> int:
        """Returns the number of physics steps in a control period.

        Raises:
          UsageError: the control period is not a whole number of timesteps.
        """
        timestep = rational(model.opt.timestep)
        steps = unrounded(self.control_dt / timestep)
        if steps.denominator != 1:
            message = f"{float(self.control_dt):g} s is {float(steps):g} timesteps of {float(timestep):g} s"
            raise UsageError(f"{option('control_dt')}: {message}; it must be a whole number of them")
        return int(steps)

    @property
    def periods(self) -> int:
        """The most control periods of an episode: the last one ends at or after its duration."""
        return math.ceil(unrounded(self.duration / self.control_dt))

    def _check(self) -> None:
        if self.periods > MOST_PERIODS:
            limit = f"{float(self.duration):g} s exceed the limit of {MOST_PERIODS:,} control periods"
            raise UsageError(f"{option('duration')}: {limit}")
        if self.derived not in DERIVED:
            raise BadValueError(option("derived"), self.derived, f"one of {', '.join(DERIVED)}")
        if not self.observations:
            raise UsageError(f"{option('observations')}: a policy needs at least one observation")
        names: set[str] = set()
        for index, term in enumerate(self.observations):
            with concerning("observations", index, "name"):
                if term.name in names:
                    raise UsageError(f"two observations have the name {quoted(term.name)}")
            names.add(term.name)
            if term.command is not None and term.command not in self.commands:
                with concerning("observations", index, "command"):
                    raise UnknownNameError("command", term.command, list(self.commands))
        for name in RESERVED:
            if name in self.terminations:
                with concerning("terminations", name):
                    raise UsageError(f"{name} is a built-in termination; choose another name")


def _check_random(text: str, place: str, path: tuple[str | int, ...], *, is_number: bool = True) -> None:
    """Checks that `text` is a distribution, or a single value.

    Args:
      place: its name in messages.
      path: the path of the option.
      is_number: whether its values must be numbers.

    Raises:
      UsageError: it is neither.
    """
    try:
        distribution = parse_distribution(text, place)
        if is_number:
            _ = [float(value) for value in (distribution.arguments if distribution else (text,))]
        elif distribution is None and not text.strip():
            raise ValueError
    except UsageError as error:
        error.path = path
        raise
    except ValueError:
        message = f"{place}: {clean(text)} is neither a number nor a distribution such as uniform(-0.1, 0.1)"
        raise UsageError(message, path) from None


def _require_one(term: Observation | Action | Command, names: tuple[str, ...], what: str) -> None:
    """Checks that exactly one of the options `names` is given."""
    given = [name for name in names if is_given(term, name)]
    if len(given) != 1:
        rest = f", not {' and '.join(map(option, given))}" if given else ""
        path = (given[1] if given else names[0],)
        raise UsageError(f"{what} one of {', '.join(map(option, names))}{rest}", path)


def _seconds(name: str, value: float | str | Fraction) -> Fraction:
    try:
        return ExactNumberKind("SECONDS")(value)
    except InvalidValueError as error:
        raise BadValueError(option(name), value, error.expected) from None
