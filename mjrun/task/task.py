"""A task as a value: a model, its episodes, and what a policy observes, does and is rewarded for in them."""

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import Protocol

import mujoco

from mjrun.errors import BadValueError, UnknownNameError, UsageError, concerning, option, quoted
from mjrun.model.source import Source
from mjrun.model.sources import source_of
from mjrun.options.kinds import ExactNumber, ExpectedError
from mjrun.options.task import CURRENT, DERIVED
from mjrun.task.terms import RESERVED, Action, Command, Observation, Reset, Reward, Termination
from mjrun.timeline import rational

MOST_PERIODS = 10_000_000  # control periods of an episode
NO_COMMANDS: Mapping[str, Command] = {}
NO_REWARDS: Mapping[str, Reward] = {}
NO_TERMINATIONS: Mapping[str, Termination] = {}


class Places(Protocol):
    """Where something says what a task is, such as a document."""

    def located(self, error: UsageError) -> UsageError:
        """`error` at the place that it is about."""
        ...


@dataclass(frozen=True)
class Task(Source):
    """A task: what stands where a model stands, and its model, and how episodes of it go.

    Args:
      model: its source.
      control_dt: the control period [s], a whole number of timesteps.
      duration: length of an episode [s].
      observations, actions: in the order in which a policy gets and gives them.
      rewards, commands, terminations: by name; a reward may be an expression alone.
      reset: how episodes start.
      derived: `current` or `lagged`: what is observed of quantities that MuJoCo derives from the state.
      path: of the document that says all this; None if there is none.
      name: that stands for the path, such as `scene:car_drive`; empty if none does.
      places: where it says that.

    Raises:
      UsageError: values that cannot be, or names that stand twice.
    """

    model: Source
    control_dt: Fraction
    duration: Fraction
    observations: tuple[Observation, ...]
    actions: tuple[Action, ...]
    rewards: Mapping[str, Reward] = field(default_factory=dict)
    commands: Mapping[str, Command] = field(default_factory=dict)
    terminations: Mapping[str, Termination] = field(default_factory=dict)
    reset: Reset = field(default_factory=Reset)
    derived: str = CURRENT
    path: Path | None = None
    name: str = ""
    places: Places | None = field(default=None, compare=False, repr=False)

    def __init__(
        self,
        model: Source | mujoco.MjModel | str | Path,
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
        path: Path | None = None,
        name: str = "",
        places: Places | None = None,
        overrides: Sequence[object] = (),
    ) -> None:
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
            "path": path,
            "name": name,
            "places": places,
            "overrides": tuple(overrides),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)
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
        """The tables that commands come from."""
        return [Path(command.table) for command in self.commands.values() if command.table is not None]

    def stored_at(self, place: Callable[[Path], Path]) -> Source:
        commands = {
            name: command if command.table is None else replace(command, table=str(place(Path(command.table))))
            for name, command in self.commands.items()
        }
        return replace(self, model=self.model.stored_at(place), commands=commands)

    def compile(self) -> tuple[mujoco.MjSpec | None, mujoco.MjModel]:
        return self.model_source.compile()

    @property
    def model_source(self) -> Source:
        """The source of the model alone, with all overrides."""
        return replace(self.model, overrides=(*self.model.overrides, *self.overrides))

    @contextmanager
    def located(self) -> Generator[None]:
        """Tells of mistakes in the task where they are written: what looks closer at it does so within.

        Raises:
          UsageError: the one raised within, at its line of the document if there is one.
        """
        try:
            yield
        except UsageError as error:
            located = self.places.located(error) if self.places else error
            if located is error:
                raise
            raise located from error

    def control_steps(self, model: mujoco.MjModel) -> int:
        """How many steps of the physics a control period has.

        Raises:
          UsageError: it is no whole number.
        """
        timestep = rational(model.opt.timestep)
        steps = self.control_dt / timestep
        if steps.denominator != 1:
            message = f"{float(self.control_dt):g} s is {float(steps):g} timesteps of {float(timestep):g} s"
            raise UsageError(f"{option('control_dt')}: {message}; it must be a whole number of them")
        return int(steps)

    @property
    def periods(self) -> int:
        """How many control periods an episode has at most: the last one ends at or after its duration."""
        return -(-self.duration // self.control_dt)

    def _check(self) -> None:
        if self.periods > MOST_PERIODS:
            count = f"{float(self.duration):g} s are more than {MOST_PERIODS:,} control periods"
            raise UsageError(f"{option('duration')}: {count}, which is the most that an episode has")
        if self.derived not in DERIVED:
            raise BadValueError(option("derived"), self.derived, f"one of {', '.join(DERIVED)}")
        if not self.observations:
            raise UsageError(f"{option('observations')}: a policy must observe something")
        names: set[str] = set()
        for index, term in enumerate(self.observations):
            with concerning("observations", index, "name"):
                if term.name in names:
                    raise UsageError(f"two observations are called {quoted(term.name)}")
            names.add(term.name)
            if term.command is not None and term.command not in self.commands:
                with concerning("observations", index, "command"):
                    raise UnknownNameError("command", term.command, list(self.commands))
        for name in RESERVED:
            if name in self.terminations:
                with concerning("terminations", name):
                    raise UsageError(f"{name} is a termination that every task has; call this one otherwise")


def _seconds(name: str, value: float | str | Fraction) -> Fraction:
    try:
        return ExactNumber("SECONDS")(value)
    except ExpectedError as error:
        raise BadValueError(option(name), value, error.expected) from None
