"""The wall time of a frame: updating the scene, drawing, reading back, composing, and encoding."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial

import mujoco
import numpy as np

from mjrun.bench.reference_workload import ReferenceWorkload
from mjrun.bench.rollout_timing import Clock
from mjrun.bench.statistics import SampleStatistics, summarized
from mjrun.formats.codecs import encoding
from mjrun.formats.temporary_output import scratch_folder
from mjrun.formats.video_writer import VideoWriter
from mjrun.model.mujoco_globals import without_timers
from mjrun.options.view import ViewOptions
from mjrun.outputs.frames import camera_motions, check_drawing, scene_compositor
from mjrun.outputs.panel_files import panel_files
from mjrun.platform.cores import available_cores
from mjrun.rendering.backend import Backend
from mjrun.rendering.compositor import FrameStream, Overlay, SceneCompositor
from mjrun.rendering.timed_renderers import DRAW, READ, TIMED, UPDATE, Stopwatch

LEAST, MOST = 7, 30  # frames that are timed, after the first
FPS = Fraction(30)
VIDEOS, ROUNDS = 3, 4  # videos that are encoded, and how often each has every frame
COMPOSE = "compose"


@dataclass(frozen=True)
class FrameTiming:
    """Wall time of a frame [s].

    Attributes:
      view, size, renderer, quality: what was drawn, and how.
      device: what drew, by its own name.
      software: whether that is the processor.
      first: the first frame, which compiles shaders.
      update, draw, read, compose: derived fields and scene; drawing until it is done; reading pixels back and
        converting them; making the frame of a video of them. None where a renderer does not tell them apart.
      total: all of these.
      reference_workload: wall time per step of the reference workload, on all cores, after each frame; None where a GPU
        draws, whose speed it does not share.
      encode: per frame of a video as `mjrun video` encodes it by default, while nothing is drawn; from when the encoder
        has taken the first frame to its end.
    """

    view: str
    size: tuple[int, int]
    renderer: str
    quality: str
    device: str
    software: bool
    first: float
    update: SampleStatistics
    draw: SampleStatistics
    read: SampleStatistics | None
    compose: SampleStatistics
    total: SampleStatistics
    reference_workload: SampleStatistics | None
    encode: SampleStatistics


def timed_frames(
    drawing: ViewOptions,
    model: mujoco.MjModel,
    backend: Backend,
    states: Sequence[np.ndarray],
    budget: float,
    clock: Clock,
) -> FrameTiming:
    """Draws `states` one after the other, again and again, and encodes them.

    Args:
      drawing: one camera and one view.
      budget: wall time that may be spent on drawing [s]; a few frames are drawn in any case.

    Raises:
      RendererError: it cannot be drawn.
      UsageError: it cannot be drawn in that size.
    """
    check_drawing(drawing, model, backend)
    watch, (motion,) = Stopwatch(clock), camera_motions(drawing, model)
    (stream,) = (file.stream(drawing, Overlay()) for file in panel_files(drawing, "drawing"))
    compositor = scene_compositor(drawing, model, backend, [stream], [(motion.pose(state),) for state in states])
    compositor.renderer = partial(TIMED[drawing.renderer], watch=watch)
    workload = ReferenceWorkload(clock, available_cores()) if backend.software else None

    try:
        with without_timers():
            compositor.open()
            costs, frames = _drawn(compositor, watch, states, budget, workload)
    finally:
        compositor.close()

    first, *rest = costs
    parts = {name: [cost.get(name, 0.0) for cost in rest] for name in (UPDATE, DRAW, READ, COMPOSE)}
    return FrameTiming(
        view=drawing.view[0],
        size=drawing.size,
        renderer=drawing.renderer,
        quality=drawing.quality,
        device=backend.renderer,
        software=backend.software,
        first=sum(first.values()),
        update=summarized(parts[UPDATE]),
        draw=summarized(parts[DRAW]),
        read=summarized(parts[READ]) if READ in first else None,
        compose=summarized(parts[COMPOSE]),
        total=summarized([sum(cost.values()) for cost in rest]),
        reference_workload=workload and workload.step,
        encode=_encoded(stream, frames, drawing.view[0], clock),
    )


def _drawn(
    compositor: SceneCompositor,
    watch: Stopwatch,
    states: Sequence[np.ndarray],
    budget: float,
    workload: ReferenceWorkload | None,
) -> tuple[list[dict[str, float]], list[np.ndarray]]:
    """The wall time of each part of each frame [s], and a frame of each state that was drawn."""
    views = [panel.view for stream in compositor.streams for panel in stream.panels]
    if "depth" in views and not compositor.ranges:
        compositor.look_ahead(dict(enumerate(states[:1])))

    costs: list[dict[str, float]] = []
    frames: list[np.ndarray] = []
    while len(costs) <= LEAST or (len(costs) <= MOST and sum(sum(cost.values()) for cost in costs) < budget):
        index = len(costs) % len(states)
        pixels = np.empty(compositor.bytes, np.uint8)
        watch.spent = {}
        with watch.part(COMPOSE):
            compositor.paint(states[index], index, pixels)
        costs.append(watch.spent)
        if workload:
            _sample_between_frames(workload, costs)
        if len(frames) < len(states):
            frames.append(compositor.parts(pixels)[0])
    return costs, frames


def _sample_between_frames(workload: ReferenceWorkload, costs: Sequence[Mapping[str, float]]) -> None:
    """Times the workload after each frame but the first, by whose successor its length is chosen."""
    if len(costs) == 2:
        workload.fit(sum(costs[-1].values()))
    if len(costs) > 1:
        workload.time()


def _encoded(stream: FrameStream, frames: Sequence[np.ndarray], view: str, clock: Clock) -> SampleStatistics:
    """Wall time to encode a frame [s], a sample for each video."""
    with scratch_folder() as folder:
        path = str(folder / "video.mp4")
        return summarized([_encoded_video(path, stream, [*frames] * ROUNDS, view, clock) for _ in range(VIDEOS)])


def _encoded_video(path: str, stream: FrameStream, frames: Sequence[np.ndarray], view: str, clock: Clock) -> float:
    """Wall time per frame of a video [s], without starting the encoder."""
    coded = encoding(path, None, None, None, None, "ids" if view == "seg" else "video")
    first, *rest = frames
    with VideoWriter(path, coded, stream.size_of_frame, FPS, count=len(frames)) as video:
        video.write(first)
        before = clock()
        for frame in rest:
            video.write(frame)
        video.end()  # it is never published
        return (clock() - before) / len(frames)
