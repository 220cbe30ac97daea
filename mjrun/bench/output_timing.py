"""Wall time of loading a model, of frames, and of whole traces and videos from the model to the finished file."""

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from mjrun.bench.block_timing import Clock, ReferenceWorkloadTimer
from mjrun.bench.statistics import SampleStatistics, summarized
from mjrun.camera.pose import CameraPose
from mjrun.dataclass import dataclass
from mjrun.formats.codecs import encoding
from mjrun.formats.ffmpeg import VideoWriter
from mjrun.formats.temporary_output import scratch_folder
from mjrun.model.camera_images import CameraImages
from mjrun.model.mujoco_globals import without_timers
from mjrun.model.override import apply
from mjrun.model.source import ModelSource, lengthen_buffers, load_respecting_confinement
from mjrun.options.rendering import ViewOptions
from mjrun.options.video import FPS
from mjrun.outputs.camera_panels import panel_files
from mjrun.outputs.frame_drawing import check_drawing, scene_compositor
from mjrun.outputs.recorded_scene import camera_motions
from mjrun.outputs.trace import Trace
from mjrun.outputs.video import Video
from mjrun.platform.cores import available_cores
from mjrun.rendering.backend import WorkingBackend
from mjrun.rendering.classic import ClassicRenderer, SingleSampleFramebuffer
from mjrun.rendering.compositor import FrameSpec, SceneCompositor, TextAndLivePlots
from mjrun.rendering.filament import FilamentRenderer
from mjrun.reporter import PythonApiReporter
from mjrun.simulation.simulation import Simulation
from mjrun.suffixes import XML

UPDATE, DRAW, READ = "update", "draw", "read"
REPEATS = 3  # of loading
LEAST, MOST = 7, 30  # frames that are timed, after the first
VIDEOS, ROUNDS = 3, 4  # videos that are encoded, and repetitions of every frame in each
COMPOSE = "compose"


class Stopwatch:
    """A stopwatch for nested parts, each counted without the parts inside it.

    Attributes:
      spent: time by name of the part [s].
    """

    def __init__(self, clock: Clock) -> None:
        self.spent: dict[str, float] = {}
        self._clock, self._since = clock, 0.0
        self._inside: list[str] = []

    @contextmanager
    def part(self, name: str) -> Generator[None]:
        """Counts the time of the block towards `name`."""
        self._switch()
        self._inside.append(name)
        try:
            yield
        finally:
            self._switch()
            self._inside.pop()

    def _switch(self) -> None:
        now = self._clock()
        if self._inside:
            name = self._inside[-1]
            self.spent[name] = self.spent.get(name, 0.0) + now - self._since
        self._since = now


class TimedClassicRenderer(ClassicRenderer):
    """A classic renderer that waits for OpenGL, which would otherwise still be rendering when the clock is read.

    Attributes:
      watch: counts `update` (derived fields and scene), `draw`, and `read` (pixels and their conversion).
    """

    def __init__(self, *arguments: Any, watch: Stopwatch) -> None:
        self.watch = watch
        super().__init__(*arguments)

    def set_state(self, state: np.ndarray, index: int = 0) -> None:
        with self.watch.part(UPDATE):
            super().set_state(state, index)

    def render(self, pose: CameraPose, views: Sequence[str] = ("rgb",)) -> CameraImages:
        with self.watch.part(READ):
            return super().render(pose, views)

    def _update_scene(self, pose: CameraPose) -> None:
        with self.watch.part(UPDATE):
            super()._update_scene(pose)

    def _render(self) -> None:
        with self.watch.part(DRAW):
            mujoco.mjr_render(self._rect, self._scene, self._context)
            mujoco.mjr_finish()
        mujoco.mjr_readPixels(self._pixels, None, self._rect, self._context)

    def _exact(self, seen: CameraImages, pose: CameraPose, views: Sequence[str]) -> CameraImages:
        if self._buffer is None:
            self._buffer = _TimedBuffer(self.size, self.watch)
        return super()._exact(seen, pose, views)


class _TimedBuffer(SingleSampleFramebuffer):
    def __init__(self, size: tuple[int, int], watch: Stopwatch) -> None:
        super().__init__(size)
        self._gl, self._watch = _TimedReading(self._gl, watch), watch

    def draw(self, scene: mujoco.MjvScene, context: mujoco.MjrContext) -> tuple[np.ndarray, np.ndarray]:
        with self._watch.part(DRAW):
            return super().draw(scene, context)


class _TimedReading:
    """A wrapper of OpenGL that counts reading pixels separately from drawing."""

    def __init__(self, gl: Any, watch: Stopwatch) -> None:
        self._gl, self._watch = gl, watch

    def __getattr__(self, name: str) -> Any:
        return getattr(self._gl, name)

    def glReadPixels(self, *arguments: Any) -> None:  # noqa: N802
        self._gl.glFinish()
        with self._watch.part(READ):
            self._gl.glReadPixels(*arguments)


class TimedFilamentRenderer(FilamentRenderer):
    """A Filament renderer that counts its time. Filament renders an image when it is read, so `draw` covers both.

    Attributes:
      watch: counts `update` and `draw`.
    """

    def __init__(self, *arguments: Any, watch: Stopwatch) -> None:
        self.watch = watch
        super().__init__(*arguments)

    def set_state(self, state: np.ndarray, index: int = 0) -> None:
        with self.watch.part(UPDATE):
            super().set_state(state, index)

    def render(self, pose: CameraPose, views: Sequence[str] = ("rgb",)) -> CameraImages:
        with self.watch.part(DRAW):
            return super().render(pose, views)


TIMED: Mapping[str, Callable[..., Any]] = {"classic": TimedClassicRenderer, "filament": TimedFilamentRenderer}


# --- loading ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class LoadTiming:
    """Wall time to load the model [s].

    Attributes:
      first: total of the first time in this process.
      parse, compile: times from the file to an MjSpec, and from there to an MjModel, repeated with MuJoCo's cache of
        assets warm; None for files other than MJCF and URDF.
    """

    first: float
    parse: SampleStatistics | None = None
    compile: SampleStatistics | None = None


def timed_load(source: ModelSource, clock: Clock) -> tuple[mujoco.MjModel, LoadTiming]:
    """Loads a model, and returns it compiled with the wall time of loading.

    Raises:
      ModelError: the model cannot be loaded.
      UsageError: an override names nothing, or its value does not fit.
    """
    return load_respecting_confinement(lambda: _timed_load(source, clock))


def _timed_load(source: ModelSource, clock: Clock) -> tuple[mujoco.MjModel, LoadTiming]:
    before = clock()
    model = source.load()
    first = clock() - before

    if source.main_file is None or source.main_file.suffix not in XML:
        return model, LoadTiming(first)
    parses, compiles = list[float](), list[float]()
    for _ in range(REPEATS):
        before = clock()
        spec = mujoco.MjSpec.from_file(str(source.main_file))
        parsed = clock()
        for override in source.overrides:
            apply(spec, override)
        lengthen_buffers(spec, source.overrides)
        ready = clock()
        spec.compile()
        compiles.append(clock() - ready)
        parses.append(parsed - before)
    return model, LoadTiming(first, summarized(parses), summarized(compiles))


# --- frames -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class FrameTiming:
    """Wall time of a frame [s].

    Attributes:
      view, size, renderer, quality: options of the drawing.
      device: name of the device that draws.
      software: whether the processor draws.
      first: time of the first frame, which compiles shaders.
      update, draw, read, compose: updating derived fields and the scene; drawing until it is finished; reading and
        converting pixels; composing the frame of a video. None if a renderer does not distinguish them.
      total: sum of these.
      reference_workload: wall time per step of the reference workload, on all cores, after each frame; None if a GPU
        draws, whose speed is independent of it.
      encode: time per frame of a video encoded with the defaults of `mjrun video`, while nothing is drawn; from when
        the encoder has taken the first frame to its end.
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
    backend: WorkingBackend,
    states: Sequence[np.ndarray],
    budget: float,
    clock: Clock,
) -> FrameTiming:
    """Draws `states` one after the other, repeatedly, and encodes them.

    Args:
      drawing: options of one camera and one view.
      budget: approximate wall time of drawing [s]; several frames are drawn in any case.

    Raises:
      RendererError: the renderer failed.
      UsageError: the size is not supported.
    """
    check_drawing(drawing, model, backend)
    watch, (motion,) = Stopwatch(clock), camera_motions(drawing.camera, drawing.size, model)
    (spec,) = (file.frame_spec(drawing, TextAndLivePlots()) for file in panel_files(drawing, "drawing"))
    compositor = scene_compositor(drawing, model, backend, [spec], [(motion.pose(state),) for state in states])
    timed, segmentation = TIMED[drawing.renderer], compositor.segmentation
    workload = ReferenceWorkloadTimer(clock, available_cores()) if backend.software else None

    try:
        with without_timers():
            compositor.use(timed(model, drawing.size, backend, compositor.visual, segmentation, watch=watch))
            costs, frames = _drawn(compositor, watch, states, budget, workload)
    finally:
        compositor.close()

    first, *rest = costs
    with scratch_folder() as folder:
        path = str(folder / "video.mp4")
        encoded = [*frames] * ROUNDS
        encode = summarized([_encoded(path, spec, encoded, drawing.view[0], clock) for _ in range(VIDEOS)])
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
        encode=encode,
    )


def _drawn(
    compositor: SceneCompositor,
    watch: Stopwatch,
    states: Sequence[np.ndarray],
    budget: float,
    workload: ReferenceWorkloadTimer | None,
) -> tuple[list[dict[str, float]], list[np.ndarray]]:
    """Returns the wall time of each part of each frame [s], and a frame of each state that was drawn."""
    views = [panel.view for spec in compositor.specs for panel in spec.panels]
    if "depth" in views and not compositor.ranges:
        compositor.choose_ranges(dict(enumerate(states[:1])))

    costs: list[dict[str, float]] = []
    frames: list[np.ndarray] = []
    while len(costs) <= LEAST or (len(costs) <= MOST and sum(sum(cost.values()) for cost in costs) < budget):
        index = len(costs) % len(states)
        pixels = np.empty(compositor.bytes, np.uint8)
        watch.spent = {}
        with watch.part(COMPOSE):
            compositor.compose(states[index], index, pixels)
        costs.append(watch.spent)
        if workload:
            _sample_between_frames(workload, costs)
        if len(frames) < len(states):
            frames.append(compositor.parts(pixels)[0])
    return costs, frames


def _sample_between_frames(workload: ReferenceWorkloadTimer, costs: Sequence[Mapping[str, float]]) -> None:
    """Times the workload after each frame except the first; the second frame determines its length."""
    if len(costs) == 2:
        workload.fit(sum(costs[-1].values()))
    if len(costs) > 1:
        workload.time()


def _encoded(path: str, spec: FrameSpec, frames: Sequence[np.ndarray], view: str, clock: Clock) -> float:
    """Times the encoding of a video, without starting the encoder, per frame [s]."""
    coded = encoding(path, None, None, None, None, "ids" if view == "seg" else "video")
    first, *rest = frames
    with VideoWriter(path, coded, spec.size_of_frame, FPS, count=len(frames)) as video:
        video.write(first)
        before = clock()
        for frame in rest:
            video.write(frame)
        video.end()  # it is never published
        return (clock() - before) / len(frames)


# --- whole outputs -----------------------------------------------------------------------------------


class _SilentReporter(PythonApiReporter):
    """A reporter that ignores warnings, which `bench` reports itself."""

    def warn(self, text: str) -> None:
        pass


@dataclass(frozen=True)
class EndToEndTiming:
    """Wall time of a whole output, including loading the model but not the start of Python.

    Attributes:
      what: `video` or `trace`.
      simulated: simulated time [s].
      count, unit: number of `frames` or `rows`.
      seconds: wall time [s].
      simulation, rest: wall time of stepping, and of everything else [s]; None for a trace.
    """

    what: str
    simulated: float
    count: int
    unit: str
    seconds: float
    simulation: float | None = None
    rest: float | None = None


def timed_trace(simulation: Simulation, clock: Clock) -> EndToEndTiming:
    """Times a trace of every step, with the default columns, as CSV.

    Raises:
      MjrunError: the trace failed.
    """
    with scratch_folder() as folder:
        trace = Trace(simulation, str(folder / "trace.csv"))
        before = clock()
        result = trace.run(_SilentReporter())
        seconds = clock() - before
    return EndToEndTiming("trace", result.simulated, result.rows, "rows", seconds)


def timed_video(simulation: Simulation, drawing: ViewOptions, clock: Clock) -> EndToEndTiming:
    """Times a video with the options of `drawing`.

    Raises:
      MjrunError: the video failed.
    """
    with scratch_folder() as folder:
        video = replace(
            Video(simulation, str(folder / "video.mp4")),
            camera=drawing.camera,
            view=drawing.view,
            size=drawing.size,
            quality=drawing.quality,
            renderer=drawing.renderer,
            gl=drawing.gl,
            require_gpu=drawing.require_gpu,
        )
        before = clock()
        result = video.run(_SilentReporter())
        seconds = clock() - before
    rest = result.wall - result.simulation_wall
    return EndToEndTiming("video", result.simulated, result.frames, "frames", seconds, result.simulation_wall, rest)
