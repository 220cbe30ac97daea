"""A still: simulate to an instant, and draw it in one view or several."""

import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import KW_ONLY, asdict, dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from mjrun.errors import BadValueError, UsageError, clean
from mjrun.export.image import ImageWriter
from mjrun.export.image_format import image_format
from mjrun.export.manifest import ManifestWriter
from mjrun.export.pointcloud import PointCloudWriter
from mjrun.job.calibration import Calibration
from mjrun.job.drawing import Drawing, painter, tags
from mjrun.job.manifest import origin
from mjrun.job.overlay import blank, gauges
from mjrun.job.report import QuietReporter, Reporter, pass_on
from mjrun.job.simulation import Simulation
from mjrun.model.native import collected_warnings, without_timers
from mjrun.model.picture import Picture
from mjrun.render.backend import Backend
from mjrun.render.painter import Overlay, Panel, ScenePainter, Stream, Style
from mjrun.render.segmentation import Segmentation
from mjrun.sim.observe import Tap, observe
from mjrun.sim.recording import Recording
from mjrun.timeline import Timeline, nearest, rational

CLOUD = ("rgb", "depth")  # what a point cloud is made of
FILMS = (".mp4", ".mov", ".mkv", ".webm", ".gif", ".apng")
COLORED = "--style color draws colours for the eye"


@dataclass(frozen=True)
class Image(Drawing):
    """What still to make.

    Args:
      simulation: what happens; its duration is of no account.
      output: a file, or `-` for stdout.
      at: the instant [s]; the beginning when neither it nor `step` is given.
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
    at: float | str | Fraction | None = None
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

    def run(self, reporter: Reporter | None = None) -> "ImageResult":
        """Makes the still. What can fail early fails before the first step.

        Raises:
          MjrunError: nothing was published, and existing outputs are untouched.
        """
        return _make(self, reporter or QuietReporter())


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


@dataclass(frozen=True)
class _Made:
    """What is known of a still once it is in its place."""

    facts: Mapping[str, Any]
    backend: Backend
    outputs: Sequence[_Output]
    size: tuple[int, int]
    time: float
    step: int
    clipped: float
    files: Sequence[Path]


def _make(job: Image, reporter: Reporter) -> ImageResult:
    start = time.perf_counter()
    with ManifestWriter(job.manifest) as manifest:
        with collected_warnings() as heard, without_timers():
            made = _still(job, reporter)
        pass_on(heard, reporter)
        result = ImageResult(
            path=job.output,
            paths=[str(file) for file in made.files],
            format=made.outputs[0].format,
            size=made.size,
            time=made.time,
            step=made.step,
            clipped=made.clipped,
            renderer=made.backend.renderer,
            gl=made.backend.name,
            software=made.backend.software,
            wall=time.perf_counter() - start,
            warnings=tuple(heard),
        )
        manifest.publish({**made.facts, "result": asdict(result)}, made.files)
    return result


def _still(job: Image, reporter: Reporter) -> _Made:
    with ExitStack() as stack:
        outputs = _outputs(job)
        search = job.search()  # tries a backend while the model loads
        stack.callback(search.cancel)
        model = job.simulation.load()
        step = _step(job, model)
        timeline = Timeline.of_steps(rational(model.opt.timestep), step)
        job.rigs(model)
        added = job.additions(model)
        measures = gauges(model, timeline, job.text)
        stepper = job.simulation.stepper(measures.model)
        for text in job.simulation.remarks(model):
            reporter.warn(text)
        backend = search.result(job.require_gpu)
        for text in job.check(model, backend):
            reporter.warn(text)
        facts = {**origin(job, job.simulation, model, timeline), "renderer": backend.renderer}
        sinks = []
        for output in outputs:
            path = None if output.path == "-" else output.path
            size = _stream(job, output, Overlay()).size_of_frame
            sinks.append(stack.enter_context(ImageWriter(path, output.view, output.format, size, tags(path, facts))))
        calibration = None
        if job.calibration is not None:
            calibration = Calibration(
                job, model, job.output, any(o.view == "depth" and o.format == "png" for o in outputs)
            )
            stack.enter_context(calibration.writer)
        cloud = _cloud(job, model)
        if cloud:
            stack.enter_context(cloud)
        path = stack.enter_context(Recording(model))
        observe(stepper, [Tap(added.steps(timeline), lambda stepper: stepper.state(), path.append)], step)
        overlay = measures.overlay(blank(job.size, job.corner), [measures.read(stepper)], [step], timeline)
        streams = [_stream(job, output, overlay) for output in outputs]
        decors = added.decors((path[k] for k in range(len(path))), [float(timeline.duration)])
        drawn = painter(job, model, backend, streams, [0.0], decors)
        stack.callback(drawn.close)
        drawn.open()
        state = stepper.state()
        if not drawn.ranges and any(panel.view == "depth" for panel in job.panels):
            drawn.look_ahead({0: state})
        pictures = drawn.see(state, 0, [*job.views, *(CLOUD if cloud else ())])
        for output, stream, sink in zip(outputs, streams, sinks, strict=True):
            _write(output, stream, sink, drawn, pictures)
        if calibration:
            calibration.write([picture.lens for picture in pictures], 0, float(timeline.duration))
        if cloud:
            for picture in pictures:
                cloud.write(picture)
        written = [*sinks, *([calibration.writer] if calibration else []), *([cloud] if cloud else [])]
        files = [file for sink in written for file in sink.publish()]
        clipped = max(sink.clipped for sink in sinks)
        if clipped:
            reporter.warn(f"{clipped:.2%} of what is seen is farther than 65.535 m, the most that 16 bits hold")
        size, moment = streams[0].size_of_frame, float(timeline.duration)
        return _Made(facts, backend, outputs, size, moment, step, clipped, files)


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
    output: _Output, stream: Stream, sink: ImageWriter, drawn: ScenePainter, pictures: Sequence[Picture]
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


def _step(job: Image, model: mujoco.MjModel) -> int:
    """The step that is drawn."""
    if job.step is not None:
        return job.step
    try:
        at = rational(job.at or 0)
    except ValueError:
        at = Fraction(-1)
    if at < 0:
        raise BadValueError("--time", job.at, "a number of seconds from 0 on")
    return nearest(at / rational(model.opt.timestep))
