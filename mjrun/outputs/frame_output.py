"""The common part of videos, images and exports: the frames of a scene. An image is a video of one frame.

While the simulation runs, the state of every frame is saved. The frames are rendered from the states afterwards.
"""

from abc import abstractmethod
from array import array
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import cached_property
from typing import TypeVar

import mujoco

from mjrun.camera.argument import parse_camera
from mjrun.camera.pose import Pose, PoseArray
from mjrun.camera.script import CameraScript, Event
from mjrun.camera.script_poses import CameraMotion
from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, OptionPath, UsageError, concerning, option
from mjrun.formats.atomic_output import OutputWriter
from mjrun.options.option import options
from mjrun.options.rendering import SceneOptions, ViewOptions
from mjrun.outputs.camera_panels import DrawingCalibration, PanelFile, camera_names, frame_size, unused_options
from mjrun.outputs.decorations import PlannedDecoration, planned_decorations
from mjrun.outputs.decorations.ghost import ghost_files
from mjrun.outputs.event_detection import conditions
from mjrun.outputs.frame_schedule import FrameSchedule, shot_events
from mjrun.outputs.output import Context, EventSteps, Job, Output, OutputResult, RendererRequest, SharedRendering
from mjrun.outputs.overlay_probes import FrameValues, OverlayProbes, empty_overlay, overlay_probes
from mjrun.physics.observe import AnyTap, Tap
from mjrun.physics.recorded_states import StateBuffer
from mjrun.rendering.backend import Backend
from mjrun.rendering.classic import ClassicRenderer, check_size
from mjrun.rendering.compositor import FrameStream, Overlay, SceneCompositor
from mjrun.rendering.decorations import Decoration
from mjrun.rendering.drawn_model import drawn_model, ground_remark, place_stage
from mjrun.rendering.filament import FilamentRenderer, check_segmentation, check_visual, omissions
from mjrun.rendering.segment_ids import Segmentation, check_segmentation_name
from mjrun.rendering.visual import visual_of

RENDERERS = {"classic": ClassicRenderer, "filament": FilamentRenderer}
R_co = TypeVar("R_co", bound=OutputResult, covariant=True)


@options
class SceneJob(SceneOptions, Job[R_co]):
    """A requested output that shows the scene at the instants of frames."""

    @property
    def inputs(self) -> list[tuple[str, str]]:
        """The camera scripts, and the files that ghosts follow."""
        scripts = [camera.file for camera in self.camera if isinstance(camera, CameraScript) and camera.file]
        return [*(("camera script", file) for file in scripts), *ghost_files(self)]

    @property
    def events(self) -> Mapping[OptionPath, Event]:
        """Events that the output waits for in addition to those of shots, keyed by option path."""
        return {}

    @property
    def is_measured(self) -> bool:
        """True if the frames measure what exists, and must not show what the simulation lacks unless requested."""
        return False

    @abstractmethod
    def schedule(self, context: Context, scripts: Sequence[CameraScript], event_steps: EventSteps) -> FrameSchedule:
        """Schedules the frames.

        Args:
          scripts: the script of each camera.

        Raises:
          UsageError: an event does not happen, or the schedule is impossible.
        """


@options
class VideoOrImageJob(ViewOptions, SceneJob[R_co]):
    """A requested video or image."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_view(self)

    @property
    def renderer_request(self) -> RendererRequest:
        """The renderer that the output needs."""
        return RendererRequest.of(self)

    @property
    def is_measured(self) -> bool:
        return any(view != "rgb" for view in self.view)


@dataclass(frozen=True)
class ScenePlan:
    """The scene of all frames, with every name resolved in the model.

    Attributes:
      motions: the motion of each camera.
      decorations: trails, ghosts and the like.
      drawn_model: the model that is drawn.
      is_bare: whether it has a stage that the user has not requested.
      conditions: the conditions of the events that the schedule depends on.
      schedule: the schedule of the frames; None if events decide.
    """

    job: SceneJob[OutputResult]
    context: Context
    motions: Sequence[CameraMotion]
    decorations: Sequence[PlannedDecoration]
    drawn_model: mujoco.MjModel
    is_bare: bool
    conditions: Sequence[str]
    schedule: FrameSchedule | None

    def scheduled(self, event_steps: EventSteps) -> FrameSchedule:
        """Schedules the frames, given the onsets of each condition, and warns about shots that are not shown."""
        return scheduled(self.job, self.context, self.motions, event_steps)


def scheduled(
    job: SceneJob[OutputResult], context: Context, motions: Sequence[CameraMotion], event_steps: EventSteps
) -> FrameSchedule:
    """Schedules the frames, given the onsets of each condition, and warns about shots that are not shown."""
    made = job.schedule(context, [motion.script for motion in motions], event_steps)
    for text in made.warnings:
        context.reporter.warn(text)
    return made


def plan_scene(job: SceneJob[OutputResult], context: Context, cameras: Sequence[object] | None = None) -> ScenePlan:
    """Resolves every name in the model and schedules the frames unless events decide.

    Args:
      cameras: the cameras; by default, those of the job.

    Raises:
      UsageError: a name is unknown, or a value invalid.
    """
    model = context.model
    shown, source = job.camera if cameras is None else cameras, context.simulation.source
    drawn, remark, is_framed = drawn_model(job, model, source, shown, is_measured=job.is_measured)
    if remark:
        context.reporter.note(remark)
    with source.named_in_errors():
        motions = camera_motions(shown, job.size, model, is_framed=is_framed)
    events = {**shot_events([motion.script for motion in motions]), **job.events}
    awaited = conditions(events, model, context.episode) if events else ()
    return ScenePlan(
        job=job,
        context=context,
        motions=motions,
        decorations=planned_decorations(job, model, context.simulation),
        drawn_model=drawn,
        is_bare=bool(remark) and not job.is_measured,
        conditions=awaited,
        schedule=None if awaited else scheduled(job, context, motions, {}),
    )


@dataclass(frozen=True)
class FramePlan:
    """The content of frames, with every name resolved in the model.

    Attributes:
      scene: the scene.
      plots: the values to plot.
      probes: the measurement of the values in a text and in plots, or None.
      overlay: the overlay without content, whose size is known.
    """

    job: VideoOrImageJob[OutputResult]
    scene: ScenePlan
    plots: Sequence[str]
    probes: OverlayProbes | None
    overlay: Overlay

    @property
    def context(self) -> Context:
        """The simulation."""
        return self.scene.context

    @property
    def schedule(self) -> FrameSchedule | None:
        """The schedule of the frames; None if events decide."""
        return self.scene.schedule

    @property
    def conditions(self) -> Sequence[str]:
        """The conditions of the events that the schedule depends on."""
        return self.scene.conditions

    @property
    def enable_flags(self) -> int:
        """MuJoCo enable flags that the measured values require."""
        model = self.probes.model if self.probes else self.context.model
        return model.opt.enableflags

    def size_of(self, file: PanelFile) -> tuple[int, int]:
        """Returns width and height of the frames in a file [pixels]."""
        return file.stream(self.job, self.overlay).size_of_frame


def plan_frames(
    job: VideoOrImageJob[OutputResult], context: Context, plots: Sequence[str] = (), side: str = "under"
) -> FramePlan:
    """Resolves every name in the model and schedules the frames unless events decide.

    Args:
      plots: the values to plot, one graph each, on this `side`.

    Raises:
      UsageError: a name is unknown, or a value invalid.
    """
    scene = plan_scene(job, context)
    probes, overlay = None, Overlay()
    if job.text or plots:
        probes = overlay_probes(context.model, context.timeline, job.text, plots, context.episode)
        corner = job.text_corner or ("bottom-right" if job.captions else "top-left")
        overlay = empty_overlay(frame_size(job), corner, plots, side)
    return FramePlan(job, scene, plots, probes, overlay)


class RecordedFrames:
    """The states of all frames, recorded during the simulation, and the poses of the cameras.

    Attributes:
      states: the state of each frame, after the simulation.
      schedule: the schedule of the frames, once the simulation begins.
    """

    schedule: FrameSchedule

    def __init__(self, plan: ScenePlan, stack: ExitStack) -> None:
        model = plan.context.model
        self._scene, self._reporter = plan, plan.context.reporter
        self.states = stack.enter_context(closing(StateBuffer(model)))
        self._decoration_states = [stack.enter_context(closing(StateBuffer(model))) for _ in plan.decorations]

    def taps(self, event_steps: EventSteps) -> Sequence[AnyTap]:
        """Returns the taps that record the states of frames and of decorations."""
        plan = self._scene
        self.schedule = plan.schedule or plan.scheduled(event_steps)
        taps: list[AnyTap] = [Tap(self.schedule.steps, lambda stepper: stepper.state(), self.states.append)]
        for decoration, states in zip(plan.decorations, self._decoration_states, strict=True):
            taps.append(Tap(decoration.steps(self.schedule.observed), lambda stepper: stepper.state(), states.append))
        return taps

    def keep_recorded(self) -> None:
        """Shortens the schedule to the frames that were recorded, fewer if the simulation became unstable."""
        made, count = self.schedule, len(self.states)
        if count < len(made.steps):
            self.schedule = replace(
                made, steps=made.steps[:count], times=made.times[:count], speeds=made.speeds[:count]
            )

    @cached_property
    def times(self) -> Sequence[float]:
        """The simulated time of each frame [s]."""
        return array("d", (float(self._scene.context.timeline.time(step)) for step in self.schedule.steps))

    @cached_property
    def poses(self) -> PoseArray:
        """The poses of every camera for each frame.

        Raises:
          UsageError: a camera coincides at some time with the point that it looks at.
        """
        motions, spans_of = self._scene.motions, self.schedule.spans
        for motion, spans in zip(motions, spans_of, strict=True):
            for text in motion.frame(iter(self.states), self.times, spans):
                self._reporter.note(text)
        cameras = (
            motion.poses(iter(self.states), self.times, self.schedule.times, spans)
            for motion, spans in zip(motions, spans_of, strict=True)
        )
        return PoseArray(cameras)

    @cached_property
    def drawn_model(self) -> mujoco.MjModel:
        """The model that is drawn, with its stage in place."""
        model, context = self._scene.drawn_model, self._scene.context
        if model is not context.model:
            place_stage(model, self.states[0])
        if self._scene.is_bare and (remark := ground_remark(model, self.states[0])):
            self._reporter.note(remark)
        return model

    @property
    def decorations(self) -> list[Decoration]:
        """The decorations of all frames."""
        made = list[Decoration]()
        for decoration, states in zip(self._scene.decorations, self._decoration_states, strict=True):
            made += decoration.drawn(iter(states), self.times)
        return made


class FrameOutput(RecordedFrames, Output[R_co]):
    """A video or an image with open files.

    Args:
      files: the files that the frames are written to.
      known: additional facts for the manifest.
    """

    def __init__(
        self,
        plan: FramePlan,
        files: Sequence[PanelFile],
        known: Mapping[str, object],
        stack: ExitStack,
        rendering: SharedRendering,
    ) -> None:
        super().__init__(plan.scene, stack)
        self._plan, self._files, self._stack = plan, files, stack
        self._backend = rendering.backend(plan.job.renderer_request)
        for text in self._warnings():
            self._reporter.warn(text)
        facts = plan.context.facts(plan.job, plan.schedule.observed if plan.schedule else None)
        self.facts = {**facts, **known, "renderer": self._backend.renderer}
        self._values: list[FrameValues] = []
        self._calibration: DrawingCalibration | None = None

    def taps(self, event_steps: EventSteps) -> Sequence[AnyTap]:
        taps, probes = [*super().taps(event_steps)], self._plan.probes
        if probes and not probes.idle:
            taps.append(Tap(self.schedule.steps, probes.read, self._values.append))
        return taps

    def compositor(self, legend: bool = False) -> SceneCompositor:
        """Returns the compositor of all files; with `legend`, coloured segmentations list what is in view."""
        plan, overlay, schedule = self._plan, self._plan.overlay, self.schedule
        if plan.probes:
            overlay = plan.probes.overlay(overlay, self._values, schedule.steps, schedule.speeds, plan.context.timeline)
        streams = [file.stream(plan.job, overlay, legend) for file in self._files]
        return scene_compositor(plan.job, self.drawn_model, self._backend, streams, self.poses, self.decorations)

    def open_calibration(self, numbers: bool) -> None:
        """Opens the calibration file if requested; `numbers` states that depth is stored as 16-bit images."""
        if self._plan.job.calibration is not None:
            self._calibration = DrawingCalibration(self._plan.job, self._scene.motions, self._files, numbers)
            self._stack.enter_context(self._calibration.writer)

    def calibrate(self) -> list[OutputWriter]:
        """Writes the calibration of every frame, and returns its writer if calibration was requested."""
        if self._calibration is None:
            return []
        for index, (poses, time) in enumerate(zip(self.poses, self.times, strict=True)):
            self._calibration.write(poses, index, time)
        return [self._calibration.writer]

    def _warnings(self) -> list[str]:
        """Returns warnings about what the renderer omits, and about options without effect."""
        job, context = self._plan.job, self._plan.context
        replay_remarks = context.simulation.replay_remarks(context.model)
        remarks = [text for each in self._scene.decorations for text in each.remarks if text not in replay_remarks]
        unused = unused_options(job, self._plan.plots) if all(file.exact for file in self._files) else []
        return [*check_drawing(job, context.model, self._backend), *remarks, *unused]


def check_scene(options: SceneOptions) -> None:
    """Checks everything about the scene that does not depend on the model.

    Raises:
      UsageError: MuJoCo has no such name, a camera is repeated, or a stage is invalid.
    """
    visual_of(options)
    if len(options.stage) > 1 and {"auto", "none"} & {*options.stage}:
        raise BadValueError(
            option("stage"), ", ".join(options.stage), "auto, none, or parts: floor, light, sky, camera"
        )
    _check_once("camera", options.camera)


def check_view(options: ViewOptions) -> None:
    """Checks everything about a scene and images of it that does not depend on the model.

    Raises:
      UsageError: MuJoCo has no such name, a camera or a view is missing or repeated, or a depth range or a stage is
        invalid.
    """
    check_scene(options)
    with concerning("seg_by"):
        check_segmentation_name(options.seg_by)
    if options.depth_range is not None and options.depth_range[0] < 0:
        near, far = options.depth_range
        raise BadValueError(option("depth_range"), f"{near:g}..{far:g}", "two depths in metres, the nearer first")
    for name, values in (("camera", options.camera), ("view", options.view)):
        if not values:
            raise UsageError(f"{option(name)}: give at least one, and each only once")
    _check_once("view", options.view)


def _check_once(name: str, values: Sequence[object]) -> None:
    if any(value in values[:index] for index, value in enumerate(values)):
        raise UsageError(f"{option(name)}: give at least one, and each only once")


def camera_motions(
    cameras: Sequence[object], size: tuple[int, int], model: mujoco.MjModel, *, is_framed: bool = False
) -> list[CameraMotion]:
    """Returns the motion of each camera.

    Args:
      size: width and height of the images [pixels].
      is_framed: whether the default camera frames the model closely.

    Raises:
      UsageError: a name is not in the model, or a value is invalid.
    """
    motions: list[CameraMotion] = []
    for index, camera in enumerate(cameras):
        with concerning("camera", index):
            described = camera if isinstance(camera, CameraScript) else parse_camera(str(camera), model)
            described.check()
            motions.append(CameraMotion(described, model, size, is_framed=is_framed))
    return motions


def scene_compositor(
    options: ViewOptions,
    model: mujoco.MjModel,
    backend: Backend,
    streams: Sequence[FrameStream],
    poses: Sequence[Sequence[Pose]],
    decorations: Sequence[Decoration] = (),
) -> SceneCompositor:
    """Returns the compositor that renders `streams`; `poses` holds the poses of every camera for each frame."""
    return SceneCompositor(
        model=model,
        backend=backend,
        size=options.size,
        visual=visual_of(options),
        names=camera_names(options),
        poses=poses,
        streams=streams,
        segmentation=Segmentation(model, options.seg_by) if "seg" in options.view else None,
        decorations=decorations,
        ranges=[options.depth_range] * len(options.camera) if options.depth_range else [],
        renderer=RENDERERS[options.renderer],
    )


def check_drawing(options: ViewOptions, model: mujoco.MjModel, backend: Backend) -> list[str]:
    """Checks that the renderer can render this, and returns warnings about what it omits.

    Raises:
      UsageError: the renderer does not support these options or this size.
    """
    check_size(options.size, backend, visual_of(options))
    if options.renderer != "filament":
        return []
    check_visual(model, visual_of(options))
    check_segmentation(Segmentation(model, options.seg_by) if "seg" in options.view else None)
    return omissions(model, visual_of(options))
