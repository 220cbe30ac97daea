"""The description of a compiled model: a tuple of plain values for each kind of object, computed on demand."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import mujoco

from mjrun.model.description.actuators import Actuator, actuators
from mjrun.model.description.assets import Asset, assets
from mjrun.model.description.bodies import Body, Geom, Joint, Site, bodies, geoms, joints, sites
from mjrun.model.description.cameras_lights import Camera, Light, cameras, lights
from mjrun.model.description.flexes_plugins import Flex, Plugin, flexes, plugins
from mjrun.model.description.keyframes import Keyframe, keyframes
from mjrun.model.description.non_default_settings import NonDefaultSetting, Statistics, options, statistics, visual
from mjrun.model.description.sensors import Sensor, sensors
from mjrun.model.description.summary import ModelSummary, summary
from mjrun.model.description.tendons_constraints import (
    ContactPair,
    Equality,
    Exclude,
    Tendon,
    equalities,
    excludes,
    pairs,
    tendons,
)

SECTIONS = (
    *("summary", "bodies", "joints", "geoms", "sites", "actuators", "sensors", "cameras", "lights", "keyframes"),
    *("tendons", "equalities", "pairs", "excludes", "flexes", "plugins", "options", "visual", "statistics", "assets"),
)


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

    @cached_property
    def bodies(self) -> tuple[Body, ...]:
        return bodies(self.model)

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        return joints(self.model)

    @cached_property
    def geoms(self) -> tuple[Geom, ...]:
        return geoms(self.model)

    @cached_property
    def sites(self) -> tuple[Site, ...]:
        return sites(self.model)

    @cached_property
    def actuators(self) -> tuple[Actuator, ...]:
        return actuators(self.model)

    @cached_property
    def sensors(self) -> tuple[Sensor, ...]:
        return sensors(self.model)

    @cached_property
    def cameras(self) -> tuple[Camera, ...]:
        return cameras(self.model)

    @cached_property
    def lights(self) -> tuple[Light, ...]:
        return lights(self.model)

    @cached_property
    def keyframes(self) -> tuple[Keyframe, ...]:
        return keyframes(self.model)

    @cached_property
    def tendons(self) -> tuple[Tendon, ...]:
        return tendons(self.model)

    @cached_property
    def equalities(self) -> tuple[Equality, ...]:
        return equalities(self.model)

    @cached_property
    def pairs(self) -> tuple[ContactPair, ...]:
        return pairs(self.model)

    @cached_property
    def excludes(self) -> tuple[Exclude, ...]:
        return excludes(self.model)

    @cached_property
    def flexes(self) -> tuple[Flex, ...]:
        return flexes(self.model)

    @cached_property
    def plugins(self) -> tuple[Plugin, ...]:
        return plugins(self.model)

    @cached_property
    def options(self) -> tuple[NonDefaultSetting, ...]:
        return options(self.model)

    @cached_property
    def visual(self) -> tuple[NonDefaultSetting, ...]:
        return visual(self.model)

    @cached_property
    def statistics(self) -> Statistics:
        return statistics(self.model)

    @cached_property
    def assets(self) -> tuple[Asset, ...]:
        return assets(self.model, self.path)
