"""The frames of videos and images: planned, recorded and drawn. An image is a video of one frame."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from itertools import accumulate, pairwise

import mujoco
import numpy as np

from mjrun.camera.pose import CameraPose
from mjrun.camera.script import ConditionEvent
from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, OptionPath, UsageError, clean, concerning, option, quoted
from mjrun.options.number_kinds import AUTO
from mjrun.options.option import options
from mjrun.options.rendering import RendererOptions, ViewOptions
from mjrun.outputs.camera_panels import VideoOrImageFile, camera_names, frame_size, panels_of, unused_options
from mjrun.outputs.output import OutputResult, PassContext, R_co, RenderingResources
from mjrun.outputs.recorded_scene import (
    FrameSchedule,
    RecordedScene,
    SceneOutputRequest,
    ScenePlan,
    SceneStates,
    check_once,
    check_scene,
    open_states,
    place_scene,
    plan_scene,
    state_taps,
)
from mjrun.outputs.trace_rows import ProbeSampler
from mjrun.physics.recorded_states import SpooledRows
from mjrun.physics.simulation_loop import StateBuffer, Tap
from mjrun.physics.stepper import Stepper
from mjrun.platform import system
from mjrun.platform.cores import available_cores
from mjrun.probe.episode_columns import EpisodeColumns
from mjrun.probe.select import available_columns, split
from mjrun.probe.vocabularies import ModelVocabulary
from mjrun.rendering.added_geoms import Decoration
from mjrun.rendering.backend import WorkingBackend, lacks_gpu
from mjrun.rendering.classic import check_size
from mjrun.rendering.compositor import FrameCosts, FrameSpec, SceneCompositor, TextAndLivePlots
from mjrun.rendering.compositor_pool import CompositorPool, CompositorProcesses
from mjrun.rendering.filament import check_segmentation, check_visual, omissions
from mjrun.rendering.live_plot import LivePlot, aligned, live_plot_size
from mjrun.rendering.text import OverlayText, parse_template
from mjrun.rendering.visual import SegmentationIds, check_segmentation_name, visual_of
from mjrun.reporter import Reporter
from mjrun.shared_status import doing
from mjrun.timeline import Timeline

DEPTH_SAMPLES = 8  # frames sampled to choose the colour range of depth
LONG = 2.0  # [s] of rendering on a CPU above which the user is warned
TRIED = 2  # frames after which the cost of one is known: the first also compiles shaders
WORTHWHILE = 0.7  # share of the cost of a frame above which a draft is not recommended
WORTH = 2.0  # [s] of rendering above which more processes save more time than they take to start
FRAME, PIXEL = 0.03, 1e-7  # [s] that llvmpipe takes, roughly, for the shadows of a frame and for each pixel


@dataclass(frozen=True)
class OverlayProbes:
    """The measurement of the values in a text and in plots.

    Attributes:
      text: the template.
      tables: the columns of the text, then those of each plot.
      model: the model with all flags enabled that the measured values require.
    """

    text: OverlayText
    tables: Sequence[ProbeSampler]
    model: mujoco.MjModel

    @property
    def idle(self) -> bool:
        """True if nothing is measured."""
        return all(len(table.columns) == 1 for table in self.tables)

    @property
    def ends(self) -> list[int]:
        """The ends of the values of each table in a row of all of them."""
        return list(accumulate(len(table.columns) - 1 for table in self.tables))

    def read(self, stepper: Stepper) -> np.ndarray:
        """Returns the values of all tables at the stepper's instant."""
        return np.concatenate([table.values(stepper) for table in self.tables])

    def overlay(
        self,
        empty: TextAndLivePlots,
        rows: np.ndarray,
        steps: Sequence[int],
        speeds: Sequence[float],
        timeline: Timeline,
    ) -> TextAndLivePlots:
        """Returns `empty` with its texts and live plots.

        Args:
          rows: the values read at each frame, `(frames, values)`; empty if nothing is measured.
          steps, speeds: step and speed of each frame.
        """
        times = [float(timeline.time(step)) for step in steps]
        texts = self._texts(rows, steps, times, speeds) if self.text.parts else []
        live_plots: list[LivePlot] = []
        for table, (start, end), size in zip(self.tables[1:], pairwise(self.ends), empty.plots, strict=True):
            values = rows[:, start:end]
            names, units = zip(*((column.name, column.unit) for column in table.columns[1:]), strict=True)
            live_plots.append(LivePlot(np.array(times), values, names, units, size))
        return replace(empty, texts=texts, live_plots=aligned(live_plots), times=times)

    def _texts(
        self, rows: np.ndarray, steps: Sequence[int], times: Sequence[float], speeds: Sequence[float]
    ) -> list[str]:
        names = [column.name for column in self.tables[0].columns[1:]]
        texts: list[str] = []
        for index, (step, time, speed) in enumerate(zip(steps, times, speeds, strict=True)):
            row = dict(zip(names, rows[index, : len(names)].tolist(), strict=True)) if names else {}
            texts.append(self.text.filled({**row, "time": time, "frame": index, "step": step, "speed": speed}))
        return texts


def overlay_probes(
    model: mujoco.MjModel,
    timeline: Timeline,
    text: str | None,
    plots: Sequence[str] = (),
    episode: EpisodeColumns | None = None,
) -> OverlayProbes:
    """Returns the probes for the values in `text` and in each of `plots`.

    Raises:
      UnknownNameError: a value cannot be measured.
      UsageError: a plot selects no column.
    """
    with concerning("text"):
        columns = [column.name for column in available_columns(model, episode)] if text else []
        vocabulary = ModelVocabulary(model)
        template = parse_template(text, columns, vocabulary.is_pair) if text else OverlayText([])
        tables = [ProbeSampler(model, template.columns, timeline, episode)]
    for index, plot in enumerate(plots):
        with concerning("plot", index):
            tables.append(ProbeSampler(tables[-1].model, split(plot), timeline, episode))
            if len(tables[-1].columns) == 1:
                raise UsageError(f"{option('plot')} {quoted(plot)}: this model has no such values")
    return OverlayProbes(template, tables, tables[-1].model)


def empty_overlay(
    size: tuple[int, int], corner: str, plots: Sequence[str] = (), side: str = "under"
) -> TextAndLivePlots:
    """Returns an overlay without content, whose size is known.

    Args:
      size: width and height of the frame without the overlay [pixels].
    """
    return TextAndLivePlots(corner=corner, plots=[live_plot_size(size, side)] * len(plots), side=side)


@options
class VideoOrImageRequest(ViewOptions, SceneOutputRequest[R_co]):
    """A requested video or image."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_view(self)

    @property
    def renderer_options(self) -> RendererOptions:
        return self

    @property
    def is_measured(self) -> bool:
        """True if the frames measure what exists, and must not show what the simulation lacks unless requested."""
        return any(view != "rgb" for view in self.view)


@dataclass(frozen=True)
class FramePlan:
    """The plan of frames: their content, with every name resolved in the model.

    Attributes:
      scene: the scene.
      plots: the values to plot.
      probes: the measurement of the values in a text and in plots, or None.
      overlay: the overlay without content, whose size is known.
    """

    request: VideoOrImageRequest[OutputResult]
    scene: ScenePlan
    plots: Sequence[str]
    probes: OverlayProbes | None
    overlay: TextAndLivePlots

    @property
    def enable_flags(self) -> int:
        """MuJoCo enable flags that the measured values require."""
        model = self.probes.model if self.probes else self.scene.context.model
        return model.opt.enableflags

    def size_of(self, file: VideoOrImageFile) -> tuple[int, int]:
        """Returns width and height of the frames in a file [pixels]."""
        return file.frame_spec(self.request, self.overlay).size_of_frame


def plan_frames(
    request: VideoOrImageRequest[OutputResult],
    context: PassContext,
    plots: Sequence[str] = (),
    side: str = "under",
    *,
    events: Mapping[OptionPath, ConditionEvent] | None = None,
) -> FramePlan:
    """Resolves every name in the model.

    Args:
      plots: the values to plot, one live plot each, on this `side`.
      events: events that the output waits for in addition to those of shots, keyed by option path.

    Raises:
      UsageError: a name is unknown, or a value invalid.
    """
    scene = plan_scene(request, context, request.camera, events=events, is_measured=request.is_measured)
    probes, overlay = None, TextAndLivePlots()
    if request.text or plots:
        probes = overlay_probes(context.model, context.timeline, request.text, plots, context.episode)
        corner = request.text_corner or ("bottom-right" if request.captions else "top-left")
        overlay = empty_overlay(frame_size(request), corner, plots, side)
    return FramePlan(request, scene, plots, probes, overlay)


@dataclass(eq=False)
class FrameRecorder:
    """A recorder of the states from which the frames of a video or an image are drawn.

    Attributes:
      schedule: the schedule of the frames; None until events decide.
      files: the files that the frames are written to.
      states: the recorded states.
      values: the values of each frame in a text and in plots.
      backend: the detected backend.
      processes: the processes that draw.
    """

    plan: FramePlan
    schedule: FrameSchedule | None
    files: Sequence[VideoOrImageFile]
    states: SceneStates
    values: SpooledRows
    backend: WorkingBackend
    processes: "DrawingJobs"

    @property
    def facts(self) -> dict[str, object]:
        """Facts for the manifest, from the schedule if it is known."""
        facts = self.plan.scene.context.facts(self.plan.request, self.schedule.observed if self.schedule else None)
        return {**facts, "renderer": self.backend.renderer}

    @property
    def taps(self) -> list[Tap]:
        """The taps that record everything that the frames show; none until the schedule is known."""
        if self.schedule is None:
            return []
        taps, probes = state_taps(self.plan.scene, self.schedule, self.states), self.plan.probes
        if probes and not probes.idle:
            taps.append(Tap(self.schedule.steps, lambda stepper: self.values.append(probes.read(stepper))))
        return taps

    def place(self) -> RecordedScene:
        """Returns the scene at the frames that were recorded."""
        assert self.schedule
        return place_scene(self.plan.scene, self.schedule, self.states)


def open_frame_recorder(
    plan: FramePlan,
    schedule: FrameSchedule | None,
    files: Sequence[VideoOrImageFile],
    stack: ExitStack,
    backends: RenderingResources,
    jobs: int | str = 1,
) -> FrameRecorder:
    """Makes room for the states of frames, waits for the backend, and starts the processes that draw.

    Args:
      schedule: the schedule of the frames; None if events decide.
      files: the files that the frames are written to.
      jobs: the number of processes, or `auto`.

    Raises:
      RendererError: no backend works.
      UsageError: the renderer does not support the options.
    """
    context = plan.scene.context
    states = open_states(plan.scene, stack)
    values = stack.enter_context(closing(SpooledRows(plan.probes.ends[-1] if plan.probes else 0)))
    processes = DrawingJobs(plan.request, jobs, backends, context.reporter)
    if schedule and lacks_gpu():
        processes.start_if_worthwhile(len(schedule.steps), software=True)  # while the backend is being detected
    backend = backends.backend(plan.request)
    if schedule:
        processes.start_if_worthwhile(len(schedule.steps), software=backend.software)
    for text in _drawing_warnings(plan, files, backend):
        context.reporter.warn(text)
    return FrameRecorder(plan, schedule, files, states, values, backend, processes)


def _drawing_warnings(plan: FramePlan, files: Sequence[VideoOrImageFile], backend: WorkingBackend) -> list[str]:
    """Returns warnings about what the renderer omits, and about options without effect."""
    request, context = plan.request, plan.scene.context
    replay_remarks = context.simulation.replay_remarks(context.model)
    remarks = [text for each in plan.scene.decorations for text in each.remarks if text not in replay_remarks]
    unused = unused_options(request, plan.plots, is_exact=all(file.exact for file in files))
    return [*check_drawing(request, context.model, backend), *remarks, *unused]


def frame_compositor(recorder: FrameRecorder, scene: RecordedScene, *, legend: bool = False) -> SceneCompositor:
    """Returns the compositor of all files.

    Args:
      legend: coloured segmentations list what is in view.
    """
    plan, overlay, schedule = recorder.plan, recorder.plan.overlay, scene.schedule
    if plan.probes:
        timeline = plan.scene.context.timeline
        values = recorder.values.read(0, len(recorder.values))
        overlay = plan.probes.overlay(overlay, values, schedule.steps, schedule.speeds, timeline)
    specs = [file.frame_spec(plan.request, overlay, legend) for file in recorder.files]
    return scene_compositor(plan.request, scene.model, recorder.backend, specs, scene.poses, scene.decorations)


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
    backend: WorkingBackend,
    specs: Sequence[FrameSpec],
    poses: Sequence[Sequence[CameraPose]],
    decorations: Sequence[Decoration] = (),
) -> SceneCompositor:
    """Returns the compositor that renders `specs`; `poses` holds the poses of every camera for each frame."""
    return SceneCompositor(
        model=model,
        backend=backend,
        size=options.size,
        visual=visual_of(options),
        names=camera_names(options),
        poses=poses,
        specs=specs,
        segmentation=SegmentationIds(model, options.seg_by) if "seg" in options.view else None,
        decorations=decorations,
        ranges=[options.depth_range] * len(options.camera) if options.depth_range else [],
        renderer=options.renderer,
    )


def check_drawing(options: ViewOptions, model: mujoco.MjModel, backend: WorkingBackend) -> list[str]:
    """Checks that the renderer can render this, and returns warnings about what it omits.

    Raises:
      UsageError: the renderer does not support these options or this size.
    """
    check_size(options.size, backend, visual_of(options))
    if options.renderer != "filament":
        return []
    check_visual(model, visual_of(options))
    check_segmentation(SegmentationIds(model, options.seg_by) if "seg" in options.view else None)
    return omissions(model, visual_of(options))


class DrawingJobs:
    """The processes that draw the frames of one output.

    If the number of frames alone justifies several, they start before anything is ready to render. Otherwise this
    process renders the first frames, and their cost decides who renders the rest.

    Args:
      options: what the frames show.
      asked: the number of processes, or `auto`.

    Attributes:
      count: the number of processes that render; 1 is this process.
      others: the processes that render instead of this one, if any.
    """

    def __init__(
        self, options: ViewOptions, asked: int | str, backends: RenderingResources, reporter: Reporter
    ) -> None:
        # Filament's noise continues from frame to frame: only a single process makes the same video each time.
        self._asked = 1 if asked == AUTO and options.renderer == "filament" else asked
        self._cost = estimated_cost(options.size, len(panels_of(options)))
        self._backends, self._reporter = backends, reporter
        self.others: CompositorProcesses | None = None
        self.count = 1

    def start_if_worthwhile(self, frames: int, *, software: bool, cost: float | None = None) -> None:
        """Starts as many processes as pay off for this number of frames, unless some are already running.

        Args:
          cost: the measured wall time of a frame [s], if known.

        Raises:
          BadValueError: the requested number of processes is invalid.
          DrawError: the processes cannot be started.
        """
        if self.others is None:
            cores = available_cores() if system.PASSES_DESCRIPTORS else 1  # by which the processes share memory
            self.count = jobs_for(self._asked, software, frames, cost or self._cost, cores)
            self.others = self._backends.workers(self.count) if self.count > 1 else None

    def report_costs(self, backend: WorkingBackend, frames: int, costs: FrameCosts, *, alone: bool) -> None:
        """Reports the cost of slow software rendering: of a frame, of all, and of a draft."""
        whole = frames * costs.frame
        if whole < LONG:
            return
        if self.count > 1:
            # A single process renders with more threads than one of several.
            total = f"less than {whole:.0f}" if alone else f"about {whole / self.count:.0f}"
            by = f" by {self.count} processes"
        else:
            total, by = f"about {whole:.0f}", ""
        text = f"software rendering ({clean(backend.renderer)}): {1e3 * costs.frame:.0f} ms per frame, "
        text += f"{total} s in total{by}"
        if costs.draft is not None and costs.draft < WORTHWHILE * costs.frame:
            draft = f"{option('quality')} draft takes about {1e3 * costs.draft:.0f} ms"
            text += f"; {draft}, without shadows and reflections"
        self._reporter.note(text)


class FrameDrawer:
    """A drawer of recorded frames, one after the other, in this process or in others. To be closed.

    Raises:
      MjrunError: the frames sampled for the colours of depth cannot be rendered, or no processes can be started.
    """

    def __init__(self, recorder: FrameRecorder, scene: RecordedScene, compositor: SceneCompositor) -> None:
        self._compositor, self._states = compositor, scene.states
        self._processes, self._backend = recorder.processes, recorder.backend
        self._reporter = recorder.plan.scene.context.reporter
        self._drawn = 0  # the number of frames so far
        self._frame = np.empty(compositor.bytes, np.uint8)
        self._pool: CompositorPool[SceneCompositor] | None = None
        self._drawn_by_others: Iterator[np.ndarray] = iter(())
        self._is_reported = not recorder.backend.software  # the cost of a frame
        _choose_depth_colours(compositor, scene.states)
        self._processes.start_if_worthwhile(len(scene.states), software=recorder.backend.software)

    def draw(self) -> Sequence[np.ndarray]:
        """Draws the next frame, and returns its pixels in each file, which are valid until the next one is drawn.

        Raises:
          MjrunError: the frame cannot be rendered.
        """
        frame = self._next_from_others() if self._processes.others else self._draw_here()
        self._drawn += 1
        self._reporter.progress("frames", self._drawn, len(self._states))
        return self._compositor.parts(frame)

    def close(self) -> None:
        """Frees the renderer of this process, or the other processes."""
        if self._pool:
            if self._drawn == len(self._states):
                next(self._drawn_by_others, None)  # waits for the cost of a frame, if it was asked for
            self._pool.close()
            self._report(self._pool.answer, alone=False)
        self._compositor.close()

    def _draw_here(self) -> np.ndarray:
        """Renders the next frame in this process; the cost of the first ones may start other processes."""
        with doing("drawing"):
            self._compositor.open()
            self._compositor.compose(self._states[self._drawn], self._drawn, self._frame)
        if self._drawn + 1 == TRIED and self._backend.software:
            costs = self._compositor.costs()
            self._processes.start_if_worthwhile(len(self._states) - TRIED, software=True, cost=costs.frame)
            self._report(costs, alone=True)
        return self._frame

    def _next_from_others(self) -> np.ndarray:
        """Returns the next frame from other processes, which draw ahead."""
        if self._pool is None:
            self._compositor.close()
            compositor, processes, first = self._compositor, self._processes, self._drawn
            self._pool = CompositorPool(compositor, (compositor.bytes,), processes.count, workers=processes.others)
            states = (self._states[index] for index in range(first, len(self._states)))
            self._drawn_by_others = iter(self._pool.frames(states, first))
        frame = next(self._drawn_by_others)
        if self._drawn + 1 == TRIED and not self._is_reported:
            self._pool.ask(SceneCompositor.costs)
        self._report(self._pool.answer, alone=False)
        return frame

    def _report(self, costs: object, *, alone: bool) -> None:
        """Reports the cost of frames once it is known."""
        if isinstance(costs, FrameCosts) and not self._is_reported:
            self._is_reported = True
            self._processes.report_costs(self._backend, len(self._states), costs, alone=alone)


def _choose_depth_colours(compositor: SceneCompositor, states: StateBuffer) -> None:
    """Chooses the colour range of depth from sampled frames, unless a range was set."""
    coloured = any(panel.view == "depth" and not s.exact for s in compositor.specs for panel in s.panels)
    if coloured and not compositor.ranges:
        compositor.open()
        chosen = dict.fromkeys(np.linspace(0, len(states) - 1, DEPTH_SAMPLES).astype(int).tolist())
        compositor.choose_ranges({index: states[index] for index in chosen})


def estimated_cost(size: tuple[int, int], panels: int = 1) -> float:
    """Estimates the wall time of a frame [s], before one is measured; `size` is that of a panel [pixels]."""
    return panels * (FRAME + PIXEL * math.prod(size))


def jobs_for(asked: int | str, software: bool, frames: int, cost: float, cores: int) -> int:
    """Returns the number of processes that render a video.

    `auto` means one on a GPU, which processes would only share, and one for a video that takes less than `WORTH`
    seconds; else one per core. A process takes half a second of its core to start, and llvmpipe has its own threads:
    on two cores, two processes save a tenth to a sixth of the time, on more cores more. There are never more
    processes than frames.

    Args:
      asked: the number of processes, or `auto`.
      software: whether a CPU renders.
      cost: wall time to render one frame in one process [s].
      cores: the number of available cores, from `available_cores`.

    Raises:
      BadValueError: `asked` is invalid.
    """
    if asked == AUTO:
        asked = cores if software and frames * cost > WORTH else 1
    if not isinstance(asked, int) or asked < 1:
        raise BadValueError(option("jobs"), asked, f"a number of processes, at least 1, or {AUTO}")
    return max(1, min(asked, frames))
