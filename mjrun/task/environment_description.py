"""What an environment of Gymnasium's is as a task, number by number, as far as it tells."""

import math

import numpy as np

from mjrun.model.names import names
from mjrun.model.sources.gym import GymSource
from mjrun.options.task import CONTROL, LAGGED
from mjrun.probe.fields import field_probe
from mjrun.task.description import (
    ActionRow,
    ObservationRow,
    RewardRow,
    TaskDescription,
    TaskSummary,
    TerminationRow,
    control_range,
)
from mjrun.task.gymnasium import TERMINATED, Environment
from mjrun.task.terms import TIMED_OUT

SAYS_SO = "as the environment says"


def describe_environment(source: GymSource) -> TaskDescription:
    """The environment as a task. It is reset and stepped once, since it tells the terms of its reward only then.

    Raises:
      ModelError, UsageError: as `Environment`.
    """
    environment = Environment(source)
    model, periods = environment.model, environment.episode_steps
    environment.reset(0)
    first = environment.step(np.clip(np.zeros_like(environment.action_low), *_bounds(environment)))
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
    terminations = [TerminationRow(TERMINATED, "failure", SAYS_SO)]
    if periods is not None:
        terminations.append(TerminationRow(TIMED_OUT.name, TIMED_OUT.kind, f"after {periods} actions"))
    return TaskDescription(
        summary,
        tuple(_observations(environment)),
        tuple(_actions(environment)),
        (),
        tuple(RewardRow(name, 1.0, SAYS_SO) for name in first.reward_terms),
        tuple(terminations),
        (),
    )


def _observations(environment: Environment) -> list[ObservationRow]:
    observed = zip(environment.observation_names, environment.observation_units, strict=True)
    return [
        ObservationRow(
            index=index,
            name=name,
            source=name if "/" in name else "",
            unit=unit,
            frame="",
            noise="",
            offset=0.0,
            scale=1.0,
            low=None,
            high=None,
            delay=0,
        )
        for index, (name, unit) in enumerate(observed)
    ]


def _actions(environment: Environment) -> list[ActionRow]:
    model, low, high = environment.model, *_bounds(environment)
    columns, actuators = field_probe(model, "ctrl").columns, names(model, "actuator")
    controls = len(environment.action_names) == model.nu == len(actuators)
    return [
        ActionRow(
            index=index,
            name=name,
            target=CONTROL,
            unit=columns[index].unit if controls else "",
            squash="none",
            low=float(low[index]) if math.isfinite(low[index]) else None,
            high=float(high[index]) if math.isfinite(high[index]) else None,
            scale=1.0,
            offset=0.0,
            kp=None,
            kd=None,
            actuator=actuators[index] if controls else "",
            range=control_range(model, index) if controls else None,
        )
        for index, name in enumerate(environment.action_names)
    ]


def _bounds(environment: Environment) -> tuple[np.ndarray, np.ndarray]:
    return environment.action_low, environment.action_high
