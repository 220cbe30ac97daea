"""The description of a task or an environment, number by number: observations, actions, rewards and endings."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UnknownNameError
from mjrun.model.names import names
from mjrun.model.sources.gym import GymSource
from mjrun.model.units import force_unit
from mjrun.options.number_kinds import Numbers
from mjrun.options.task import CONTROL, LAGGED, POSITION, TORQUE, VELOCITY, WORLD
from mjrun.probe.fields import field_probe
from mjrun.task.action_map import ActionMap, DrivenActuator
from mjrun.task.external_environment import TERMINATED, ExternalEnvironment
from mjrun.task.task import TIMED_OUT, Command, Observation, Task
from mjrun.task.worlds import TaskWorlds
from mjrun.timeline import rational

SECTIONS = ("task", "observations", "actions", "commands", "rewards", "terminations", "reset")
BY_ENVIRONMENT = "as the environment says"


@dataclass(frozen=True)
class TaskSummary:
    """A summary of the task as a whole.

    Attributes:
      model: its source.
      timestep, control_dt: [s].
      control_steps: physics steps in a control period.
      duration, periods: time limit of an episode [s], [control periods]; None if unlimited.
      derived: `current` or `lagged`.
      observations, actions: the number of values in each.
    """

    model: str
    timestep: float
    control_dt: float
    control_steps: int
    duration: float | None
    periods: int | None
    derived: str
    observations: int
    actions: int


@dataclass(frozen=True)
class ObservationRow:
    """One number that the policy observes: `clip((source + noise − offset)·scale, low, high)`.

    Attributes:
      index: the index in the observation vector.
      name: the name of the term, and of the number within it.
      source: a column, an expression or a phase.
      unit: the SI unit of the source.
      frame: the body whose axes it is expressed in; empty for the world's.
      noise: its distribution; empty for none.
      offset, scale: the offset [unit] and the scale of the value.
      low, high: None without a limit.
      delay: the delay in control periods, including history.
    """

    index: int
    name: str
    source: str
    unit: str
    frame: str = ""
    noise: str = ""
    offset: float = 0.0
    scale: float = 1.0
    low: float | None = None
    high: float | None = None
    delay: int = 0


@dataclass(frozen=True)
class ActionRow:
    """One number that the policy returns: `target = clip(squash(action), low, high)·scale + offset`.

    Attributes:
      index: the index in the action vector.
      name: the name of the actuator or the joint.
      target: `control`, `position`, `velocity` or `torque`.
      unit: the SI unit of the target.
      squash: `tanh` or `none`.
      low, high: None without a limit.
      scale, offset: the scale [unit] and the offset [unit] of the target.
      kp, kd: gains of a position or velocity target; None for others.
      delay: the delay [control periods].
      actuator: the actuator that the number drives.
      range: the range of its control; None if unlimited.
    """

    index: int
    name: str
    target: str
    unit: str
    squash: str = "none"
    low: float | None = None
    high: float | None = None
    scale: float = 1.0
    offset: float = 0.0
    kp: float | None = None
    kd: float | None = None
    delay: int = 0
    actuator: str = ""
    range: Numbers | None = None


@dataclass(frozen=True)
class CommandRow:
    """A command to the policy.

    Attributes:
      name: its name.
      size: the number of its values.
      source: the source of its values.
    """

    name: str
    size: int
    source: str


@dataclass(frozen=True)
class RewardRow:
    """A term of the reward of a control period.

    Attributes:
      name: its name.
      weight: the factor of its value.
      value: an expression.
    """

    name: str
    weight: float
    value: str


@dataclass(frozen=True)
class TerminationRow:
    """A condition that ends an episode.

    Attributes:
      name: its name.
      kind: the kind of the ending: `success`, `failure` or `timeout`.
      when: the condition.
    """

    name: str
    kind: str
    when: str


@dataclass(frozen=True)
class ResetRow:
    """A part of the initial state: fixed in `key`, `qpos`, `qvel` and `ctrl`, random in `noise`, `set` and `vary`.

    Attributes:
      what: one of these parts.
      name: the keyframe, the name of the object, or the path of the setting.
      value: its values, or their distribution.
    """

    what: str
    name: str
    value: str


@dataclass(frozen=True)
class TaskDescription:
    """A task, section by section.

    Attributes:
      task: the task as a whole.
      observations, actions: the numbers that the policy observes and returns, in order.
      commands: its commands.
      rewards: the terms of its reward.
      terminations: the conditions that end an episode.
      reset: the parts of the initial state.
    """

    task: TaskSummary
    observations: tuple[ObservationRow, ...]
    actions: tuple[ActionRow, ...]
    commands: tuple[CommandRow, ...]
    rewards: tuple[RewardRow, ...]
    terminations: tuple[TerminationRow, ...]
    reset: tuple[ResetRow, ...]

    def document(self, *sections: str) -> dict[str, object]:
        """Returns the named sections, or all without names, as JSON values.

        Raises:
          UnknownNameError: a name is not a section.
        """
        for name in sections:
            if name not in SECTIONS:
                raise UnknownNameError("section", name, SECTIONS)
        whole = asdict(self)
        return {name: whole[name] for name in sections or SECTIONS}


def describe_task(task: Task) -> TaskDescription:
    """Describes `task`, with its names looked up in its model.

    Raises:
      UsageError: a part of it does not fit its model.
      ModelError: the model cannot be loaded.
    """
    worlds = TaskWorlds(task, 1)
    model = worlds.nominal_model
    summary = TaskSummary(
        model=task.model.text,
        timestep=float(rational(model.opt.timestep)),
        control_dt=float(task.control_dt),
        control_steps=worlds.control_steps,
        duration=float(task.duration),
        periods=task.periods,
        derived=task.derived,
        observations=len(worlds.observed),
        actions=len(worlds.action_names),
    )
    return TaskDescription(
        summary,
        tuple(_observations(worlds)),
        tuple(_actions(worlds.actions, model)),
        tuple(
            CommandRow(name, place.stop - place.start, _origin(task.commands[name]))
            for name, place in worlds.commands.slices.items()
        ),
        tuple(RewardRow(name, reward.weight, reward.value) for name, reward in task.rewards.items()),
        tuple(TerminationRow(name, each.as_, each.when) for name, each in task.terminations.items()),
        tuple(_reset(task)),
    )


def describe_environment(source: GymSource) -> TaskDescription:
    """Describes an environment as a task; resets and steps it once, as only a step reports the terms of its reward.

    Raises:
      ModelError, UsageError: as `ExternalEnvironment`.
    """
    environment = ExternalEnvironment(source)
    model, periods = environment.model, environment.episode_steps
    environment.reset(0)
    first = environment.step(
        np.clip(np.zeros_like(environment.action_low), environment.action_low, environment.action_high)
    )
    summary = TaskSummary(
        model=source.text,
        timestep=float(model.opt.timestep),
        control_dt=float(environment.control_dt),
        control_steps=environment.control_steps,
        duration=None if periods is None else float(periods * environment.control_dt),
        periods=periods,
        derived=LAGGED,
        observations=environment.observation_size,
        actions=len(environment.action_names),
    )
    terminations = [TerminationRow(TERMINATED, "failure", BY_ENVIRONMENT)]
    if periods is not None:
        terminations.append(TerminationRow(TIMED_OUT.name, TIMED_OUT.kind, f"after {periods} actions"))
    return TaskDescription(
        summary,
        tuple(_environment_observations(environment)),
        tuple(_environment_actions(environment)),
        (),
        tuple(RewardRow(name, 1.0, BY_ENVIRONMENT) for name in first.reward_terms),
        tuple(terminations),
        (),
    )


def _environment_observations(environment: ExternalEnvironment) -> Iterator[ObservationRow]:
    observed = zip(environment.observation_names, environment.observation_units, strict=True)
    for index, (name, unit) in enumerate(observed):
        yield ObservationRow(index, name, source=name if "/" in name else "", unit=unit)


def _environment_actions(environment: ExternalEnvironment) -> Iterator[ActionRow]:
    model = environment.model
    columns, actuators = field_probe(model, "ctrl").columns, names(model, "actuator")
    are_controls = len(environment.action_names) == model.nu == len(actuators)
    for index, name in enumerate(environment.action_names):
        yield ActionRow(
            index,
            name,
            target=CONTROL,
            unit=columns[index].unit if are_controls else "",
            low=_limit(environment.action_low[index]),
            high=_limit(environment.action_high[index]),
            actuator=actuators[index] if are_controls else "",
            range=control_range(model, index) if are_controls else None,
        )


def _observations(worlds: TaskWorlds) -> Iterator[ObservationRow]:
    terms: Mapping[str, Observation] = {term.name: term for term in worlds.task.observations}
    for index, number in enumerate(worlds.observed):
        term = terms[number.term]
        yield ObservationRow(
            index=index,
            name=number.name,
            source=number.source,
            unit=number.unit,
            frame="" if term.frame == WORLD else term.frame,
            noise=term.noise or "",
            offset=number.offset,
            scale=number.scale,
            low=_limit(number.low),
            high=_limit(number.high),
            delay=number.delay,
        )


def _actions(actions: ActionMap, model: mujoco.MjModel) -> Iterator[ActionRow]:
    actuators = names(model, "actuator")
    for index, driven in enumerate(actions.driven):
        actuator = driven.actuator(model)
        has_gains = driven.target in (POSITION, VELOCITY)
        yield ActionRow(
            index=index,
            name=driven.name,
            target=driven.target,
            unit=_unit(driven, model),
            squash="tanh" if actions.squashed[index] else "none",
            low=_limit(actions.low[index]),
            high=_limit(actions.high[index]),
            scale=float(actions.scale[index]),
            offset=float(actions.offset[index]),
            kp=float(actions.kp[index]) if driven.target == POSITION else None,
            kd=float(actions.kd[index]) if has_gains else None,
            delay=int(actions.delays[index]),
            actuator=actuators[actuator],
            range=control_range(model, driven.control),
        )


def control_range(model: mujoco.MjModel, control: int) -> Numbers | None:
    """Returns the limits of a control, of which an actuator may have several; None if it has none."""
    if not model.actuator_ctrllimited[control]:
        return None
    low, high = map(float, model.actuator_ctrlrange[control])
    return low, high


def _unit(driven: DrivenActuator, model: mujoco.MjModel) -> str:
    if driven.target == CONTROL:
        return field_probe(model, "ctrl").columns[driven.control].unit
    field = "qvel" if driven.target == VELOCITY else "qpos"
    unit = next(column.unit for column in field_probe(model, field).columns if column.id == driven.joint)
    return force_unit(unit) if driven.target == TORQUE else unit


def _limit(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _origin(command: Command) -> str:
    """Returns the source of the values of a command."""
    if command.constant is not None:
        return _spaced(command.constant)
    if command.schedule is not None:
        return ", ".join(f"{_spaced(values)} from {float(time):g} s" for time, values in command.schedule)
    if command.random is not None:
        interval = "in each episode" if command.every is None else f"every {float(command.every):g} s"
        return f"{', '.join(command.random)} {interval}"
    assert command.table is not None
    return f"{command.table} ({command.interpolation})"


def _spaced(values: Numbers) -> str:
    return " ".join(f"{value:g}" for value in values)


def _reset(task: Task) -> Iterator[ResetRow]:
    reset = task.reset
    if reset.key is not None:
        yield ResetRow("key", str(reset.key), "")
    for what, numbers in (("qpos", reset.qpos), ("qvel", reset.qvel), ("ctrl", reset.ctrl)):
        yield from (ResetRow(what, name, _spaced(values)) for name, values in numbers.items())
    for what, drawn in (("noise", reset.noise), ("set", reset.set), ("vary", reset.vary)):
        yield from (ResetRow(what, path, text) for path, text in drawn)
