"""An image: a video of one frame, whose pixels may be numbers."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import partial
from pathlib import Path

import mujoco
import numpy as np

from mjrun.camera.script import Event
from mjrun.errors import BadValueError, UsageError, clean, option
from mjrun.formats.image_format import image_format
from mjrun.formats.image_writer import ImageWriter
from mjrun.formats.pointcloud import PointCloudWriter
from mjrun.model.rendered_view import RenderedView, Segment
from mjrun.options.image import ImageOptions
from mjrun.options.option import options
from mjrun.outputs.calibration import DrawingCalibration
from mjrun.outputs.drawing import DrawingPlan, FrameRecorder, metadata_tags, plan_drawing
from mjrun.outputs.drawing_files import DrawingFile, camera_names, output_files, panel_files
from mjrun.outputs.event_detection import conditions, time_of
from mjrun.outputs.frame_schedule import FrameSchedule, image_schedule, shot_events
from mjrun.outputs.output_files import named_files
from mjrun.outputs.shared_rendering import RendererRequest, SharedRendering
from mjrun.outputs.task import Artifact, Context, EventSteps, Job, Output, OutputResult, PassSummary, Preview
from mjrun.outputs.view import check_view
from mjrun.rendering.backend import Backend
from mjrun.rendering.compositor import FrameStream, Overlay, SceneCompositor
from mjrun.rendering.segmentation import Segmentation
from mjrun.simulation.manifest import origin
from mjrun.simulation.simulation import require_countable
from mjrun.timeline import Timeline, nearest

POINTCLOUD_VIEWS = ("rgb", "depth")  # what a point cloud is made of
VIDEO_SUFFIXES = (".mp4", ".mov", ".mkv", ".webm", ".gif", ".apng")


@options
class Image(ImageOptions, Job["ImageResult"]):
    """An image of one instant of a simulation: its options are keywords.

    How long the simulation lasts does not matter, unless an event is waited for. Depth and segmentation are numbers
    where the file can hold them and shows nothing else.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        check_view(self)

    @property
    def files(self) -> list[tuple[str, str]]:
        return [*output_files(self, self.output, self.manifest), *named_files(pointcloud=self.pointcloud)]

    def task(self) -> "ImageTask":
        """Its task, with every format chosen.

        Raises:
          UsageError: a format that cannot hold the image.
        """
        return ImageTask(self, [_image_file(self, file) for file in panel_files(self, self.output)])


@dataclass(frozen=True)
class ImageResult(OutputResult):
    """What image was made.

    Attributes:
      path: where it is; `-` is standard output.
      paths: all files, labels included.
      format: how it is written.
      size: width and height of the picture [pixels].
      time, step: the instant [s].
      clipped: the share of what is seen whose depth the format cannot hold.
      renderer, gl, software: what drew, by OpenGL's own name; the backend; whether it is a CPU.
      wall: wall time of all [s].
      warnings: MuJoCo's.
    """

    paths: Sequence[str]
    format: str
    size: tuple[int, int]
    time: float
    step: int
    clipped: float
    renderer: str
    gl: str
    software: bool
    wall: float
    warnings: Sequence[str]


@dataclass(frozen=True)
class ImageFile(DrawingFile):
    """A file of an image.

    Attributes:
      format: how it is written.
      view: what its pixels are: `depth`, `seg`, or `rgb` for anything coloured.
    """

    format: str = field(kw_only=True)

    @property
    def view(self) -> str:
        return self.panels[0].view if self.exact else "rgb"


@dataclass(frozen=True)
class ImageTask:
    """An image, with every format chosen."""

    job: Image
    files: Sequence[ImageFile]

    @property
    def renderer(self) -> RendererRequest:
        """What it draws with."""
        return RendererRequest.of(self.job)

    def plan(self, context: Context) -> "ImagePlan":
        """Finds every name in the model, and the step, unless events decide."""
        drawing = plan_drawing(self.job, context)
        events = shot_events(drawing.scripts)
        if isinstance(self.job.time, Event):
            events["time", "when"] = self.job.time
        unscheduled = ImagePlan(self, drawing, conditions(events, context.model, context.episode))
        if unscheduled.conditions:
            return unscheduled
        return replace(unscheduled, schedule=unscheduled.scheduled({}))


@dataclass(frozen=True)
class ImagePlan:
    """An image of a model: a video of one frame.

    Attributes:
      conditions: of the events that it waits for.
      schedule: of its one frame; None while events decide.
    """

    task: ImageTask
    drawing: DrawingPlan
    conditions: Sequence[str]
    schedule: FrameSchedule | None = None

    keep_partial = False

    @property
    def enable_flags(self) -> int:
        return self.drawing.enable_flags

    @property
    def until(self) -> int:
        return self.drawing.context.timeline.steps if self.schedule is None else self.schedule.steps[0]

    def scheduled(self, event_steps: EventSteps) -> FrameSchedule:
        """The frame, given the steps at which each condition begins to hold."""
        timeline = self.drawing.context.timeline
        step = _step(self.task.job, timeline, event_steps)
        return image_schedule(self.drawing.scripts, timeline, step, event_steps)

    def preview(self) -> Preview:
        job, file = self.task.job, self.task.files[0]
        when = "at an event" if self.schedule is None else f"at {self.schedule.times[0]:g} s"
        about = f"{file.format}, {when}, {' and '.join(camera_names(job))}"
        return Preview("image", job.output, 1, "image", file.stream(job, Overlay()).size_of_frame, about)

    def open(self, stack: ExitStack, rendering: SharedRendering) -> "ImageOutput | OpenImage":
        task, job, context = self.task, self.task.job, self.drawing.context
        backend = self.drawing.backend(rendering, task.files)
        timeline = context.timeline if self.schedule is None else self.observed(self.schedule)
        facts = {**origin(job, job.simulation, context.model, timeline), "renderer": backend.renderer}
        writers: list[ImageWriter] = []
        for file in task.files:
            size, tags = file.stream(job, Overlay()).size_of_frame, metadata_tags(file.target, facts)
            writers.append(stack.enter_context(ImageWriter(file.target, file.view, file.format, size, tags)))
        numbers = any(file.view == "depth" and file.format == "png" for file in task.files)
        calibration = self.drawing.calibration(task.files, numbers, stack)
        pointcloud = None if job.pointcloud is None else PointCloudWriter(job.pointcloud, _legend(job, context.model))
        if pointcloud:
            stack.enter_context(pointcloud)
        opened = OpenImage(self, backend, facts, writers, calibration, pointcloud, stack)
        return opened if self.schedule is None else ImageOutput(opened, self.schedule)

    def observed(self, schedule: FrameSchedule) -> Timeline:
        """The simulation up to the image."""
        return Timeline.of_steps(self.drawing.context.timeline.timestep, schedule.steps[0])


@dataclass(frozen=True)
class OpenImage:
    """An image whose files are open.

    Attributes:
      facts: for the manifest.
      writers: of each file.
    """

    plan: ImagePlan
    backend: Backend
    facts: Mapping[str, object]
    writers: Sequence[ImageWriter]
    calibration: DrawingCalibration | None
    pointcloud: PointCloudWriter | None
    stack: ExitStack

    @property
    def conditions(self) -> Sequence[str]:
        return self.plan.conditions

    def schedule(self, event_steps: EventSteps) -> "ImageOutput":
        return ImageOutput(self, self.plan.scheduled(event_steps))


class ImageOutput(Output[ImageResult]):
    """An image whose files are open and whose step is known."""

    def __init__(self, opened: OpenImage, schedule: FrameSchedule) -> None:
        self._opened, self._task, self._schedule = opened, opened.plan.task, schedule
        self._recorder = FrameRecorder(opened.plan.drawing, schedule, opened.plan.observed(schedule), opened.stack)
        self.taps = self._recorder.taps

    def finish(self) -> Artifact[ImageResult]:
        opened, task = self._opened, self._task
        compositor = self._recorder.compositor(opened.backend, task.files, task.job.legend)
        pictures = self._pictures(compositor)
        for file, stream, writer in zip(task.files, compositor.streams, opened.writers, strict=True):
            _write(file, stream, writer, compositor, pictures)
        if opened.calibration:
            self._recorder.calibrate(opened.calibration)
        if opened.pointcloud:
            for picture in pictures:
                opened.pointcloud.write(picture)

        calibration = [opened.calibration.writer] if opened.calibration else []
        writers = [*opened.writers, *calibration, *([opened.pointcloud] if opened.pointcloud else [])]
        for writer in writers:
            writer.finish()
        clipped = max(writer.clipped for writer in opened.writers)
        if clipped:
            text = f"{clipped:.2%} of what is seen is farther than 65.535 m, the most that 16 bits hold"
            opened.plan.drawing.context.reporter.warn(text)
        result = partial(self._result, compositor.streams[0].size_of_frame, clipped)
        return Artifact(opened.facts, writers, result)

    def _pictures(self, compositor: SceneCompositor) -> list[RenderedView]:
        """What each camera sees."""
        job, state = self._task.job, self._recorder.states[0]
        try:
            compositor.open()
            if not compositor.ranges and "depth" in job.view:
                compositor.look_ahead({0: state})
            return compositor.see(state, 0, [*job.view, *(POINTCLOUD_VIEWS if self._opened.pointcloud else ())])
        finally:
            compositor.close()

    def _result(
        self, size: tuple[int, int], clipped: float, files: Sequence[Path], summary: PassSummary
    ) -> ImageResult:
        backend = self._opened.backend
        return ImageResult(
            path=self._task.job.output,
            paths=[str(file) for file in files],
            format=self._task.files[0].format,
            size=size,
            time=self._schedule.times[0],
            step=self._schedule.steps[0],
            clipped=clipped,
            renderer=backend.renderer,
            gl=backend.name,
            software=backend.software,
            wall=summary.wall,
            warnings=summary.warnings,
        )


def _image_file(job: Image, file: DrawingFile) -> ImageFile:
    """A file with its format: numbers where a lone view is to be, or can be, written as such."""
    if Path(file.path).suffix.lower() in VIDEO_SUFFIXES:
        raise UsageError(f"{clean(file.path)} would be a video; this draws one instant\n`mjrun video` makes videos")
    if len(file.panels) > 1 and job.style == "exact":
        exact_style = f"{option('style')} exact"
        raise UsageError(f"{exact_style}: numbers cannot share a picture; add {option('separate')} for a file each")
    alone = len(file.panels) == 1 and file.panels[0].view != "rgb"
    exact = alone and (job.style == "exact" or (job.style is None and not _holds_only_colours(file.path)))
    view = file.panels[0].view if exact else "rgb"
    hint = f"{option('style')} color draws colours for the eye" if exact else ""
    return ImageFile(file.path, file.panels, exact, format=image_format(file.target, view, job.format, hint))


def _holds_only_colours(path: str) -> bool:
    return Path(path).suffix.lower() in (".jpg", ".jpeg", ".webp")


def _legend(job: Image, model: mujoco.MjModel) -> Sequence[Segment] | None:
    """What labels of points mean, if the points are labelled."""
    return Segmentation(model, job.seg_by).legend if "seg" in job.view else None


def _write(
    file: ImageFile,
    stream: FrameStream,
    writer: ImageWriter,
    compositor: SceneCompositor,
    pictures: Sequence[RenderedView],
) -> None:
    picture = pictures[file.panels[0].camera]
    if file.view == "depth":
        assert picture.depth is not None
        writer.write(picture.depth)
    elif file.view == "seg":
        assert picture.ids is not None
        writer.write(picture.ids, picture.legend, compositor.colors)
    else:
        writer.write(np.ascontiguousarray(compositor.frame(stream, pictures, 0)))


def _step(job: Image, timeline: Timeline, event_steps: EventSteps) -> int:
    """The step that is drawn."""
    if job.step is not None:
        require_countable(job.step, "step")
        return job.step
    if isinstance(job.time, Event):
        at = time_of(job.time, event_steps[job.time.when], timeline, job.output)
        return min(max(nearest(at / timeline.timestep), 0), timeline.steps)
    if job.time is not None and not isinstance(job.time, Fraction):
        raise BadValueError(option("time"), job.time, "a number of seconds from 0 on")
    step = nearest((job.time or Fraction(0)) / timeline.timestep)
    require_countable(step, "time")
    return step
