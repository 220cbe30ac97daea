"""The sections of `mjrun info`: where each is in a model's description, and how it is shown."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from mjrun.cli import info_actuators_sensors_cameras as devices
from mjrun.cli import info_constraints, info_kinematics, info_settings_assets, info_summary
from mjrun.cli.table_cells import Column
from mjrun.errors import clean

if TYPE_CHECKING:
    from mjrun.model.description.assets import Asset
    from mjrun.model.description.model_description import ModelDescription

T = TypeVar("T")
Lines = Sequence[tuple[str, str]]  # labels and values


def _has_files(assets: "Sequence[Asset]") -> bool:
    """Whether there are files beside the model's own, which the summary names."""
    return any(asset.path and asset.kind != "model" for asset in assets)


@dataclass(frozen=True)
class TableSection(Generic[T]):
    """A section with a row for each object.

    Attributes:
      rows: the objects.
      columns: of the table.
      is_detail: whether it is shown only when it is asked for.
      is_news: whether the rows tell more than the summary does.
    """

    rows: "Callable[[ModelDescription], Sequence[T]]"
    columns: Callable[[Sequence[T]], list[Column]]
    is_detail: bool = False
    is_news: Callable[[Sequence[T]], bool] = bool


@dataclass(frozen=True)
class LineSection:
    """A section of labelled lines.

    Attributes:
      lines: labels and values.
      title: where that is not the section's name.
      is_detail: whether it is shown only when it is asked for.
    """

    lines: "Callable[[ModelDescription], Lines]"
    title: "Callable[[ModelDescription], str] | None" = None
    is_detail: bool = False


SECTIONS: "Mapping[str, TableSection[Any] | LineSection]" = {
    "summary": LineSection(lambda of: info_summary.summary(of.summary), lambda of: clean(of.summary.name)),
    "bodies": TableSection(lambda of: of.bodies, info_kinematics.bodies),
    "joints": TableSection(lambda of: of.joints, info_kinematics.joints),
    "geoms": TableSection(lambda of: of.geoms, info_kinematics.geoms, is_detail=True),
    "sites": TableSection(lambda of: of.sites, info_kinematics.sites, is_detail=True),
    "actuators": TableSection(lambda of: of.actuators, devices.actuators),
    "sensors": TableSection(lambda of: of.sensors, devices.sensors),
    "cameras": TableSection(lambda of: of.cameras, devices.cameras),
    "lights": TableSection(lambda of: of.lights, devices.lights, is_detail=True),
    "keyframes": TableSection(lambda of: of.keyframes, info_kinematics.keyframes),
    "tendons": TableSection(lambda of: of.tendons, info_constraints.tendons),
    "equalities": TableSection(lambda of: of.equalities, info_constraints.equalities),
    "pairs": TableSection(lambda of: of.pairs, info_constraints.pairs),
    "excludes": TableSection(lambda of: of.excludes, info_constraints.excludes),
    "flexes": TableSection(lambda of: of.flexes, info_constraints.flexes),
    "plugins": TableSection(lambda of: of.plugins, info_settings_assets.plugins),
    "options": TableSection(lambda of: of.options, info_settings_assets.settings),
    "visual": TableSection(lambda of: of.visual, info_settings_assets.settings, is_detail=True),
    "statistics": LineSection(lambda of: info_summary.statistics(of.statistics), is_detail=True),
    "assets": TableSection(lambda of: of.assets, info_settings_assets.assets, is_news=_has_files),
}
