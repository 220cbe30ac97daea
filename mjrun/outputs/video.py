"""A video: keep the state of every frame while the simulation runs, then draw the states into the encoder."""

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import partial
from math import prod
from pathlib import Path

import numpy as np

from mjrun.errors import clean
from mjrun.formats.atomic_output import OutputWriter
from mjrun.formats.codecs import Encoding, encoding
from mjrun.formats.labels import LabelsWriter
from mjrun.formats.video_writer import VideoWriter
from mjrun.model.uint16_pixels import UINT16_MAX
from mjrun.options.kinds import AUTO
from mjrun.options.option import options
from mjrun.options.video import VideoOptions
from mjrun.outputs.calibration import DrawingCalibration
from mjrun.outputs.drawing import DrawingPlan, FrameRecorder, metadata_tags, plan_drawing
from mjrun.outputs.drawing_files import DrawingFile, camera_names, output_files, panel_files, panels_of
from mjrun.outputs.event_detection import conditions
from mjrun.outputs.frame_schedule import FrameSchedule, shot_events, video_schedule
from mjrun.outputs.shared_rendering import RendererRequest, SharedRendering
from mjrun.outputs.task import Artifact, Context, EventSteps, Job, Output, OutputResult, PassSummary, Preview
from mjrun.outputs.video_drawing import FrameDrawer
from mjrun.outputs.view import check_view
from mjrun.rendering.backend import Backend
from mjrun.rendering.compositor import SceneCompositor
from mjrun.reporter import Reporter
from mjrun.simulation.manifest import origin


@options
class Video(VideoOptions, Job["VideoResult"]):
    """A video of a simulation: its options are keywords."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_view(self)

    @property
    def files(self) -> list[tuple[str, str]]:
        return output_files(self, self.output, self.manifest)

    def task(self) -> "VideoTask":
        """Its task, with every format chosen.

        Raises:
          UsageError: a format that cannot hold the video, or a rate that cannot be.
        """
        files = [_video_file(self, file) for file in panel_files(self, self.output)]
        fps = files[0].encoding.fps if self.fps is None else self.fps
        speed = self.speed
        for file in files:
            file.encoding.check_fps(fps)
        return VideoTask(self, files, fps, speed)


@dataclass(frozen=True)
class VideoResult(OutputResult):
    """What video was made.

    Attributes:
      path: where it is; `-` is standard output.
      paths: all files, labels and calibration included.
      format, codec: how it is encoded.
      size: width and height of the video [pixels], padding included.
      frames, fps, duration: number, rate, and length of the video [s].
      simulated, steps: simulated time [s] and steps taken.
      jobs: processes that drew.
      renderer, gl, software: what drew, by OpenGL's own name; the backend; whether it is a CPU.
      simulation_wall, draw_wall, wall: wall time of stepping, of drawing and encoding, of all [s].
      warnings: MuJoCo's.
    """

    paths: Sequence[str]
    format: str
    codec: str
    size: tuple[int, int]
    frames: int
    fps: float
    duration: float
    simulated: float
    steps: int
    jobs: int
    renderer: str
    gl: str
    software: bool
    simulation_wall: float
    draw_wall: float
    wall: float
    warnings: Sequence[str]


@dataclass(frozen=True)
class VideoFile(DrawingFile):
    """A file of a video; `encoding` is how it is encoded."""

    encoding: Encoding = field(kw_only=True)

    @property
    def is_labelled(self) -> bool:
        """Whether a file beside it says what its ids mean."""
        return self.target is not None and [panel.view for panel in self.panels] == ["seg"]


@dataclass(frozen=True)
class VideoTask:
    """A video, with every format chosen."""

    job: Video
    files: Sequence[VideoFile]
    fps: Fraction
    speed: Fraction

    @property
    def renderer(self) -> RendererRequest:
        """What it draws with."""
        return RendererRequest.of(self.job)

    def plan(self, context: Context) -> "VideoPlan":
        """Finds every name in the model and schedules the frames, unless events decide."""
        drawing = plan_drawing(self.job, context, self.job.plot, self.job.plot_side)
        unscheduled = VideoPlan(self, drawing, conditions(shot_events(drawing.scripts), context.model, context.episode))
        if unscheduled.conditions:
            return unscheduled
        return replace(unscheduled, schedule=unscheduled.scheduled({}))


@dataclass(frozen=True)
class VideoPlan:
    """A video of a model.

    Attributes:
      conditions: of the events that its shots wait for.
      schedule: of its frames; None while events decide.
    """

    task: VideoTask
    drawing: DrawingPlan
    conditions: Sequence[str]
    schedule: FrameSchedule | None = None

    keep_partial = False

    @property
    def enable_flags(self) -> int:
        return self.drawing.enable_flags

    @property
    def until(self) -> int:
        return self.drawing.context.timeline.steps

    def scheduled(self, event_steps: EventSteps) -> FrameSchedule:
        """The frames, given the steps at which each condition begins to hold; warns where shots are not seen."""
        task, context = self.task, self.drawing.context
        schedule = video_schedule(self.drawing.scripts, context.timeline, task.fps, task.speed, event_steps)
        for text in schedule.warnings:
            context.reporter.warn(text)
        return schedule

    def preview(self) -> Preview:
        task, job, file = self.task, self.task.job, self.task.files[0]
        frames = None if self.schedule is None else len(self.schedule.steps)
        about = f"{file.encoding.codec}, {float(task.fps):g} fps, {' and '.join(camera_names(job))}"
        size = file.stream(job, self.drawing.overlay).size_of_frame
        return Preview("video", job.output, frames, "frames", size, about)

    def open(self, stack: ExitStack, rendering: SharedRendering) -> "VideoOutput | OpenVideo":
        task, job, context = self.task, self.task.job, self.drawing.context
        backend = self.drawing.backend(rendering, task.files, job.plot)
        known = {} if self.schedule is None else {"frames": len(self.schedule.steps)}
        facts = {**origin(job, job.simulation, context.model, context.timeline), **known, "renderer": backend.renderer}
        writers, labels = list[VideoWriter](), list[LabelsWriter | None]()
        for file in task.files:
            size = file.stream(job, self.drawing.overlay).size_of_frame
            _note_padding(file.encoding, size, context.reporter)
            tags = metadata_tags(file.target, facts)
            writers.append(stack.enter_context(VideoWriter(file.target, file.encoding, size, task.fps, tags=tags)))
            labels.append(stack.enter_context(LabelsWriter(file.path)) if file.is_labelled else None)
        calibration = self.drawing.calibration(task.files, job.style == "exact", stack)

        # Filament's noise goes on from frame to frame: only one process makes the same video each time.
        jobs = 1 if job.jobs == AUTO and job.renderer == "filament" else job.jobs
        drawer = FrameDrawer(jobs, backend, job.size, len(panels_of(job)), rendering)
        opened = OpenVideo(self, backend, facts, writers, labels, calibration, drawer, stack)
        if self.schedule is None:
            return opened
        drawer.start(len(self.schedule.steps))  # they get ready while the simulation runs
        return VideoOutput(opened, self.schedule)


@dataclass(frozen=True)
class OpenVideo:
    """A video whose files are open.

    Attributes:
      facts: for the manifest.
      writers, labels: of each file.
    """

    plan: VideoPlan
    backend: Backend
    facts: Mapping[str, object]
    writers: Sequence[VideoWriter]
    labels: Sequence[LabelsWriter | None]
    calibration: DrawingCalibration | None
    drawer: FrameDrawer
    stack: ExitStack

    @property
    def conditions(self) -> Sequence[str]:
        return self.plan.conditions

    def schedule(self, event_steps: EventSteps) -> "VideoOutput":
        return VideoOutput(self, self.plan.scheduled(event_steps))


class VideoOutput(Output[VideoResult]):
    """A video whose files are open and whose frames are scheduled."""

    def __init__(self, opened: OpenVideo, schedule: FrameSchedule) -> None:
        self._opened, self._task, self._schedule = opened, opened.plan.task, schedule
        self._context = opened.plan.drawing.context
        self._recorder = FrameRecorder(opened.plan.drawing, schedule, self._context.timeline, opened.stack)
        self.taps = self._recorder.taps

    def finish(self) -> "VideoArtifact":
        opened, start = self._opened, time.perf_counter()
        compositor = self._recorder.compositor(opened.backend, self._task.files)
        self._draw(compositor)
        if opened.calibration:
            self._recorder.calibrate(opened.calibration)
        for labels, stream in zip(opened.labels, compositor.streams, strict=True):
            if labels:
                colours = None if stream.exact else compositor.colors
                labels.write(stream.size, compositor.segmentation.legend, colours)

        calibration = [opened.calibration.writer] if opened.calibration else []
        writers = [*opened.writers, *filter(None, opened.labels), *calibration]
        for writer in writers:
            writer.finish()
        facts = {**opened.facts, "frames": len(self._schedule.steps)}
        result = partial(self._result, time.perf_counter() - start)
        return VideoArtifact(facts, writers, result, films=opened.writers, reporter=self._context.reporter)

    def _draw(self, compositor: SceneCompositor) -> None:
        """Draws every frame into the files."""
        opened, reporter, states = self._opened, self._context.reporter, self._recorder.states
        for writer in opened.writers:
            writer.count = len(states)
        is_depth = [stream.exact and stream.panels[0].view == "depth" for stream in compositor.streams]
        clipped = 0
        for index, frames in enumerate(opened.drawer.draw(compositor, states, reporter)):
            for writer, part, depth in zip(opened.writers, compositor.parts(frames), is_depth, strict=True):
                writer.write(part)
                clipped += np.count_nonzero(part == UINT16_MAX) if depth else 0
            reporter.progress("frames", index + 1, len(states))
        if clipped:
            share = clipped / (len(states) * sum(is_depth) * prod(self._task.job.size))
            reporter.warn(f"{share:.2%} of the pixels are at 65.535 m or farther, the most that 16 bits hold")

    def _result(self, draw_wall: float, files: Sequence[Path], summary: PassSummary) -> VideoResult:
        opened, task, job, timeline = self._opened, self._task, self._task.job, self._context.timeline
        encoded, (width, height) = task.files[0].encoding, opened.writers[0].size
        right, bottom = encoded.padding(width, height)
        videos = [file.path for file in task.files]
        paths = [*videos, *(path for what, path in job.files if what != "manifest" and path not in videos)]
        count = len(self._schedule.steps)
        return VideoResult(
            path=job.output,
            paths=paths,
            format=encoded.format,
            codec=encoded.codec,
            size=(width + right, height + bottom),
            frames=count,
            fps=float(task.fps),
            duration=float(count / task.fps),
            simulated=float(timeline.duration),
            steps=timeline.steps,
            jobs=opened.drawer.jobs,
            renderer=opened.backend.renderer,
            gl=opened.backend.name,
            software=opened.backend.software,
            simulation_wall=summary.simulation_wall,
            draw_wall=draw_wall,
            wall=summary.wall,
            warnings=summary.warnings,
        )


@dataclass(frozen=True, kw_only=True)
class VideoArtifact(Artifact[VideoResult]):
    """A complete video; tells of older frames that its pattern would take for its own."""

    films: Sequence[VideoWriter]
    reporter: Reporter

    def publish(self, manifest: Callable[[Sequence[Path]], OutputWriter] | None = None) -> list[Path]:
        files = super().publish(manifest)
        for older in filter(None, (film.others for film in self.films)):
            more = f" and {len(older) - 1} more" if len(older) > 1 else ""
            self.reporter.warn(
                f"{clean(older[0])}{more} were there before and follow the last frame: not part of this video"
            )
        return files


def _video_file(job: Video, file: DrawingFile) -> VideoFile:
    coded = all(panel.view == "seg" for panel in file.panels)
    content = "exact" if file.exact else "ids" if coded else "video"
    encoded = encoding(file.target, job.format, job.codec, job.crf, job.preset, content)
    return VideoFile(file.path, file.panels, file.exact, encoding=encoded)


def _note_padding(encoded: Encoding, size: tuple[int, int], reporter: Reporter) -> None:
    right, bottom = encoded.padding(*size)
    if right or bottom:
        width, height = size
        padded = f"{width + right}x{height + bottom}"
        reporter.note(f"{encoded.codec} needs even sides: the video is padded from {width}x{height} to {padded}")
