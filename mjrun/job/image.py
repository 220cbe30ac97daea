"""A still: simulate to an instant, and draw it in one view or several."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import KW_ONLY, dataclass
from fractions import Fraction
from pathlib import Path

import mujoco
import numpy as np

from mjrun.camera.pose import Pose
from mjrun.camera.script import Event
from mjrun.errors import BadValueError, UsageError, clean
from mjrun.formats.image_format import image_format
from mjrun.formats.image_writer import ImageWriter
from mjrun.formats.pointcloud import PointCloudWriter
from mjrun.job.calibration import Calibration
from mjrun.job.event_detection import conditions, time_of
from mjrun.job.frame_schedule import events, shot_spans
from mjrun.job.manifest import origin
from mjrun.job.output_files import named
from mjrun.job.overlay import Values, blank, gauges
from mjrun.job.perform import Artifact, Context, Preview, Work, perform
from mjrun.job.simulation import Simulation
from mjrun.job.view import Drawing, painter, tags, unused
from mjrun.model.rendered_view import RenderedView
from mjrun.rendering.compositor import Overlay, Panel, SceneCompositor, Stream, Style
from mjrun.rendering.layout import layout_size
from mjrun.rendering.segmentation import Segmentation
from mjrun.reporter import Reporter
from mjrun.sim.observe import Tap
from mjrun.sim.state_buffer import StateBuffer
from mjrun.timeline import Timeline, nearest, rational

CLOUD = ("rgb", "depth")  # what a point cloud is made of
FILMS = (".mp4", ".mov", ".mkv", ".webm", ".gif", ".apng")
COLORED = "--style color draws colours for the eye"


@dataclass(frozen=True)
class Image(Drawing):
    """What still to make.

    Args:
      simulation: what happens; how long is of no account, unless an event is waited for.
      output: a file, or `-` for stdout.
      at: the instant [s], or an event; the beginning when neither it nor `step` is given.
      step: the instant, by step.
      format: instead of the output's suffix.
      legend: whether a coloured segmentation lists what is in view.
      pointcloud: a .ply file for all that the cameras see, as points in the world, labelled where `seg` is a view.

    The rest is said at `Drawing`. Depth and segmentation are numbers where the file can hold them and shows
    nothing else.
    """

    simulation: Simulation
    output: str
    _: KW_ONLY
    at: float | str | Fraction | Event | None = None
    step: int | None = None
    format: str | None = None
    legend: bool = True
    pointcloud: str | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.at is not None and self.step is not None:
            raise UsageError("--time and --step exclude each other: both say when")
        if self.step is not None and self.step < 0:
            raise BadValueError("--step", self.step, "a whole number from 0 on")

    @property
    def files(self) -> list[tuple[str, str]]:
        """Every file that it writes, with what it is."""
        return [*self.written(self.output), *named(self, "pointcloud")]

    def run(self, reporter: Reporter | None = None) -> "ImageResult":
        """Makes the still. What can fail early fails before the first step.

        Raises:
          MjrunError: nothing was published, and existing outputs are untouched.
        """
        return perform([self], reporter)[0]

    def work(self, stack: ExitStack) -> "StillWork":
        """The work that makes it."""
        return StillWork(self, stack)


@dataclass(frozen=True)
class ImageResult:
    """What still was made.

    Attributes:
      path: where it is; `-` is standard output.
      paths: all files, labels included.
      format: how it is written.
      size: width and height of the picture [pixels].
      time, step: the instant [s].
      clipped: the share of what is seen whose depth the format cannot say.
      renderer, gl, software: who drew, by OpenGL's own name; the backend; whether it is a CPU.
      wall: wall time of all [s].
      warnings: what MuJoCo warned of.
    """

    path: str
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
class _Output:
    """One file: what is in it, and how.

    Attributes:
      view: of the format, `rgb` for anything coloured.
    """

    path: str
    panels: Sequence[Panel]
    view: str
    format: str


class StillWork(Work):
    """A still in the making."""

    def __init__(self, job: Image, stack: ExitStack) -> None:
        self._job = job
        self._outputs = _outputs(job)
        self._search = job.search()  # tries a backend while the model loads
        stack.callback(self._search.cancel)
        self._row: list[Values] = []
        self._state: list[np.ndarray] = []

    def plan(self, ground: Context) -> None:
        job, model = self._job, ground.model
        self._ground = ground
        self._scripts, self._courses = job.scripts(model), job.courses(model)
        shot_events = [*events(self._scripts), *([job.at] if isinstance(job.at, Event) else [])]
        self.conditions = conditions(shot_events, model)
        self._additions = job.additions(model)
        self._gauges = gauges(model, ground.timeline, job.text)
        self.model = self._gauges.model
        self.until = ground.timeline.steps
        if not self.conditions:
            self.settle({})

    def settle(self, happened: Mapping[str, Sequence[int]]) -> None:
        job, ground = self._job, self._ground
        self._step = self.until = _step(job, ground.timeline, happened)
        self._timeline = Timeline.of_steps(ground.timeline.timestep, self._step)
        self._spans = [shot_spans(script, ground.timeline, happened) for script in self._scripts]

    def open(self, stack: ExitStack) -> None:
        job, ground = self._job, self._ground
        self._backend = self._search.result(job.require_gpu)
        exact = all(output.view != "rgb" for output in self._outputs)
        for text in [*job.check(ground.model, self._backend), *(unused(job) if exact else [])]:
            ground.reporter.warn(text)
        timeline = ground.timeline if self.conditions else self._timeline
        self._facts = {**origin(job, job.simulation, ground.model, timeline), "renderer": self._backend.renderer}
        self._sinks: list[ImageWriter] = []
        for output in self._outputs:
            path = None if output.path == "-" else output.path
            size = _stream(job, output, Overlay()).size_of_frame
            sink = ImageWriter(path, output.view, output.format, size, tags(path, self._facts))
            self._sinks.append(stack.enter_context(sink))
        self._calibration = None
        if job.calibration is not None:
            numbers = any(output.view == "depth" and output.format == "png" for output in self._outputs)
            self._calibration = Calibration(job, self._courses, job.output, numbers)
            stack.enter_context(self._calibration.writer)
        self._cloud = _cloud(job, ground.model)
        if self._cloud:
            stack.enter_context(self._cloud)
        self._path = stack.enter_context(StateBuffer(ground.model))

    def taps(self) -> Sequence[Tap]:
        """Keeps the state that is drawn, what is measured there, and the states on the path of trails."""
        path, here = self._additions.steps(self._timeline), [self._step]
        taps: list[Tap] = [Tap(path, lambda stepper: stepper.state(), self._path.append)]
        taps.append(Tap(here, lambda stepper: stepper.state(), self._state.append))
        taps.append(Tap(here, self._gauges.read, self._row.append))
        return taps

    def outline(self) -> Preview:
        output = self._outputs[0]
        when = "at an event" if self.conditions else f"at {float(self._timeline.duration):g} s"
        about = f"{output.format}, {when}, {' and '.join(self._job.names)}"
        size = _stream(self._job, output, Overlay()).size_of_frame
        return Preview("still", self._job.output, 1, "picture", size, about)

    def finish(self, wall: float) -> Artifact:
        job, (state,), moment = self._job, self._state, float(self._timeline.duration)
        size = layout_size(1 if job.separate else len(job.panels), job.size, job.layout)
        overlay = self._gauges.overlay(blank(size, job.corner), self._row, [self._step], [1.0], self._timeline)
        streams = [_stream(job, output, overlay) for output in self._outputs]
        decors = self._additions.decors((self._path[k] for k in range(len(self._path))), [moment])
        drawn = painter(job, self._ground.model, self._backend, streams, [self._poses(state, moment)], decors)
        try:
            drawn.open()
            if not drawn.ranges and any(panel.view == "depth" for panel in job.panels):
                drawn.look_ahead({0: state})
            pictures = drawn.see(state, 0, [*job.views, *(CLOUD if self._cloud else ())])
        finally:
            drawn.close()
        for output, stream, sink in zip(self._outputs, streams, self._sinks, strict=True):
            _write(output, stream, sink, drawn, pictures)
        if self._calibration:
            self._calibration.write(drawn.poses[0], 0, moment)
        if self._cloud:
            for picture in pictures:
                self._cloud.write(picture)
        written = [*self._sinks, *([self._calibration.writer] if self._calibration else [])]
        files = [file for sink in [*written, *([self._cloud] if self._cloud else [])] for file in sink.publish()]
        clipped = max(sink.clipped for sink in self._sinks)
        if clipped:
            text = f"{clipped:.2%} of what is seen is farther than 65.535 m, the most that 16 bits hold"
            self._ground.reporter.warn(text)
        shown = streams[0].size_of_frame
        return Artifact(self._facts, files, lambda total, heard: self._result(files, shown, clipped, total, heard))

    def _poses(self, state: np.ndarray, moment: float) -> list[Pose]:
        """Of each camera."""
        spans = [[(float(start), float(end)) for start, end in part] for part in self._spans]
        seen = zip(self._courses, spans, strict=True)
        return [pose for course, span in seen for pose in course.poses([state], [moment], [moment], span)]

    def _result(
        self, files: Sequence[Path], size: tuple[int, int], clipped: float, wall: float, heard: Sequence[str]
    ) -> ImageResult:
        return ImageResult(
            path=self._job.output,
            paths=[str(file) for file in files],
            format=self._outputs[0].format,
            size=size,
            time=float(self._timeline.duration),
            step=self._step,
            clipped=clipped,
            renderer=self._backend.renderer,
            gl=self._backend.name,
            software=self._backend.software,
            wall=wall,
            warnings=heard,
        )


def _cloud(job: Image, model: mujoco.MjModel) -> PointCloudWriter | None:
    if job.pointcloud is None:
        return None
    return PointCloudWriter(job.pointcloud, Segmentation(model, job.seg_by).legend if "seg" in job.views else None)


def _outputs(job: Image) -> list[_Output]:
    """Every file with its format: numbers where a lone view is to be, or can be, written as such."""
    found = []
    for path, panels in job.outputs(job.output):
        target, view = None if path == "-" else path, panels[0].view
        if Path(path).suffix.lower() in FILMS:
            raise UsageError(
                f"{clean(path)} would be a film, and mjrun image draws one instant\nmjrun video makes films"
            )
        if len(panels) > 1 and job.style == "exact":
            raise UsageError("--style exact: numbers cannot share a picture; add --separate for a file each")
        alone = len(panels) == 1 and view != "rgb"
        exact = alone and (job.style == "exact" or (job.style is None and not _only_colors(path)))
        kind = view if exact else "rgb"
        found.append(_Output(path, panels, kind, image_format(target, kind, job.format, COLORED if exact else "")))
    return found


def _only_colors(path: str) -> bool:
    """Whether a suffix can hold nothing but colours."""
    return Path(path).suffix.lower() in (".jpg", ".jpeg", ".webp")


def _stream(job: Image, output: _Output, overlay: Overlay) -> Stream:
    exact = output.view != "rgb"
    style = Style(job.layout, job.captions, job.legend, Overlay() if exact else overlay)
    return Stream(output.panels, job.size, style, exact)


def _write(
    output: _Output, stream: Stream, sink: ImageWriter, drawn: SceneCompositor, pictures: Sequence[RenderedView]
) -> None:
    picture = pictures[output.panels[0].camera]
    if output.view == "depth":
        assert picture.depth is not None
        sink.write(picture.depth)
    elif output.view == "seg":
        assert picture.ids is not None
        sink.write(picture.ids, picture.legend, drawn.colors)
    else:
        sink.write(np.ascontiguousarray(drawn.frame(stream, pictures, 0)))


def _step(job: Image, timeline: Timeline, happened: Mapping[str, Sequence[int]]) -> int:
    """The step that is drawn."""
    if job.step is not None:
        return job.step
    if isinstance(job.at, Event):
        at = time_of(job.at, happened[job.at.when], timeline, job.output)
        return min(max(nearest(at / timeline.timestep), 0), timeline.steps)
    try:
        at = rational(job.at or 0)
    except ValueError:
        at = Fraction(-1)
    if at < 0:
        raise BadValueError("--time", job.at, "a number of seconds from 0 on")
    return nearest(at / timeline.timestep)
