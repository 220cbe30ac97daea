"""Video output: saves the state of every frame during the simulation, then draws the states into the encoder."""

from collections.abc import Generator, Sequence
from contextlib import ExitStack, closing
from dataclasses import field
from fractions import Fraction
from functools import cached_property, partial
from math import prod
from time import perf_counter
from typing import Any

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.formats.codecs import VideoEncoding, encoding
from mjrun.formats.ffmpeg import VideoWriter
from mjrun.formats.image_encoding import UINT16_MAX
from mjrun.formats.output_writer import OutputWriter
from mjrun.formats.segmentation_labels import LabelsWriter
from mjrun.model.mujoco_globals import collected_warnings, report_warnings, without_timers
from mjrun.options.option import options
from mjrun.options.video import VideoOptions
from mjrun.outputs import output
from mjrun.outputs.camera_panels import CalibrationFile, VideoOrImageFile, camera_names, output_files, panel_files
from mjrun.outputs.frame_drawing import (
    FrameDrawer,
    FramePlan,
    VideoOrImageRequest,
    frame_compositor,
    open_frame_recorder,
    plan_frames,
)
from mjrun.outputs.perform import open_pass, plan_pass
from mjrun.outputs.recorded_scene import FrameSchedule, RecordedScene, ScenePlan, video_schedule
from mjrun.rendering.compositor import SceneCompositor
from mjrun.reporter import PythonApiReporter


@options
class Video(VideoOptions, VideoOrImageRequest["VideoResult"]):
    """A requested video of a simulation: its options are keywords, which are converted and checked on construction."""

    @property
    def files(self) -> list[tuple[str, str]]:
        return output_files(self, self.output, self.manifest)

    @cached_property
    def encoded_files(self) -> "Sequence[EncodedVideoFile]":
        """The files with their encodings.

        Raises:
          UsageError: a format cannot hold the video.
        """
        return [_video_file(self, file) for file in panel_files(self, self.output)]

    @property
    def rate(self) -> Fraction:
        """Frames per second; the format's default if not set."""
        return self.encoded_files[0].encoding.fps if self.fps is None else self.fps

    def check(self) -> None:
        """Checks the formats and the rate.

        Raises:
          UsageError: a format cannot hold the video, or the rate is invalid.
        """
        for file in self.encoded_files:
            file.encoding.check_fps(self.rate)

    def schedule_frames(self, scene: ScenePlan, event_steps: output.EventSteps) -> FrameSchedule:
        """Schedules the frames, and warns about shots that are not shown.

        Raises:
          UsageError: an event does not happen, or the schedule is impossible.
        """
        context = scene.context
        schedule = video_schedule(scene.scripts, context.timeline, event_steps, fps=self.rate, speed=self.speed)
        for text in schedule.warnings:
            context.reporter.warn(text)
        return schedule

    def plan(self, context: output.PassContext) -> "output.OutputPlan[VideoResult]":
        """Resolves every name in the model and schedules the frames unless events decide."""
        frames, file = plan_frames(self, context, self.plot, self.plot_side), self.encoded_files[0]
        for each in self.encoded_files if self.files else ():  # frames in memory are not encoded
            each.encoding.check_size(*frames.size_of(each))
        schedule = None if frames.scene.conditions else self.schedule_frames(frames.scene, {})
        count = None if schedule is None else len(schedule.steps)
        about = f"{file.encoding.codec}, {float(self.rate):g} fps, {' and '.join(camera_names(self))}"
        return output.OutputPlan(
            preview=output.OutputPreview("video", self.output, count, "frames", frames.size_of(file), about),
            until=context.timeline.steps,
            open=partial(self.open_files, frames, schedule),
            enable_flags=frames.enable_flags,
            conditions=frames.scene.conditions,
        )

    def open_files(
        self,
        frames: FramePlan,
        schedule: FrameSchedule | None,
        stack: ExitStack,
        backends: output.RenderingResources,
    ) -> "output.OpenOutput[Any]":
        """Opens the files; see `OutputPlan.open`."""
        return OpenVideo(self, frames, schedule, stack, backends)


@dataclass(frozen=True)
class VideoResult(output.OutputResult):
    """The result of a video output.

    Attributes:
      path: path of the video; `-` is standard output.
      paths: all files, labels and calibration included.
      format, codec: names of the format and the codec.
      size: width and height of the video [pixels], padding included.
      frames, fps, duration: number of frames, their rate, and length of the video [s].
      simulated, steps: simulated time [s] and steps taken.
      jobs: the number of processes that rendered.
      renderer, gl, software: OpenGL's name for the renderer; the backend; whether a CPU renders.
      simulation_wall, draw_wall: wall time of stepping, and of rendering and encoding [s].
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


@dataclass(frozen=True)
class EncodedVideoFile(VideoOrImageFile):
    """A file of a video, with its encoding."""

    encoding: VideoEncoding = field(kw_only=True)


class OpenVideo(output.OpenOutput[VideoResult]):
    """A video with open files.

    Args:
      schedule: the schedule of the frames; None if events decide.
    """

    def __init__(
        self,
        request: Video,
        frames: FramePlan,
        schedule: FrameSchedule | None,
        stack: ExitStack,
        backends: output.RenderingResources,
    ) -> None:
        self._request, self._scene_plan, self._reporter = request, frames.scene, frames.scene.context.reporter
        self._recorder = open_frame_recorder(frames, schedule, request.encoded_files, stack, backends, request.jobs)
        self.taps = self._recorder.taps
        count = {"frames": len(schedule.steps)} if schedule else {}
        self._facts = {**self._recorder.facts, **count}
        self._writers, self._labels = list[VideoWriter](), list[LabelsWriter | None]()
        for file in request.encoded_files:
            size, tags = frames.size_of(file), output.metadata_tags(file.target, self._facts)
            writer = VideoWriter(file.target, file.encoding, size, request.rate, tags=tags)
            self._writers.append(stack.enter_context(writer))
            self._note_padding(file.encoding, size)
            self._labels.append(stack.enter_context(LabelsWriter(file.path)) if file.is_labelled else None)
        self._calibration: CalibrationFile | None = None
        if request.calibration is not None:
            numbers = request.style == "exact"
            self._calibration = CalibrationFile(
                request, self._scene_plan.motions, request.encoded_files, numbers, is_numbered=True
            )
            stack.enter_context(self._calibration.writer)

    def choose_taps(self, event_steps: output.EventSteps) -> None:
        self._recorder.schedule = self._request.schedule_frames(self._scene_plan, event_steps)
        self.taps = self._recorder.taps

    def finish(self, simulation_wall: float) -> output.FinishedOutput[VideoResult]:
        """Draws every recorded state, here or in other processes, into the encoders, and ends them."""
        start = perf_counter()
        scene = self._recorder.place()
        self._draw(scene, frame_compositor(self._recorder, scene))
        writers: list[OutputWriter] = [*self._writers, *filter(None, self._labels)]
        if self._calibration:
            for index, (poses, time) in enumerate(zip(scene.poses, scene.times, strict=True)):
                self._calibration.write(poses, index, time)
            writers.append(self._calibration.writer)
        for writer in writers:
            writer.finish()  # the encoder may have frames left

        count = len(scene.times)
        result = self._result(count, simulation_wall, perf_counter() - start)
        return output.FinishedOutput(result, writers, {**self._facts, "frames": count})

    def _draw(self, scene: RecordedScene, compositor: SceneCompositor) -> None:
        """Draws every frame into the encoders, and writes the labels of segmentations."""
        count = len(scene.states)
        for writer in self._writers:
            writer.count = count
        is_depth = [spec.exact and spec.panels[0].view == "depth" for spec in compositor.specs]
        clipped = 0
        with closing(FrameDrawer(self._recorder, scene, compositor)) as drawing:
            for _ in range(count):
                for writer, part, depth in zip(self._writers, drawing.draw(), is_depth, strict=True):
                    writer.write(part)
                    clipped += np.count_nonzero(part == UINT16_MAX) if depth else 0
        if clipped:
            share = clipped / (count * sum(is_depth) * prod(self._request.size))
            self._reporter.warn(
                f"{100 * share:.2f} % of the pixels are at 65.535 m or beyond, the limit of 16-bit depth"
            )

        for labels, spec in zip(self._labels, compositor.specs, strict=True):
            if labels:
                assert compositor.segmentation
                colours = None if spec.exact else compositor.colors
                labels.write(spec.size, compositor.segmentation.legend, colours)

    def _result(self, count: int, simulation_wall: float, draw_wall: float) -> VideoResult:
        request, timeline, backend = self._request, self._scene_plan.context.timeline, self._recorder.backend
        encoded, (width, height) = request.encoded_files[0].encoding, self._writers[0].size
        right, bottom = encoded.padding(width, height)
        videos = [file.path for file in request.encoded_files]
        return VideoResult(
            path=request.output,
            paths=[*videos, *(path for what, path in request.files if what != "manifest" and path not in videos)],
            format=encoded.format,
            codec=encoded.codec,
            size=(width + right, height + bottom),
            frames=count,
            fps=float(request.rate),
            duration=float(count / request.rate),
            simulated=float(timeline.duration),
            steps=timeline.steps,
            jobs=self._recorder.processes.count,
            renderer=backend.renderer,
            gl=backend.name,
            software=backend.software,
            simulation_wall=simulation_wall,
            draw_wall=draw_wall,
        )

    def _note_padding(self, encoded: VideoEncoding, size: tuple[int, int]) -> None:
        right, bottom = encoded.padding(*size)
        if right or bottom:
            width, height = size
            padded = f"{width + right}x{height + bottom}"
            self._reporter.note(
                f"{encoded.codec} needs even sides: the video is padded from {width}x{height} to {padded}"
            )


def _video_file(request: Video, file: VideoOrImageFile) -> EncodedVideoFile:
    coded = all(panel.view == "seg" for panel in file.panels)
    content = "exact" if file.exact else "ids" if coded else "video"
    encoded = encoding(file.target, request.format, request.codec, request.crf, request.preset, content)
    return EncodedVideoFile(file.path, file.panels, file.exact, encoding=encoded)


@options
class VideoInMemory(Video):
    """A video whose frames stay in memory."""

    @property
    def files(self) -> list[tuple[str, str]]:
        return []

    def open_files(
        self,
        frames: FramePlan,
        schedule: FrameSchedule | None,
        stack: ExitStack,
        backends: output.RenderingResources,
    ) -> "output.OpenOutput[Any]":
        return OpenVideoInMemory(self, frames, schedule, stack, backends)


class OpenVideoInMemory(output.OpenOutput[output.OutputResult]):
    """The frames of a video, without a file.

    Args:
      schedule: the schedule of the frames; None if events decide.
    """

    def __init__(
        self,
        request: VideoInMemory,
        frames: FramePlan,
        schedule: FrameSchedule | None,
        stack: ExitStack,
        backends: output.RenderingResources,
    ) -> None:
        self._request = request
        self._recorder = open_frame_recorder(frames, schedule, request.encoded_files, stack, backends, request.jobs)
        self.taps = self._recorder.taps

    def choose_taps(self, event_steps: output.EventSteps) -> None:
        self._recorder.schedule = self._request.schedule_frames(self._recorder.plan.scene, event_steps)
        self.taps = self._recorder.taps

    def images(self) -> Generator[np.ndarray]:
        """Draws the frames one by one, when they are requested, and yields copies of them."""
        scene = self._recorder.place()
        with closing(FrameDrawer(self._recorder, scene, frame_compositor(self._recorder, scene))) as drawing:
            for _ in scene.times:
                yield drawing.draw()[0].copy()

    def finish(self, simulation_wall: float) -> output.FinishedOutput[output.OutputResult]:
        raise NotImplementedError


def video_frames(video: VideoInMemory) -> Generator[np.ndarray]:
    """Simulates when the first frame is asked for, and yields the frames, which belong to the caller.

    Raises:
      MjrunError: as `Video.run`.
    """
    reporter = PythonApiReporter()
    with ExitStack() as stack:
        with collected_warnings() as warnings, without_timers():
            backends = stack.enter_context(closing(output.RenderingResources()))
            current = open_pass(plan_pass([video], reporter, backends), stack, backends)
            current.simulate()
        if error := current.error():
            raise error
        report_warnings(warnings, reporter)
        (made,) = current.outputs
        assert isinstance(made, OpenVideoInMemory)
        yield from made.images()
