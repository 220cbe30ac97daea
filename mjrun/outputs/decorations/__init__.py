"""Decorations of images: a module of this package draws what the view option of its name requests."""

import pkgutil
from collections.abc import Iterable, Sequence
from importlib import import_module
from typing import Protocol

import mujoco
import numpy as np

from mjrun.options.option import is_given, options_of
from mjrun.options.rendering import SceneOptions
from mjrun.rendering.added_geoms import Decoration
from mjrun.simulation.simulation import Simulation
from mjrun.timeline import Timeline


class PlannedDecoration(Protocol):
    """Decorations of one option, with every name resolved in the model."""

    @property
    def remarks(self) -> Sequence[str]:
        """Remarks for the user."""
        ...

    def steps(self, timeline: Timeline) -> Sequence[int]:
        """Returns the steps of the observed simulation whose states it needs."""
        ...

    def drawn(self, states: Iterable[np.ndarray], times: Sequence[float]) -> Sequence[Decoration]:
        """Returns the decorations of frames at `times` [s], given the states at `steps`."""
        ...


def planned_decorations(
    options: SceneOptions, model: mujoco.MjModel, simulation: Simulation | None = None
) -> list[PlannedDecoration]:
    """Plans the decorations in `options`, in the order in which the options are declared.

    Args:
      simulation: specifies how tables are read; if None, their columns have mjrun's names.

    Raises:
      UnknownNameError: an object, keyframe or setting is unknown.
      UsageError: a setting is invalid, or a trace lacks positions.
      FileError: a trace cannot be read.
    """
    known = {module.name for module in pkgutil.iter_modules(__path__)}
    names = [each.name for each in options_of(type(options)) if each.name in known and is_given(options, each.name)]
    modules = [import_module(f"{__name__}.{name}") for name in names]
    return [module.planned(options, model, simulation or Simulation(model)) for module in modules]
