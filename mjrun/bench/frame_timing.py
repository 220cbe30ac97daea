"""The wall time of a frame: scene update, drawing, reading back, composing; and of its encoding."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from pathlib import Path

import mujoco
import numpy as np

from mjrun.bench.rollout_timing import Clock
from mjrun.bench.statistics import Stat, stat
from mjrun.formats.codecs import encoding
from mjrun.formats.video import FilmWriter
from mjrun.job.view import Drawing, painter
from mjrun.model.mujoco_globals import without_timers
from mjrun.rendering.backend import Backend
from mjrun.rendering.compositor import Overlay, SceneCompositor, Stream
from mjrun.rendering.timed_renderers import DRAW, READ, TIMED, UPDATE, Stopwatch

FEW, MOST = 7, 30  # frames that are timed, after the first
FPS = Fraction(30)
FILMS, ROUNDS = 3, 4  # films that are encoded, and how often each has every frame
COMPOSE = "compose"


@dataclass(frozen=True)
class Frame:
    """What a frame costs; wall times in seconds.

    Attributes:
      view, size, renderer, quality: of what.
      device: who drew, by its own name.
      software: whether a CPU drew.
      first: the first frame, which compiles shaders.
      update, draw, read, compose: derived fields and scene; drawing until it is done; pixels back in memory, and what
        is made of them; the film's frame made of that. None where a renderer does not tell them apart.
      total: all of these.
      encode: per frame of a film as `mjrun video` encodes it by default, while nothing is drawn; from when the encoder
        has taken the first frame to its end.
    """

    view: str
    size: tuple[int, int]
    renderer: str
    quality: str
    device: str
    software: bool
    first: float
    update: Stat
    draw: Stat
    read: Stat | None
    compose: Stat
    total: Stat
    encode: Stat


def timed_frames(
    job: Drawing, model: mujoco.MjModel, backend: Backend, states: Sequence[np.ndarray], budget: float, clock: Clock
) -> Frame:
    """Draws `states` one after the other, again and again, and encodes them.

    Args:
      job: one camera and one view.
      budget: wall time that may be spent on drawing [s]; a few frames are drawn in any case.

    Raises:
      RendererError: it cannot be drawn.
      UsageError: it cannot be drawn in that size.
    """
    job.check(model, backend)
    watch, (course,) = Stopwatch(clock), job.courses(model)
    (stream,) = job.streams(with_legend=False, overlay=Overlay())
    drawn = painter(job, model, backend, [stream], [(course.pose(state),) for state in states])
    drawn.renderer = partial(TIMED[job.renderer], watch=watch)
    try:
        with without_timers():
            drawn.open()
            spans, frames = _spans(drawn, watch, states, budget)
    finally:
        drawn.close()
    first, *rest = spans
    parts = {name: [span.get(name, 0.0) for span in rest] for name in (UPDATE, DRAW, READ, COMPOSE)}
    return Frame(
        view=job.views[0],
        size=job.size,
        renderer=job.renderer,
        quality=job.visual.quality,
        device=backend.renderer,
        software=backend.software,
        first=sum(first.values()),
        update=stat(parts[UPDATE]),
        draw=stat(parts[DRAW]),
        read=stat(parts[READ]) if READ in first else None,
        compose=stat(parts[COMPOSE]),
        total=stat([sum(span.values()) for span in rest]),
        encode=_encoded(stream, frames, job.views[0], clock),
    )


def _spans(
    drawn: SceneCompositor, watch: Stopwatch, states: Sequence[np.ndarray], budget: float
) -> tuple[list[dict[str, float]], list[np.ndarray]]:
    """What each part of each frame took [s], and a frame of each state that was drawn."""
    if any(panel.view == "depth" for stream in drawn.streams for panel in stream.panels) and not drawn.ranges:
        drawn.look_ahead(dict(enumerate(states[:1])))
    spans: list[dict[str, float]] = []
    frames: list[np.ndarray] = []
    while len(spans) <= FEW or (len(spans) <= MOST and sum(sum(span.values()) for span in spans) < budget):
        index = len(spans) % len(states)
        room = np.empty(drawn.bytes, np.uint8)
        watch.spent = {}
        with watch.part(COMPOSE):
            drawn.paint(states[index], index, room)
        spans.append(watch.spent)
        if len(frames) < len(states):
            frames.append(drawn.parts(room)[0])
    return spans, frames


def _encoded(stream: Stream, frames: Sequence[np.ndarray], view: str, clock: Clock) -> Stat:
    """Wall time to encode a frame [s], a sample for each film."""
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "film.mp4")
        return stat([_film(path, stream, [*frames] * ROUNDS, view, clock) for _ in range(FILMS)])


def _film(path: str, stream: Stream, frames: Sequence[np.ndarray], view: str, clock: Clock) -> float:
    """Wall time of a film by the frame [s], without that to start the encoder."""
    coded = encoding(path, None, None, None, None, "ids" if view == "seg" else "film")
    first, *rest = frames
    with FilmWriter(path, coded, stream.size_of_frame, FPS, count=len(frames)) as film:
        film.write(first)
        before = clock()
        for frame in rest:
            film.write(frame)
        film.end()  # nobody will see it
        return (clock() - before) / len(frames)
