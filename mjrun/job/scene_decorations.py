"""`--trail` and `--ghost`: what is added to the pictures of a simulation."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import mujoco
import numpy as np

from mjrun.camera.targets import identify_objects
from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean, listing
from mjrun.formats.recording_reader import RecordingFile
from mjrun.formats.recording_writer import SUFFIX
from mjrun.formats.table_reader import read_table
from mjrun.model import state
from mjrun.model.names import identify
from mjrun.probe.fields import field_probe
from mjrun.rendering.decorations import LIMIT, Decoration, Ghost, trails
from mjrun.rendering.visual import Visual
from mjrun.sim.replay import require_model, require_timestep, states_at
from mjrun.timeline import Timeline, rational

SETTINGS = ("offset", "opacity", "key", "trace", "recording")
DOES = SETTINGS[2:]  # each says what a ghost does
OPACITY = 0.35
PACE = Fraction(240)  # [Hz], at which the object of a trail is followed
COARSE = 150  # capsules of a trail in a draft
SLACK = 1e-3  # of the time between rows: a table's times may be sums of floats


@dataclass(frozen=True)
class GhostPlan:
    """A ghost that was asked for: where, how clearly, and what it does; the same as the model without key or trace.

    Attributes:
      offset: how far it is displaced [m].
      key: id of the keyframe in whose pose it stands.
      trace: times `(n,)` [s], and positions `(n, nq)`, that it goes through.
      recording: whose states it goes through.
    """

    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    opacity: float = OPACITY
    key: int | None = None
    trace: tuple[np.ndarray, np.ndarray] | None = None
    recording: RecordingFile | None = None

    def states(self, model: mujoco.MjModel, times: Sequence[float]) -> list[np.ndarray] | None:
        """Its integration states at `times` [s], or None if it does what the model does."""
        data = mujoco.MjData(model)
        if self.key is not None:
            mujoco.mj_resetDataKeyframe(model, data, self.key)
            return [state.save(model, data)]
        if self.recording is not None:
            return states_at(self.recording, rational(model.opt.timestep), times)
        if self.trace is None:
            return None
        found = []
        for row in _rows(self.trace[0], np.array(times)):
            data.qpos[:] = self.trace[1][row]
            found.append(state.save(model, data))
        return found


@dataclass(frozen=True)
class SceneDecorations:
    """What is added to pictures, with every name found.

    Attributes:
      followed: kinds and ids of the objects with a trail.
      span: how much of the past a trail shows [s]; None: all.
    """

    model: mujoco.MjModel
    visual: Visual
    followed: Sequence[tuple[str, int]]
    span: float | None
    spirits: Sequence[GhostPlan]

    def steps(self, timeline: Timeline) -> Sequence[int]:
        """The steps at which a trail has to be followed: fast spins are too fast for the frames of a film."""
        return timeline.rows(rate=PACE) if self.followed and timeline.steps else [0] if self.followed else []

    def decors(self, path: Iterable[np.ndarray], times: Sequence[float]) -> list[Decoration]:
        """The decors of a film whose frames are at `times` [s]; `path` holds the states at `steps`."""
        found: list[Decoration] = []
        if self.followed:
            limit = COARSE if self.visual.quality == "draft" else LIMIT
            found += trails(self.model, self.followed, path, np.array(times), self.span, limit=limit)
        for spirit in self.spirits:
            haunting = spirit.states(self.model, times)
            found.append(Ghost(self.model, haunting, spirit.offset, spirit.opacity, visual=self.visual))
        return found


def additions(
    model: mujoco.MjModel, visual: Visual, followed: Sequence[str], span: float | None, ghosts: Sequence[str]
) -> SceneDecorations:
    """What `--trail`, `--trail-span` and `--ghost` ask for.

    Raises:
      UnknownNameError: an object, keyframe or setting that is not there.
      UsageError: a setting that cannot be, or a trace that lacks positions.
      FileError: a trace that cannot be read.
    """
    if span is not None and not 0 < span < math.inf:
        raise BadValueError("--trail-span", span, "a positive number of seconds")
    objects = dict.fromkeys(found for text in followed for found in identify_objects(text, model))
    return SceneDecorations(model, visual, list(objects), span, [_spirit(text, model) for text in ghosts])


def _spirit(text: str, model: mujoco.MjModel) -> GhostPlan:
    settings: dict[str, str] = {}
    for part in filter(None, text.split(",")):
        name, equals, value = part.partition("=")
        if name not in SETTINGS:
            raise UnknownNameError("setting", name, SETTINGS, where="--ghost")
        if not equals or not value or name in settings:
            raise UsageError(f"--ghost: write {clean(name)}=VALUE, once")
        settings[name] = value
    if len(given := [name for name in DOES if name in settings]) > 1:
        raise UsageError(f"--ghost: {' and '.join(given)} exclude each other: each says what it does")
    return GhostPlan(
        offset=_point(settings.get("offset", "0/0/0")),
        opacity=_share(settings.get("opacity", str(OPACITY))),
        key=identify(model, "keyframe", settings["key"]) if "key" in settings else None,
        trace=_trace(Path(settings["trace"]), model) if "trace" in settings else None,
        recording=_recording(Path(settings["recording"]), model) if "recording" in settings else None,
    )


def _point(text: str) -> tuple[float, float, float]:
    try:
        x, y, z = map(float, text.split("/"))
    except ValueError:
        x = y = z = math.nan
    if not all(map(math.isfinite, (x, y, z))):
        raise BadValueError("--ghost offset", text, "a displacement x/y/z [m]")
    return x, y, z


def _share(text: str) -> float:
    try:
        share = float(text)
    except ValueError:
        share = math.nan
    if not 0 < share <= 1:
        raise BadValueError("--ghost opacity", text, "a number above 0 and up to 1")
    return share


def _trace(path: Path, model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    """Times and positions in a table such as a trace."""
    names = [clean(column.name) for column in field_probe(model, "qpos").columns]
    table = read_table(path, lambda name: clean(name) in ("time", *names))
    found = {clean(name): values for name, values in table.columns.items()}
    missing = [name for name in ("time", *names) if name not in found]
    if missing and path.suffix.lower() == SUFFIX and not set(names) & set(found):
        raise UsageError(f"{clean(str(path))} is no trace; if it is a recording, write recording= instead of trace=")
    if missing:
        raise UsageError(f"{clean(str(path))} lacks columns that a ghost of this model takes: {listing(missing)}")
    time, positions = found["time"], np.column_stack([np.empty((len(found["time"]), 0)), *(found[n] for n in names)])
    if not len(time) or not (np.diff(time) > 0).all() or not np.isfinite(positions).all():
        raise UsageError(f"{clean(str(path))}: a ghost takes rows of finite numbers, in order of time")
    return time, positions


def _recording(path: Path, model: mujoco.MjModel) -> RecordingFile:
    recording = RecordingFile(path)
    require_model(model, recording, recording.facts.get("sizes"))
    require_timestep(model, recording)
    return recording


def _rows(time: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The last row of a table at each of the times `at`; the first before it begins."""
    slack = SLACK * float(np.diff(time).min()) if len(time) > 1 else 0.0
    return np.clip(np.searchsorted(time, at + slack, side="right") - 1, 0, len(time) - 1)
