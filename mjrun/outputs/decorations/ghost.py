"""Ghosts: translucent copies of the model, in another place or motion."""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import mujoco
import numpy as np

from mjrun.camera.targets import Vector
from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean, concerning, option
from mjrun.formats.recording import RecordingReader, is_recording
from mjrun.model import state
from mjrun.model.names import identify
from mjrun.options.number_kinds import PointKind, refuse_loose_coordinate
from mjrun.options.rendering import GHOST_MOTIONS, NO_MAP, SceneOptions
from mjrun.options.schema_validation import InvalidValueError
from mjrun.physics.initial_state import InitialState
from mjrun.physics.kinematic_samples import KinematicMotion
from mjrun.physics.recorded_states import require_model, require_timestep, states_at
from mjrun.rendering.added_geoms import Ghost
from mjrun.rendering.visual import Visual, visual_of
from mjrun.simulation.simulation import Simulation
from mjrun.timeline import Timeline, rational

SETTINGS = ("offset", "opacity", "key", "trace", "recording", "map")
OPACITY = 0.35
FILES = {"trace": "table of a ghost", "recording": "recording of a ghost", "map": "map of a ghost"}  # by setting


@dataclass(frozen=True)
class GhostPlan:
    """A planned ghost, with resolved names. Without keyframe, trace and recording it moves with the model.

    Attributes:
      offset: displacement [m].
      key: id of the keyframe that it shows.
      trace: the table that it follows.
      recording: the recording that it follows.
    """

    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    opacity: float = OPACITY
    key: int | None = None
    trace: KinematicMotion | None = None
    recording: RecordingReader | None = None

    def states(self, model: mujoco.MjModel, times: Sequence[float]) -> list[np.ndarray] | None:
        """Returns its integration states at `times` [s], or one for all times; None if it moves with the model."""
        data = mujoco.MjData(model)
        if self.key is not None:
            mujoco.mj_resetDataKeyframe(model, data, self.key)
            return [state.save(model, data)]
        if self.recording is not None:
            return states_at(self.recording, rational(model.opt.timestep), times)
        return None if self.trace is None else [self.trace.state_at(time) for time in times]


@dataclass(frozen=True)
class PlannedGhosts:
    """Ghosts with resolved names."""

    model: mujoco.MjModel
    visual: Visual
    ghosts: Sequence[GhostPlan]

    @property
    def remarks(self) -> list[str]:
        """Remarks about the tables that ghosts follow."""
        traces = [ghost.trace for ghost in self.ghosts if ghost.trace]
        return list(dict.fromkeys(text for trace in traces for text in trace.position_remarks))

    def steps(self, timeline: Timeline) -> Sequence[int]:
        return ()

    def drawn(self, states: Iterable[np.ndarray], times: Sequence[float]) -> list[Ghost]:
        return [
            Ghost(self.model, ghost.states(self.model, times), ghost.offset, ghost.opacity, visual=self.visual)
            for ghost in self.ghosts
        ]


def ghost_files(options: SceneOptions) -> list[tuple[str, str]]:
    """Returns the files that the ghosts follow, each with its role."""
    parts = [part.partition("=") for text in options.ghost for part in text.split(",")]
    files = [(name, value) for name, _, value in parts if name in FILES and value]
    return [(FILES[name], value) for name, value in files if not (name == "map" and value == NO_MAP)]


def planned(options: SceneOptions, model: mujoco.MjModel, simulation: Simulation) -> PlannedGhosts:
    """Resolves the settings of the ghosts, and opens the files that they follow."""
    ghosts: list[GhostPlan] = []
    for index, text in enumerate(options.ghost):
        with concerning("ghost", index):
            ghosts.append(_ghost(text, model, simulation))
    return PlannedGhosts(model, visual_of(options), ghosts)


def _ghost(text: str, model: mujoco.MjModel, simulation: Simulation) -> GhostPlan:
    settings: dict[str, str] = {}
    for part in filter(None, text.split(",")):
        name, equals, value = part.partition("=")
        if name not in SETTINGS:
            refuse_loose_coordinate(name, option("ghost"))
            meant = [f"{kind}={name}" for kind in ("trace", "recording")] if Path(name).suffix and not equals else []
            raise UnknownNameError("setting", name, SETTINGS, where=option("ghost"), meant=meant)
        if not equals or not value or name in settings:
            raise UsageError(f"{option('ghost')}: write {clean(name)}=VALUE once")
        settings[name] = value
    motions = [name for name in GHOST_MOTIONS if name in settings]
    if len(motions) > 1:
        raise UsageError(f"{option('ghost')}: {' and '.join(motions)} exclude each other: each sets the motion")
    if "map" in settings and "trace" not in settings:
        raise UsageError(f"{option('ghost')}: map requires trace=FILE, the table that it describes")
    return GhostPlan(
        offset=_offset(settings.get("offset", "0/0/0")),
        opacity=_opacity(settings.get("opacity", str(OPACITY))),
        key=_keyframe(settings["key"], model) if "key" in settings else None,
        trace=_trace(Path(settings["trace"]), settings.get("map"), model, simulation) if "trace" in settings else None,
        recording=_recording(Path(settings["recording"]), model) if "recording" in settings else None,
    )


def _keyframe(name: str, model: mujoco.MjModel) -> int:
    """Returns the id of a keyframe.

    Raises:
      UnknownNameError: the model has no such keyframe.
      ModelError: the keyframe is not finite.
    """
    index = identify(model, "keyframe", name)
    InitialState(key=name).data(model)
    return index


def _offset(text: str) -> Vector:
    try:
        return PointKind().parse(text)
    except InvalidValueError:
        raise BadValueError(f"{option('ghost')} offset", text, "a displacement x/y/z [m]") from None


def _opacity(text: str) -> float:
    try:
        opacity = float(text)
    except ValueError:
        opacity = math.nan
    if not 0 < opacity <= 1:
        raise BadValueError(f"{option('ghost')} opacity", text, "a number above 0 and up to 1")
    return opacity


def _trace(path: Path, map_file: str | None, model: mujoco.MjModel, simulation: Simulation) -> KinematicMotion:
    """Reads the motion in a table, with its separate map or else that of the simulation."""
    if is_recording(path) and path.exists():
        raise UsageError(f"{clean(str(path))} is a recording, not a table: write recording= instead of trace=")
    texts = None if map_file is None else [] if map_file == NO_MAP else [f"@{map_file}"]
    return simulation.motion(path, model, texts)


def _recording(path: Path, model: mujoco.MjModel) -> RecordingReader:
    recording = RecordingReader(path)
    require_model(model, recording, recording.facts)
    require_timestep(model, recording)
    return recording
