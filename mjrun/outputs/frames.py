"""What videos and images share: an image is a video of one frame.

While the simulation runs, the state of every frame is kept. The frames are drawn from the states afterwards.
"""

from abc import abstractmethod
from array import array
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import mujoco

from mjrun.camera.argument import parse_camera
from mjrun.camera.motion import CameraMotion
from mjrun.camera.pose import Pose
from mjrun.camera.pose_table import PoseTable
from mjrun.camera.script import CameraScript, Event
from mjrun.errors import OptionPath, concerning
from mjrun.formats.atomic_output import OutputWriter
from mjrun.options.option import options
from mjrun.options.view import ViewOptions
from mjrun.outputs.event_detection import conditions
from mjrun.outputs.frame_schedule import FrameSchedule, shot_events
from mjrun.outputs.output import Context, EventSteps, Job, Output, OutputResult, RendererRequest, SharedRendering
from mjrun.outputs.overlay_probes import FrameValues, OverlayProbes, empty_overlay, overlay_probes
from mjrun.outputs.panel_files import DrawingCalibration, PanelFile, camera_names, frame_size, unused_options
from mjrun.outputs.scene_decorations import SceneDecorations, scene_decorations
from mjrun.outputs.view_settings import RENDERERS, check_view, visual_of
from mjrun.physics.observe import AnyTap, Tap
from mjrun.physics.replay import StateBuffer
from mjrun.rendering.backend import Backend
from mjrun.rendering.classic import check_size
from mjrun.rendering.compositor import FrameStream, Overlay, SceneCompositor
from mjrun.rendering.decorations import Decoration
from mjrun.rendering.filament import check_segmentation, check_visual, omissions
from mjrun.rendering.segmentation import Segmentation

R_co = TypeVar("R_co", bound=OutputResult, covariant=True)


@options
class FrameJob(ViewOptions, Job[R_co]):
    """A video or an image as the user asks for it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_view(self)

    @property
    def renderer_request(self) -> RendererRequest:
        """The renderer that it needs."""
        return RendererRequest.of(self)

    @property
    def events(self) -> Mapping[OptionPath, Event]:
        """The events that it waits for in addition to those of shots, by the options that name them."""
        return {}

    @abstractmethod
    def schedule(self, context: Context, scripts: Sequence[CameraScript], event_steps: EventSteps) -> FrameSchedule:
        """Schedules the frames.

        Args:
          scripts: of the cameras.

        Raises:
          UsageError: an event that does not happen, or an impossible schedule.
        """


@dataclass(frozen=True)
class FramePlan:
    """What frames show, with every name resolved in the model.

    Attributes:
      plots: values that are plotted.
      motions: of each camera.
      overlay: without content; its size is known.
      conditions: of the events that the schedule depends on.
      schedule: of the frames; None while events decide.
    """

    job: FrameJob[OutputResult]
    context: Context
    plots: Sequence[str]
    motions: Sequence[CameraMotion]
    decorations: SceneDecorations
    probes: OverlayProbes
    overlay: Overlay
    conditions: Sequence[str]
    schedule: FrameSchedule | None = None

    @property
    def enable_flags(self) -> int:
        """Flags of MuJoCo's that must be set for what is measured."""
        return self.probes.model.opt.enableflags

    def size_of(self, file: PanelFile) -> tuple[int, int]:
        """Width and height of the frames in a file [pixels]."""
        return file.stream(self.job, self.overlay).size_of_frame

    def scheduled(self, event_steps: EventSteps) -> FrameSchedule:
        """The schedule, given the steps at which each condition begins to hold; warns where shots are not seen."""
        made = self.job.schedule(self.context, [motion.script for motion in self.motions], event_steps)
        for text in made.warnings:
            self.context.reporter.warn(text)
        return made


def plan_frames(
    job: FrameJob[OutputResult], context: Context, plots: Sequence[str] = (), side: str = "under"
) -> FramePlan:
    """Resolves every name in the model, and schedules the frames unless events decide.

    Args:
      plots: values to plot, a graph for each, on this `side`.

    Raises:
      UsageError: a missing name, or an invalid value.
    """
    model = context.model
    with context.simulation.source.named_in_errors():
        motions = camera_motions(job, model)
    events = {**shot_events([motion.script for motion in motions]), **job.events}
    corner = job.text_corner or ("bottom-right" if job.captions else "top-left")
    plan = FramePlan(
        job=job,
        context=context,
        plots=plots,
        motions=motions,
        decorations=scene_decorations(job, model, context.simulation),
        probes=overlay_probes(model, context.timeline, job.text, plots, context.episode),
        overlay=empty_overlay(frame_size(job), corner, plots, side),
        conditions=conditions(events, model, context.episode),
    )
    return plan if plan.conditions else replace(plan, schedule=plan.scheduled({}))


class FrameOutput(Output[R_co]):
    """A video or an image whose files are open.

    Args:
      files: that the frames are written to.
      known: facts about it.

    Attributes:
      states: of each frame, after the simulation.
    """

    schedule: FrameSchedule

    def __init__(
        self,
        plan: FramePlan,
        files: Sequence[PanelFile],
        known: Mapping[str, object],
        stack: ExitStack,
        rendering: SharedRendering,
    ) -> None:
        context = plan.context
        self._plan, self._files, self._stack, self._reporter = plan, files, stack, context.reporter
        self._backend = rendering.backend(plan.job.renderer_request)
        for text in self._warnings():
            self._reporter.warn(text)
        facts = context.facts(plan.job, plan.schedule.observed if plan.schedule else None)
        self.facts = {**facts, **known, "renderer": self._backend.renderer}
        self.states = stack.enter_context(StateBuffer(context.model))
        self._trail_states = stack.enter_context(StateBuffer(context.model))
        self._values: list[FrameValues] = []
        self._calibration: DrawingCalibration | None = None

    def taps(self, event_steps: EventSteps) -> Sequence[AnyTap]:
        plan = self._plan
        self.schedule = plan.schedule or plan.scheduled(event_steps)
        frames, trail = self.schedule.steps, plan.decorations.trail_steps(self.schedule.observed)
        taps: list[AnyTap] = [
            Tap(frames, lambda stepper: stepper.state(), self.states.append),
            Tap(trail, lambda stepper: stepper.state(), self._trail_states.append),
        ]
        if not plan.probes.idle:
            taps.append(Tap(frames, plan.probes.read, self._values.append))
        return taps

    @cached_property
    def times(self) -> Sequence[float]:
        """The simulated time of each frame [s]."""
        return array("d", (float(self._plan.context.timeline.time(step)) for step in self.schedule.steps))

    @cached_property
    def poses(self) -> PoseTable:
        """Of each frame, of each camera.

        Raises:
          UsageError: a camera is at some time where it is to look.
        """
        count = len(self.states)
        cameras = (
            motion.poses((self.states[k] for k in range(count)), self.times, self.schedule.times, spans)
            for motion, spans in zip(self._plan.motions, self.schedule.spans, strict=True)
        )
        return PoseTable(cameras)

    def compositor(self, legend: bool = False) -> SceneCompositor:
        """What draws the frames of all files; `legend` says whether coloured segmentations list what is in view."""
        plan, schedule = self._plan, self.schedule
        trail_states = (self._trail_states[k] for k in range(len(self._trail_states)))
        decorations = plan.decorations.decorations(trail_states, self.times)
        overlay = plan.probes.overlay(
            plan.overlay, self._values, schedule.steps, schedule.speeds, plan.context.timeline
        )
        streams = [file.stream(plan.job, overlay, legend) for file in self._files]
        return scene_compositor(plan.job, plan.context.model, self._backend, streams, self.poses, decorations)

    def open_calibration(self, numbers: bool) -> None:
        """Opens the calibration file, if one is asked for; `numbers` says whether depth is in 16-bit pictures."""
        if self._plan.job.calibration is not None:
            self._calibration = DrawingCalibration(self._plan.job, self._plan.motions, self._files, numbers)
            self._stack.enter_context(self._calibration.writer)

    def calibrate(self) -> list[OutputWriter]:
        """Writes the calibration of every frame, and returns the writer, if there is one."""
        if self._calibration is None:
            return []
        for index, (poses, time) in enumerate(zip(self.poses, self.times, strict=True)):
            self._calibration.write(poses, index, time)
        return [self._calibration.writer]

    def _warnings(self) -> list[str]:
        """What the renderer will leave out, and options that have no effect."""
        job, context = self._plan.job, self._plan.context
        replay_remarks = context.simulation.replay_remarks(context.model)
        remarks = [text for text in self._plan.decorations.remarks if text not in replay_remarks]
        unused = unused_options(job, self._plan.plots) if all(file.exact for file in self._files) else []
        return [*check_drawing(job, context.model, self._backend), *remarks, *unused]


def camera_motions(options: ViewOptions, model: mujoco.MjModel) -> list[CameraMotion]:
    """The motion of each camera.

    Raises:
      UsageError: a name that is not in the model, or a value that cannot be.
    """
    motions: list[CameraMotion] = []
    for index, camera in enumerate(options.camera):
        with concerning("camera", index):
            described = camera if isinstance(camera, CameraScript) else parse_camera(str(camera), model)
            described.check()
            motions.append(CameraMotion(described, model, options.size))
    return motions


def scene_compositor(
    options: ViewOptions,
    model: mujoco.MjModel,
    backend: Backend,
    streams: Sequence[FrameStream],
    poses: Sequence[Sequence[Pose]],
    decorations: Sequence[Decoration] = (),
) -> SceneCompositor:
    """What draws the frames of `streams`; `poses` are those of each frame, of each camera."""
    return SceneCompositor(
        model=model,
        backend=backend,
        size=options.size,
        visual=visual_of(options),
        names=camera_names(options),
        poses=poses,
        streams=streams,
        segmentation=Segmentation(model, options.seg_by),
        decorations=decorations,
        ranges=[options.depth_range] * len(options.camera) if options.depth_range else [],
        renderer=RENDERERS[options.renderer],
    )


def check_drawing(options: ViewOptions, model: mujoco.MjModel, backend: Backend) -> list[str]:
    """Warnings of what the renderer will leave out.

    Raises:
      UsageError: it cannot draw this, or not that large.
    """
    check_size(options.size, backend, visual_of(options))
    if options.renderer != "filament":
        return []
    check_visual(model, visual_of(options))
    check_segmentation(Segmentation(model, options.seg_by) if "seg" in options.view else None)
    return omissions(model, visual_of(options))
