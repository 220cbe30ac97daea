"""`mjrun.load`: a model by its source, compiled."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import mujoco

from mjrun.model.override import Override
from mjrun.model.sources import ModelLike, source_of


def load(
    model: ModelLike,
    *,
    timestep: float | None = None,
    integrator: str | None = None,
    overrides: Mapping[str, str] | Sequence[Override] = (),
) -> mujoco.MjModel:
    """Compiles a model.

    Args:
      model: a file (.xml, .urdf, .mjz, .zip or .mjb), `scene:NAME`, `gym:NAME`, `dm:DOMAIN`, `menagerie:ROBOT/MODEL`,
        or `-` for standard input.
      timestep: [s], instead of the model's own.
      integrator: `euler`, `rk4`, `implicit`, `implicitfast` or `discrete`, instead of the model's own.
      overrides: values by MuJoCo's own names, `{"opt.gravity": "0,0,10", "geom/floor.friction": ".1,.005,.0001"}`.

    Raises:
      ModelError: the model is missing, unreadable, or refused by MuJoCo.
      UsageError: an override names nothing, or its value does not fit.
    """
    by_path = isinstance(overrides, Mapping)
    added = [Override(path, value) for path, value in overrides.items()] if by_path else [*overrides]
    if integrator is not None:
        added.append(Override("opt.integrator", integrator, "integrator"))
    if timestep is not None:
        added.append(Override("opt.timestep", repr(float(timestep)), "timestep"))
    source = source_of(model)
    return replace(source, overrides=(*source.overrides, *added)).load()
