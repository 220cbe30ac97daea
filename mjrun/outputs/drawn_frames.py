"""The frames of videos and images: planned, recorded and drawn. An image is a video of one frame."""

from collections.abc import Generator, Sequence
from contextlib import ExitStack

import mujoco
import numpy as np

from mjrun.camera.pose import Pose
from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, UsageError, concerning, option
from mjrun.formats.atomic_output import OutputWriter
from mjrun.options.option import options
from mjrun.options.rendering import ViewOptions
from mjrun.outputs.camera_panels import (
    CalibrationOutput,
    VideoOrImageFile,
    camera_names,
    frame_size,
    unused_options,
)
from mjrun.outputs.drawing_processes import DrawingProcesses
from mjrun.outputs.output import Context, EventSteps, OutputResult, PassRenderers, RendererRequest
from mjrun.outputs.overlay_probes import FrameValues, OverlayProbes, empty_overlay, overlay_probes
from mjrun.outputs.recorded_scene import (
    R_co,
    RecordedFrames,
    SceneJob,
    ScenePlan,
    Scheduler,
    check_once,
    check_scene,
    plan_scene,
)
from mjrun.physics.simulation_loop import AnyTap, Tap
from mjrun.rendering.added_geoms import Decoration
from mjrun.rendering.backend import Backend, lacks_gpu
from mjrun.rendering.classic import ClassicRenderer, check_size
from mjrun.rendering.compositor import FrameStream, Overlay, SceneCompositor
from mjrun.rendering.filament import FilamentRenderer, check_segmentation, check_visual, omissions
from mjrun.rendering.segment_ids import Segmentation, check_segmentation_name
from mjrun.rendering.visual import visual_of

DEPTH_SAMPLES = 8  # frames sampled to choose the colour range of depth


RENDERERS = {"classic": ClassicRenderer, "filament": FilamentRenderer}


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
    def enable_flags(self) -> int:
        """MuJoCo enable flags that the measured values require."""
        model = self.probes.model if self.probes else self.scene.context.model
        return model.opt.enableflags

    def size_of(self, file: VideoOrImageFile) -> tuple[int, int]:
        """Returns width and height of the frames in a file [pixels]."""
        return file.stream(self.job, self.overlay).size_of_frame


def plan_frames(
    job: VideoOrImageJob[OutputResult],
    context: Context,
    scheduler: Scheduler,
    plots: Sequence[str] = (),
    side: str = "under",
) -> FramePlan:
    """Resolves every name in the model and schedules the frames unless events decide.

    Args:
      scheduler: schedules the frames, at once unless events decide.
      plots: the values to plot, one graph each, on this `side`.

    Raises:
      UsageError: a name is unknown, or a value invalid.
    """
    scene = plan_scene(job, context, scheduler)
    probes, overlay = None, Overlay()
    if job.text or plots:
        probes = overlay_probes(context.model, context.timeline, job.text, plots, context.episode)
        corner = job.text_corner or ("bottom-right" if job.captions else "top-left")
        overlay = empty_overlay(frame_size(job), corner, plots, side)
    return FramePlan(job, scene, plots, probes, overlay)


class DrawnFrames(RecordedFrames):
    """The frames of a video or an image, recorded during the simulation and drawn after it.

    Args:
      files: the files that the frames are written to.
      jobs: the number of processes, or `auto`.

    Attributes:
      backend: the detected backend.
      facts: facts for the manifest.
      processes: the processes that draw.
    """

    def __init__(
        self,
        plan: FramePlan,
        files: Sequence[VideoOrImageFile],
        stack: ExitStack,
        renderers: PassRenderers,
        jobs: int | str = 1,
    ) -> None:
        super().__init__(plan.scene, stack)
        job, schedule = plan.job, plan.scene.schedule
        self._plan, self._files, self._stack = plan, files, stack
        self.processes = DrawingProcesses(job, jobs, renderers, self._reporter)
        if schedule and lacks_gpu():
            self.processes.start(len(schedule.steps), software=True)  # while the backend is being detected
        self.backend = renderers.backend(job.renderer_request)
        if schedule:
            self.processes.start(len(schedule.steps), software=self.backend.software)
        for text in self._warnings():
            self._reporter.warn(text)
        facts = plan.scene.context.facts(job, schedule.observed if schedule else None)
        self.facts = {**facts, "renderer": self.backend.renderer}
        self._values: list[FrameValues] = []
        self._calibration: CalibrationOutput | None = None

    def taps(self, event_steps: EventSteps) -> Sequence[AnyTap]:
        taps, probes = [*super().taps(event_steps)], self._plan.probes
        if probes and not probes.idle:
            taps.append(Tap(self.schedule.steps, probes.read, self._values.append))
        return taps

    def compositor(self, legend: bool = False) -> SceneCompositor:
        """Returns the compositor of all files, once the scene is placed.

        Args:
          legend: coloured segmentations list what is in view.
        """
        plan, overlay, schedule = self._plan, self._plan.overlay, self.schedule
        if plan.probes:
            overlay = plan.probes.overlay(
                overlay, self._values, schedule.steps, schedule.speeds, plan.scene.context.timeline
            )
        streams = [file.stream(plan.job, overlay, legend) for file in self._files]
        return scene_compositor(plan.job, self.model, self.backend, streams, self.poses, self.decorations())

    def images(self, compositor: SceneCompositor) -> Generator[Sequence[np.ndarray]]:
        """Draws every frame, and yields its pixels in each file, which are valid until the next one is requested.

        Raises:
          MjrunError: a frame cannot be rendered.
        """
        self._choose_depth_colours(compositor)
        total = len(self.states)
        for index, frame in enumerate(self.processes.frames(compositor, self.states, self.backend)):
            yield compositor.parts(frame)
            self._reporter.progress("frames", index + 1, total)

    def open_calibration(self, numbers: bool) -> None:
        """Opens the calibration file if requested; `numbers` states that depth is stored as 16-bit images."""
        if self._plan.job.calibration is not None:
            self._calibration = CalibrationOutput(self._plan.job, self._scene.motions, self._files, numbers)
            self._stack.enter_context(self._calibration.writer)

    def calibrate(self) -> list[OutputWriter]:
        """Writes the calibration of every frame, and returns its writer if calibration was requested."""
        if self._calibration is None:
            return []
        for index, (poses, time) in enumerate(zip(self.poses, self.times, strict=True)):
            self._calibration.write(poses, index, time)
        return [self._calibration.writer]

    def _choose_depth_colours(self, compositor: SceneCompositor) -> None:
        """Chooses the colour range of depth from sampled frames, unless a range was set."""
        coloured = any(panel.view == "depth" and not s.exact for s in compositor.streams for panel in s.panels)
        if coloured and not compositor.ranges:
            compositor.open()
            chosen = dict.fromkeys(np.linspace(0, len(self.states) - 1, DEPTH_SAMPLES).astype(int).tolist())
            compositor.choose_ranges({index: self.states[index] for index in chosen})

    def _warnings(self) -> list[str]:
        """Returns warnings about what the renderer omits, and about options without effect."""
        job, context = self._plan.job, self._scene.context
        replay_remarks = context.simulation.replay_remarks(context.model)
        remarks = [text for each in self._scene.decorations for text in each.remarks if text not in replay_remarks]
        unused = unused_options(job, self._plan.plots) if all(file.exact for file in self._files) else []
        return [*check_drawing(job, context.model, self.backend), *remarks, *unused]


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
    check_once("view", options.view)


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
