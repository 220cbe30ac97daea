"""Trails and ghosts, which are added to the pictures of a simulation."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import mujoco
import numpy as np

from mjrun.camera.targets import identify_objects
from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean, concerning, listing, option
from mjrun.formats.recording_reader import RecordingReader
from mjrun.formats.recording_writer import SUFFIX
from mjrun.formats.table_reader import read_table
from mjrun.job.view import visual_of
from mjrun.model import state
from mjrun.model.names import identify
from mjrun.options.view import ViewOptions
from mjrun.probe.fields import field_probe
from mjrun.rendering.decorations import LIMIT, Decoration, Ghost, trails
from mjrun.rendering.visual import Visual
from mjrun.sim.replay import require_model, require_timestep, states_at
from mjrun.timeline import Timeline, rational

SETTINGS = ("offset", "opacity", "key", "trace", "recording")
MOTIONS = SETTINGS[2:]  # each says how a ghost moves
OPACITY = 0.35
TRAIL_RATE = Fraction(240)  # [Hz], of the positions on a trail
DRAFT_LIMIT = 150  # capsules of a trail in a draft
TIME_TOLERANCE = 1e-3  # of the time between rows: a table's times may be sums of floats


@dataclass(frozen=True)
class GhostPlan:
    """A ghost, with every name found. Without keyframe, trace and recording it moves as the model does.

    Attributes:
      offset: how far it is displaced [m].
      key: id of the keyframe whose pose it keeps.
      trace: times `(n,)` [s] and positions `(n, nq)` that it follows.
      recording: whose states it follows.
    """

    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    opacity: float = OPACITY
    key: int | None = None
    trace: tuple[np.ndarray, np.ndarray] | None = None
    recording: RecordingReader | None = None

    def states(self, model: mujoco.MjModel, times: Sequence[float]) -> list[np.ndarray] | None:
        """Its integration states at `times` [s], or one for all; None if it moves as the model does."""
        data = mujoco.MjData(model)
        if self.key is not None:
            mujoco.mj_resetDataKeyframe(model, data, self.key)
            return [state.save(model, data)]
        if self.recording is not None:
            return states_at(self.recording, rational(model.opt.timestep), times)
        if self.trace is None:
            return None
        states: list[np.ndarray] = []
        for row in _rows(self.trace[0], np.array(times)):
            data.qpos[:] = self.trace[1][row]
            states.append(state.save(model, data))
        return states


@dataclass(frozen=True)
class SceneDecorations:
    """Trails and ghosts, with every name found.

    Attributes:
      trail_objects: kinds and ids of the objects with a trail.
      trail_span: how much of the past a trail shows [s]; None: all.
    """

    model: mujoco.MjModel
    visual: Visual
    trail_objects: Sequence[tuple[str, int]]
    trail_span: float | None
    ghosts: Sequence[GhostPlan]

    def trail_steps(self, timeline: Timeline) -> Sequence[int]:
        """The steps at which trails need positions: frames of a video are too far apart for fast spins."""
        if not self.trail_objects:
            return []
        return timeline.rows(rate=TRAIL_RATE) if timeline.steps else [0]

    def decorations(self, trail_states: Iterable[np.ndarray], times: Sequence[float]) -> list[Decoration]:
        """What is added to frames at `times` [s], given the states at `trail_steps`."""
        added: list[Decoration] = []
        if self.trail_objects:
            limit = DRAFT_LIMIT if self.visual.quality == "draft" else LIMIT
            added += trails(self.model, self.trail_objects, trail_states, np.array(times), self.trail_span, limit=limit)
        for ghost in self.ghosts:
            states = ghost.states(self.model, times)
            added.append(Ghost(self.model, states, ghost.offset, ghost.opacity, visual=self.visual))
        return added


def scene_decorations(options: ViewOptions, model: mujoco.MjModel) -> SceneDecorations:
    """The trails and ghosts in `options`.

    Raises:
      UnknownNameError: an object, keyframe or setting that is not there.
      UsageError: a setting that cannot be, or a trace that lacks positions.
      FileError: a trace that cannot be read.
    """
    span = None if options.trail_span is None else float(options.trail_span)
    objects: dict[tuple[str, int], None] = {}
    for index, text in enumerate(options.trail):
        with concerning("trail", index):
            objects |= dict.fromkeys(identify_objects(text, model))
    ghosts: list[GhostPlan] = []
    for index, text in enumerate(options.ghost):
        with concerning("ghost", index):
            ghosts.append(_ghost(text, model))
    return SceneDecorations(model, visual_of(options), list(objects), span, ghosts)


def _ghost(text: str, model: mujoco.MjModel) -> GhostPlan:
    settings: dict[str, str] = {}
    for part in filter(None, text.split(",")):
        name, equals, value = part.partition("=")
        if name not in SETTINGS:
            raise UnknownNameError("setting", name, SETTINGS, where=option("ghost"))
        if not equals or not value or name in settings:
            raise UsageError(f"{option('ghost')}: write {clean(name)}=VALUE, once")
        settings[name] = value
    motions = [name for name in MOTIONS if name in settings]
    if len(motions) > 1:
        raise UsageError(f"{option('ghost')}: {' and '.join(motions)} exclude each other: each says how it moves")
    return GhostPlan(
        offset=_offset(settings.get("offset", "0/0/0")),
        opacity=_opacity(settings.get("opacity", str(OPACITY))),
        key=identify(model, "keyframe", settings["key"]) if "key" in settings else None,
        trace=_trace(Path(settings["trace"]), model) if "trace" in settings else None,
        recording=_recording(Path(settings["recording"]), model) if "recording" in settings else None,
    )


def _offset(text: str) -> tuple[float, float, float]:
    try:
        x, y, z = map(float, text.split("/"))
    except ValueError:
        x = y = z = math.nan
    if not all(map(math.isfinite, (x, y, z))):
        raise BadValueError(f"{option('ghost')} offset", text, "a displacement x/y/z [m]")
    return x, y, z


def _opacity(text: str) -> float:
    try:
        opacity = float(text)
    except ValueError:
        opacity = math.nan
    if not 0 < opacity <= 1:
        raise BadValueError(f"{option('ghost')} opacity", text, "a number above 0 and up to 1")
    return opacity


def _trace(path: Path, model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    """Times and positions in a table such as a trace."""
    names = [clean(column.name) for column in field_probe(model, "qpos").columns]
    table = read_table(path, lambda name: clean(name) in ("time", *names))
    columns = {clean(name): values for name, values in table.columns.items()}
    missing = [name for name in ("time", *names) if name not in columns]
    if missing and path.suffix.lower() == SUFFIX and not set(names) & set(columns):
        raise UsageError(f"{clean(str(path))} is not a trace; if it is a recording, write recording= instead of trace=")
    if missing:
        raise UsageError(f"{clean(str(path))} lacks columns that a ghost of this model needs: {listing(missing)}")
    time = columns["time"]
    positions = np.column_stack([np.empty((len(time), 0)), *(columns[name] for name in names)])
    if not len(time) or not (np.diff(time) > 0).all() or not np.isfinite(positions).all():
        raise UsageError(f"{clean(str(path))}: a ghost needs rows of finite numbers, in order of time")
    return time, positions


def _recording(path: Path, model: mujoco.MjModel) -> RecordingReader:
    recording = RecordingReader(path)
    require_model(model, recording, recording.facts.get("sizes"))
    require_timestep(model, recording)
    return recording


def _rows(time: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The last row of a table at each of the times `at`; the first before it begins."""
    tolerance = TIME_TOLERANCE * float(np.diff(time).min()) if len(time) > 1 else 0.0
    return np.clip(np.searchsorted(time, at + tolerance, side="right") - 1, 0, len(time) - 1)
