"""Trails of objects, coloured by speed."""

from collections.abc import Iterable, Sequence
from fractions import Fraction

import mujoco
import numpy as np

from mjrun.camera.targets import identify_objects
from mjrun.dataclass import dataclass
from mjrun.errors import concerning
from mjrun.options.rendering import SceneOptions
from mjrun.rendering.added_geoms import LIMIT, Trail, trails
from mjrun.simulation.simulation import Simulation
from mjrun.timeline import Timeline

RATE = Fraction(240)  # [Hz], the sampling rate of positions on a trail
DRAFT_LIMIT = 150  # maximum number of capsules of a trail in a draft


@dataclass(frozen=True)
class PlannedTrails:
    """Trails with resolved names.

    Attributes:
      objects: kinds and ids of the objects with a trail.
      span: the length of the past that a trail shows [s]; None for all of it.
      limit: the maximum number of capsules of a trail.
    """

    model: mujoco.MjModel
    objects: Sequence[tuple[str, int]]
    span: float | None
    limit: int
    remarks: Sequence[str] = ()

    def steps(self, timeline: Timeline) -> Sequence[int]:
        """Returns the steps at which trails need positions: the frames of a video are too far apart for fast spins."""
        return timeline.rows(rate=RATE) if timeline.steps else [0]

    def drawn(self, states: Iterable[np.ndarray], times: Sequence[float]) -> list[Trail]:
        return trails(self.model, self.objects, states, np.array(times), self.span, limit=self.limit)


def planned(options: SceneOptions, model: mujoco.MjModel, simulation: Simulation) -> PlannedTrails:
    """Resolves the objects of the trails."""
    span = None if options.trail_span is None else float(options.trail_span)
    objects: dict[tuple[str, int], None] = {}
    for index, text in enumerate(options.trail):
        with concerning("trail", index):
            objects |= dict.fromkeys(identify_objects(text, model))
    return PlannedTrails(model, list(objects), span, DRAFT_LIMIT if options.quality == "draft" else LIMIT)
