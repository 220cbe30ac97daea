"""Image output: a video of one frame, whose pixels may be numbers."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import field
from fractions import Fraction
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from mjrun.camera.script import ConditionEvent
from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, OptionPath, UsageError, clean, option
from mjrun.formats import codecs
from mjrun.formats.image_format import image_format
from mjrun.formats.image_writer import ImageWriter
from mjrun.formats.output_writer import OutputWriter
from mjrun.formats.pointcloud import PointCloudWriter
from mjrun.model.camera_images import CameraImages
from mjrun.options.option import options
from mjrun.options.video import ImageOptions
from mjrun.outputs import output
from mjrun.outputs.camera_panels import CalibrationFile, VideoOrImageFile, camera_names, output_files, panel_files
from mjrun.outputs.event_detection import time_of
from mjrun.outputs.frame_drawing import (
    FramePlan,
    VideoOrImageRequest,
    frame_compositor,
    open_frame_recorder,
    plan_frames,
)
from mjrun.outputs.output import named_files
from mjrun.outputs.recorded_scene import FrameSchedule, ScenePlan, image_schedule
from mjrun.rendering.compositor import SceneCompositor
from mjrun.rendering.visual import SegmentationIds
from mjrun.simulation.simulation import require_countable
from mjrun.timeline import Timeline, nearest

POINTCLOUD_VIEWS = ("rgb", "depth")  # the views that a point cloud is made from
COLOUR_SUFFIXES = (".jpg", ".jpeg", ".webp")  # of formats that hold colours only


@options
class Image(ImageOptions, VideoOrImageRequest["ImageResult"]):
    """An image of one instant of a simulation: its options are keywords.

    The duration of the simulation matters only if the output waits for an event. Depth and segmentation are stored as
    numbers if the file format can hold them and the image shows nothing else.
    """

    @property
    def is_measured(self) -> bool:
        return super().is_measured or self.pointcloud is not None

    @property
    def files(self) -> list[tuple[str, str]]:
        return [*output_files(self, self.output, self.manifest), *named_files(pointcloud=self.pointcloud)]

    @cached_property
    def formatted_files(self) -> "Sequence[FormattedImageFile]":
        """The files with their formats.

        Raises:
          UsageError: a format cannot hold the image.
        """
        return [_image_file(self, file) for file in panel_files(self, self.output)]

    def check(self) -> None:
        """Checks the formats.

        Raises:
          UsageError: a format cannot hold the image.
        """
        _ = self.formatted_files

    def schedule_frames(self, scene: ScenePlan, event_steps: output.EventSteps) -> FrameSchedule:
        """Schedules the single frame.

        Raises:
          UsageError: an event does not happen.
        """
        timeline = scene.context.timeline
        step = _step(self, timeline, event_steps)
        scene.context.require_before_end(step, "time" if self.step is None else "step")
        return image_schedule(scene.scripts, timeline, event_steps, step=step)

    def plan(self, context: output.PassContext) -> "output.OutputPlan[ImageResult]":
        """Resolves every name in the model, and the step unless events decide."""
        events: dict[OptionPath, ConditionEvent] = (
            {("time", "when"): self.time} if isinstance(self.time, ConditionEvent) else {}
        )
        frames, file = plan_frames(self, context, events=events), self.formatted_files[0]
        schedule = None if frames.scene.conditions else self.schedule_frames(frames.scene, {})
        when = "at an event" if schedule is None else f"at {schedule.times[0]:g} s"
        about = f"{file.format}, {when}, {' and '.join(camera_names(self))}"
        return output.OutputPlan(
            preview=output.OutputPreview("image", self.output, 1, "image", frames.size_of(file), about),
            until=context.timeline.steps if schedule is None else schedule.steps[0],
            open=partial(OpenImage, self, frames, schedule),
            enable_flags=frames.enable_flags,
            conditions=frames.scene.conditions,
        )


@dataclass(frozen=True)
class ImageResult(output.OutputResult):
    """The result of an image output.

    Attributes:
      path: path of the image; `-` is standard output.
      paths: all files, labels included.
      format: name of the format.
      size: width and height of the image [pixels].
      time, step: the instant [s].
      clipped: the share of the visible pixels whose depth exceeds the format's range.
      renderer, gl, software: OpenGL's name for the renderer; the backend; whether a CPU renders.
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


@dataclass(frozen=True)
class FormattedImageFile(VideoOrImageFile):
    """A file of an image, with its format.

    Attributes:
      format: name of the format.
      view: content of the pixels: `depth`, `seg`, or `rgb` for colours of any view.
    """

    format: str = field(kw_only=True)

    @property
    def view(self) -> str:
        return self.panels[0].view if self.exact else "rgb"


class OpenImage(output.OpenOutput[ImageResult]):
    """An image with open files.

    Args:
      schedule: the schedule of the frame; None if an event decides.
    """

    def __init__(
        self,
        request: Image,
        frames: FramePlan,
        schedule: FrameSchedule | None,
        stack: ExitStack,
        backends: output.RenderingResources,
    ) -> None:
        files = request.formatted_files
        self._request, self._scene_plan = request, frames.scene
        self._recorder = open_frame_recorder(frames, schedule, files, stack, backends)
        self.taps = self._recorder.taps
        self._facts = self._recorder.facts
        self._writers: list[ImageWriter] = []
        for file in files:
            size, tags = frames.size_of(file), output.metadata_tags(file.target, self._facts)
            writer = ImageWriter(file.target, file.view, file.format, size, tags)
            self._writers.append(stack.enter_context(writer))
        self._calibration: CalibrationFile | None = None
        if request.calibration is not None:
            numbers = any(file.view == "depth" and file.format == "png" for file in files)
            self._calibration = CalibrationFile(request, frames.scene.motions, files, numbers, is_numbered=False)
            stack.enter_context(self._calibration.writer)
        self._pointcloud: PointCloudWriter | None = None
        if request.pointcloud is not None:
            model = frames.scene.context.model
            labels = SegmentationIds(model, request.seg_by).legend if "seg" in request.view else None
            self._pointcloud = stack.enter_context(PointCloudWriter(request.pointcloud, labels))

    def choose_taps(self, event_steps: output.EventSteps) -> None:
        self._recorder.schedule = self._request.schedule_frames(self._scene_plan, event_steps)
        self.taps = self._recorder.taps

    def finish(self, simulation_wall: float) -> output.FinishedOutput[ImageResult]:
        scene = self._recorder.place()
        compositor = frame_compositor(self._recorder, scene, legend=self._request.legend)
        pictures = self._pictures(compositor, scene.states[0])
        for index in range(len(self._writers)):
            self._write(index, compositor, pictures)
        clipped = max(writer.clipped for writer in self._writers)
        if clipped:
            text = f"{100 * clipped:.2f} % of the visible pixels are beyond 65.535 m, the limit of 16-bit depth"
            self._scene_plan.context.reporter.warn(text)

        writers: list[OutputWriter] = [*self._writers]
        if self._calibration:
            self._calibration.write(scene.poses[0], 0, scene.times[0])
            writers.append(self._calibration.writer)
        if self._pointcloud:
            for picture in pictures:
                self._pointcloud.write(picture)
            writers.append(self._pointcloud)
        for writer in writers:
            writer.finish()
        return output.FinishedOutput(self._result(scene.schedule, clipped, writers), writers, self._facts)

    def _result(self, schedule: FrameSchedule, clipped: float, writers: Sequence[OutputWriter]) -> ImageResult:
        backend, file = self._recorder.backend, self._request.formatted_files[0]
        places = [part.destination for writer in writers for part in writer.together]
        return ImageResult(
            path=self._request.output,
            paths=[str(place.shown) for place in places if place.stdout is None],
            format=file.format,
            size=self._recorder.plan.size_of(file),
            time=schedule.times[0],
            step=schedule.steps[0],
            clipped=clipped,
            renderer=backend.renderer,
            gl=backend.name,
            software=backend.software,
        )

    def _pictures(self, compositor: SceneCompositor, state: np.ndarray) -> list[CameraImages]:
        """Renders the view of each camera."""
        views = self._request.view
        try:
            compositor.open()
            if not compositor.ranges and "depth" in views:
                compositor.choose_ranges({0: state})
            return compositor.render(state, 0, [*views, *(POINTCLOUD_VIEWS if self._pointcloud else ())])
        finally:
            compositor.close()

    def _write(self, index: int, compositor: SceneCompositor, pictures: Sequence[CameraImages]) -> None:
        """Writes the file with this index."""
        file, writer = self._request.formatted_files[index], self._writers[index]
        picture = pictures[file.panels[0].camera]
        if file.view == "depth":
            assert picture.depth is not None
            writer.write(picture.depth)
        elif file.view == "seg":
            assert picture.ids is not None
            writer.write(picture.ids, picture.legend, compositor.colors)
        else:
            writer.write(np.ascontiguousarray(compositor.frame(compositor.specs[index], pictures, 0)))


def _image_file(request: Image, file: VideoOrImageFile) -> FormattedImageFile:
    """Chooses the format of a file: numbers if a single view is, or can be, stored as such."""
    suffix = Path(file.path).suffix.lower()
    if suffix in codecs.VIDEO_SUFFIXES and suffix not in COLOUR_SUFFIXES:  # a WebP may be an image
        raise UsageError(f"{clean(file.path)} is a video, but an image shows one instant\n`mjrun video` makes videos")
    if len(file.panels) > 1 and request.style == "exact":
        exact_style = f"{option('style')} exact"
        raise UsageError(f"{exact_style}: numbers cannot share an image; {option('separate')} writes a file for each")
    alone = len(file.panels) == 1 and file.panels[0].view != "rgb"
    exact = alone and (request.style == "exact" or (request.style is None and suffix not in COLOUR_SUFFIXES))
    view = file.panels[0].view if exact else "rgb"
    hint = f"{option('style')} color renders colours instead" if exact else ""
    return FormattedImageFile(
        file.path, file.panels, exact, format=image_format(file.target, view, request.format, hint)
    )


def _step(request: Image, timeline: Timeline, event_steps: output.EventSteps) -> int:
    """Returns the step that the image shows."""
    if request.step is not None:
        require_countable(request.step, "step")
        return request.step
    if isinstance(request.time, ConditionEvent):
        at = time_of(request.time, event_steps[request.time.when], timeline, request.output)
        return min(max(nearest(at / timeline.timestep), 0), timeline.steps)
    if request.time is not None and not isinstance(request.time, Fraction):
        raise BadValueError(option("time"), request.time, "a number of seconds of at least 0")
    step = nearest((request.time or Fraction(0)) / timeline.timestep)
    require_countable(step, "time")
    return step
