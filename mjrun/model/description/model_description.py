"""The description of a compiled model: a tuple of plain values for each kind of object, computed on demand."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import mujoco

from mjrun.model.description.actuators import actuators
from mjrun.model.description.assets import Asset, assets
from mjrun.model.description.bodies import bodies, geoms, joints, sites
from mjrun.model.description.cameras_lights import cameras, lights
from mjrun.model.description.flexes_plugins import flexes, plugins
from mjrun.model.description.keyframes import keyframes
from mjrun.model.description.non_default_settings import Statistics, options, statistics, visual
from mjrun.model.description.sensors import sensors
from mjrun.model.description.summary import ModelSummary, summary
from mjrun.model.description.tendons_constraints import (
    equalities,
    excludes,
    pairs,
    tendons,
)

SECTIONS = (
    *("summary", "bodies", "joints", "geoms", "sites", "actuators", "sensors", "cameras", "lights", "keyframes"),
    *("tendons", "equalities", "pairs", "excludes", "flexes", "plugins", "options", "visual", "statistics", "assets"),
)
T = TypeVar("T")


def _section(describe: Callable[[mujoco.MjModel], Iterable[T]]) -> "cached_property[tuple[T, ...]]":
    """A section with a row for each object."""
    return cached_property(lambda description: tuple(describe(description.model)))


@dataclass(frozen=True)
class ModelDescription:
    """The description of `model`; each section is computed when it is first used.

    Args:
      model: compiled. It is not changed.
      path: of the file that it was compiled from; None of a model that is in memory only.
    """

    model: mujoco.MjModel
    path: Path | None = None

    @cached_property
    def summary(self) -> ModelSummary:
        return summary(self.model, self.path)

    bodies = _section(bodies)
    joints = _section(joints)
    geoms = _section(geoms)
    sites = _section(sites)
    actuators = _section(actuators)
    sensors = _section(sensors)
    cameras = _section(cameras)
    lights = _section(lights)
    keyframes = _section(keyframes)
    tendons = _section(tendons)
    equalities = _section(equalities)
    pairs = _section(pairs)
    excludes = _section(excludes)
    flexes = _section(flexes)
    plugins = _section(plugins)
    options = _section(options)
    visual = _section(visual)

    @cached_property
    def statistics(self) -> Statistics:
        return statistics(self.model)

    @cached_property
    def assets(self) -> tuple[Asset, ...]:
        return assets(self.model, self.path)
