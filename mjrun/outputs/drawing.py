"""What videos and images draw: cameras, decorations and overlay of a model, and the frames of a schedule."""

from array import array
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cached_property
from json import dumps
from pathlib import Path

import mujoco

from mjrun.camera.argument import parse_camera
from mjrun.camera.motion import CameraMotion
from mjrun.camera.pose import Pose
from mjrun.camera.pose_table import PoseTable
from mjrun.camera.script import CameraScript
from mjrun.errors import clean, concerning
from mjrun.options.view import ViewOptions
from mjrun.outputs.calibration import DrawingCalibration
from mjrun.outputs.drawing_files import DrawingFile, camera_names, frame_size, unused_options
from mjrun.outputs.frame_schedule import FrameSchedule
from mjrun.outputs.overlay_probes import FrameValues, OverlayProbes, empty_overlay, overlay_probes
from mjrun.outputs.scene_decorations import SceneDecorations, scene_decorations
from mjrun.outputs.shared_rendering import RendererRequest, SharedRendering
from mjrun.outputs.task import Context
from mjrun.outputs.view import RENDERERS, visual_of
from mjrun.physics.observe import AnyTap, Tap
from mjrun.physics.state_buffer import StateBuffer
from mjrun.rendering.backend import Backend
from mjrun.rendering.classic import check_size
from mjrun.rendering.compositor import FrameStream, Overlay, SceneCompositor
from mjrun.rendering.decorations import Decoration
from mjrun.rendering.filament import check_segmentation, check_visual, omissions
from mjrun.rendering.segmentation import Segmentation
from mjrun.timeline import Timeline


@dataclass(frozen=True)
class DrawingPlan:
    """What a video or an image draws, with every name found in the model.

    Attributes:
      motions: of each camera.
      overlay: without content; its size is known.
    """

    options: ViewOptions
    context: Context
    motions: Sequence[CameraMotion]
    decorations: SceneDecorations
    probes: OverlayProbes
    overlay: Overlay

    @property
    def scripts(self) -> list[CameraScript]:
        """The script of each camera."""
        return [motion.script for motion in self.motions]

    @property
    def enable_flags(self) -> int:
        """Flags of MuJoCo's that must be set for what is measured."""
        return self.probes.model.opt.enableflags

    def backend(self, rendering: SharedRendering, files: Sequence[DrawingFile], plots: Sequence[str] = ()) -> Backend:
        """What draws; warns of what it leaves out, and of options that files of numbers have no room for.

        Raises:
          RendererError: nothing can draw here.
          UsageError: the backend cannot draw this, or not that large.
        """
        options, reporter = self.options, self.context.reporter
        backend = rendering.backend(RendererRequest.of(options))
        replay_remarks = self.context.simulation.replay_remarks(self.context.model)
        remarks = [text for text in self.decorations.remarks if text not in replay_remarks]
        warnings = [*check_drawing(options, self.context.model, backend), *remarks]
        for text in [*warnings, *(unused_options(options, plots) if all(file.exact for file in files) else [])]:
            reporter.warn(text)
        return backend

    def calibration(self, files: Sequence[DrawingFile], numbers: bool, stack: ExitStack) -> DrawingCalibration | None:
        """The open calibration file, if one is asked for; `numbers` says whether depth is in 16-bit pictures."""
        if self.options.calibration is None:
            return None
        calibration = DrawingCalibration(self.options, self.motions, files, numbers)
        stack.enter_context(calibration.writer)
        return calibration


def plan_drawing(options: ViewOptions, context: Context, plots: Sequence[str] = (), side: str = "under") -> DrawingPlan:
    """Finds every name in the model.

    Args:
      plots: values to plot, a graph for each, on this `side`.

    Raises:
      UsageError: a name that is not there, or a value that cannot be.
    """
    model = context.model
    with context.simulation.source.named_in_errors():
        motions = camera_motions(options, model)
    corner = options.text_corner or ("bottom-right" if options.captions else "top-left")
    return DrawingPlan(
        options=options,
        context=context,
        motions=motions,
        decorations=scene_decorations(options, model, context.simulation),
        probes=overlay_probes(model, context.timeline, options.text, plots, context.episode),
        overlay=empty_overlay(frame_size(options), corner, plots, side),
    )


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


class FrameRecorder:
    """Keeps what the frames of a schedule are drawn from: states, states on trails, and values in overlays.

    Args:
      observed: how much of the simulation trails show.
      stack: frees the memory.

    Attributes:
      states: of each frame, after the simulation.
    """

    def __init__(self, plan: DrawingPlan, schedule: FrameSchedule, observed: Timeline, stack: ExitStack) -> None:
        self._plan, self._schedule, self._observed = plan, schedule, observed
        self.states = stack.enter_context(StateBuffer(plan.context.model))
        self._trail_states = stack.enter_context(StateBuffer(plan.context.model))
        self._values: list[FrameValues] = []

    @property
    def taps(self) -> Sequence[AnyTap]:
        """Take the states and values while the simulation runs."""
        plan, frames = self._plan, self._schedule.steps
        trail_steps = plan.decorations.trail_steps(self._observed)
        taps: list[AnyTap] = [
            Tap(frames, lambda stepper: stepper.state(), self.states.append),
            Tap(trail_steps, lambda stepper: stepper.state(), self._trail_states.append),
        ]
        if not plan.probes.idle:
            taps.append(Tap(frames, plan.probes.read, self._values.append))
        return taps

    @cached_property
    def times(self) -> Sequence[float]:
        """The simulated time of each frame [s]."""
        return array("d", (float(self._plan.context.timeline.time(step)) for step in self._schedule.steps))

    @cached_property
    def poses(self) -> PoseTable:
        """Of each frame, of each camera.

        Raises:
          UsageError: a camera is at some time where it is to look.
        """
        schedule, count = self._schedule, len(self.states)
        cameras = (
            motion.poses((self.states[k] for k in range(count)), self.times, schedule.times, spans)
            for motion, spans in zip(self._plan.motions, schedule.spans, strict=True)
        )
        return PoseTable(cameras)

    def compositor(self, backend: Backend, files: Sequence[DrawingFile], legend: bool = False) -> SceneCompositor:
        """What draws the frames of `files`; `legend` says whether coloured segmentations list what is in view."""
        plan, schedule = self._plan, self._schedule
        trail_states = (self._trail_states[k] for k in range(len(self._trail_states)))
        decorations = plan.decorations.decorations(trail_states, self.times)
        overlay = plan.probes.overlay(
            plan.overlay, self._values, schedule.steps, schedule.speeds, plan.context.timeline
        )
        streams = [file.stream(plan.options, overlay, legend) for file in files]
        return scene_compositor(plan.options, plan.context.model, backend, streams, self.poses, decorations)

    def calibrate(self, calibration: DrawingCalibration) -> None:
        """Writes what every frame was taken with."""
        for index, (poses, time) in enumerate(zip(self.poses, self.times, strict=True)):
            calibration.write(poses, index, time)


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


def metadata_tags(path: str | None, facts: Mapping[str, object]) -> dict[str, str]:
    """What is embedded in a video or picture: its title, what made it, and all `facts` about it as JSON."""
    made_by = [f"mjrun {facts['mjrun']}", f"MuJoCo {facts['mujoco']}"]
    if "renderer" in facts:
        made_by.append(str(facts["renderer"]))
    title = {} if path is None else {"title": Path(path).stem}
    return {**title, "comment": clean(", ".join(made_by)), "description": dumps(facts)}
