"""A film: simulate and keep the state of every frame, then draw the states into the encoder."""

import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import KW_ONLY, asdict, dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from mjrun.errors import UnknownNameError, UsageError, clean
from mjrun.export.codecs import Encoding, encoding
from mjrun.export.labels import LabelsWriter
from mjrun.export.manifest import ManifestWriter
from mjrun.export.video import FilmWriter
from mjrun.job.calibration import Calibration, lenses
from mjrun.job.decors import Additions
from mjrun.job.drawing import Drawing, painter, tags
from mjrun.job.manifest import origin
from mjrun.job.overlay import Gauges, Values, blank, gauges
from mjrun.job.report import QuietReporter, Reporter, pass_on
from mjrun.job.simulation import Simulation, positive
from mjrun.model.native import collected_warnings, without_timers
from mjrun.model.pixels import MOST
from mjrun.render.backend import Backend
from mjrun.render.cores import AUTO, available_cores, jobs_for
from mjrun.render.graph import SIDES
from mjrun.render.layout import layout_size
from mjrun.render.painter import Overlay, ScenePainter
from mjrun.render.pool import Pool
from mjrun.sim.observe import Tap, observe
from mjrun.sim.recording import Recording
from mjrun.sim.stepper import PhysicsStepper
from mjrun.timeline import Timeline

LOOKS = 8  # frames that are looked at to choose the colours of depth


@dataclass(frozen=True)
class Video(Drawing):
    """What film to make.

    Args:
      simulation: what happens.
      output: a file, a folder, a pattern such as `frame_%04d.png`, or `-` for stdout.
      fps: frames per second of the film; 30, or 25 in a GIF, when None.
      speed: simulated seconds per second of film; below 1 is slow motion.
      format, codec, crf, preset: how it is encoded; chosen by the output's suffix when None.
      plot: values to plot under the film, a graph for each: `energy`, `qpos[left_*]`.
      plot_side: where graphs stand: `under` or `beside`.
      jobs: processes that draw; `auto` is one on a GPU or for a short film, else one per core.

    The rest is said at `Drawing`.
    """

    simulation: Simulation
    output: str
    _: KW_ONLY
    fps: float | str | Fraction | None = None
    speed: float | str | Fraction = 1
    format: str | None = None
    codec: str | None = None
    crf: int | None = None
    preset: str | None = None
    plot: Sequence[str] = ()
    plot_side: str = "under"
    jobs: int | str = AUTO

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.plot_side not in SIDES:
            raise UnknownNameError("side", self.plot_side, SIDES, where="--plot-side")
        if self.plot and self.separate:
            raise UsageError("--plot stands under one picture; it does not go with --separate")

    def run(self, reporter: Reporter | None = None) -> "VideoResult":
        """Makes the film. What can fail early fails before the first step.

        Raises:
          MjrunError: nothing was published, and an existing output is untouched.
        """
        return _make(self, reporter or QuietReporter())


@dataclass(frozen=True)
class VideoResult:
    """What film was made.

    Attributes:
      path: where it is; `-` is standard output.
      paths: all of them, if there are several.
      format, codec: how it is encoded.
      size: width and height of the film [pixels], padding included.
      frames, fps, duration: number, rate, and length of the film [s].
      simulated, steps: simulated time [s] and steps taken.
      jobs: processes that drew.
      renderer, gl, software: who drew, by OpenGL's own name; the backend; whether it is a CPU.
      simulation_wall, draw_wall, wall: wall time of stepping, of drawing and encoding, of all [s].
      warnings: what MuJoCo warned of.
    """

    path: str
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
    wall: float
    warnings: Sequence[str]


@dataclass(frozen=True)
class _Plan:
    """A Video with every name found and every number checked."""

    model: mujoco.MjModel
    stepper: PhysicsStepper
    timeline: Timeline
    fps: Fraction
    speed: Fraction
    frames: Sequence[int]
    gauges: Gauges
    encodings: Sequence[Encoding]
    overlay: Overlay
    additions: Additions

    @property
    def phases(self) -> list[float]:
        """How far along the simulation each frame is, from 0 to 1."""
        return [float(self.timeline.time(step) / self.timeline.duration) for step in self.frames]


@dataclass(frozen=True)
class _Made:
    """What is known of a film once it is in its place."""

    plan: _Plan
    facts: Mapping[str, Any]
    backend: Backend
    size: tuple[int, int]
    jobs: int
    files: Sequence[Path]
    simulation_wall: float
    draw_wall: float


def _make(job: Video, reporter: Reporter) -> VideoResult:
    start = time.perf_counter()
    with ManifestWriter(job.manifest) as manifest:
        with collected_warnings() as heard, without_timers():
            made = _film(job, reporter)
        pass_on(heard, reporter)
        plan = made.plan
        padding = plan.encodings[0].padding(*made.size)
        result = VideoResult(
            path=job.output,
            paths=[path for path, _ in job.outputs(job.output)],
            format=plan.encodings[0].format,
            codec=plan.encodings[0].codec,
            size=(made.size[0] + padding[0], made.size[1] + padding[1]),
            frames=len(plan.frames),
            fps=float(plan.fps),
            duration=float(len(plan.frames) / plan.fps),
            simulated=float(plan.timeline.duration),
            steps=plan.timeline.steps,
            jobs=made.jobs,
            renderer=made.backend.renderer,
            gl=made.backend.name,
            software=made.backend.software,
            simulation_wall=made.simulation_wall,
            draw_wall=made.draw_wall,
            wall=time.perf_counter() - start,
            warnings=tuple(heard),
        )
        manifest.publish({**made.facts, "result": asdict(result)}, made.files)
    return result


def _film(job: Video, reporter: Reporter) -> _Made:
    with ExitStack() as stack:
        encodings = _encodings(job)
        search = job.search()  # tries a backend while the model loads
        stack.callback(search.cancel)
        plan = _plan(job, encodings)
        for text in job.simulation.remarks(plan.model):
            reporter.warn(text)
        backend = search.result(job.require_gpu)
        for text in job.check(plan.model, backend):
            reporter.warn(text)
        count = len(plan.frames)
        made_by = {"frames": count, "renderer": backend.renderer}
        facts = {**origin(job, job.simulation, plan.model, plan.timeline), **made_by}
        streams = job.streams(with_legend=False, overlay=plan.overlay)
        films = []
        for (path, _), encoded, stream in zip(job.outputs(job.output), encodings, streams, strict=True):
            size = stream.size_of_frame
            _remark_padding(encoded, size, reporter)
            target = None if path == "-" else path
            films.append(stack.enter_context(FilmWriter(target, encoded, size, plan.fps, count, tags(target, facts))))
        legends = []
        for (path, panels), stream in zip(job.outputs(job.output), streams, strict=True):
            if path != "-" and [panel.view for panel in panels] == ["seg"]:
                legends.append((stack.enter_context(LabelsWriter(path)), stream))
        calibration = None
        if job.calibration is not None:
            calibration = Calibration(job, plan.model, job.output, job.style == "exact")
            stack.enter_context(calibration.writer)
        recording = stack.enter_context(Recording(plan.model))
        path = stack.enter_context(Recording(plan.model))
        simulation_wall, rows = _simulate(plan, recording, path)
        overlay = plan.gauges.overlay(plan.overlay, rows, plan.frames, plan.timeline)
        streams = job.streams(with_legend=False, overlay=overlay)
        start = time.perf_counter()
        decors = plan.additions.decors(
            (path[k] for k in range(len(path))), [float(plan.timeline.time(step)) for step in plan.frames]
        )
        drawn = painter(job, plan.model, backend, streams, plan.phases, decors)
        jobs = _draw(job, drawn, recording, films, reporter)
        if calibration:
            _calibrate(job, plan, recording, calibration)
        for legend, stream in legends:
            legend.write(job.size, drawn.segmentation.legend, None if stream.exact else drawn.colors)
        written = [*films, *(legend for legend, _ in legends), *([calibration.writer] if calibration else [])]
        files = [file for sink in written for file in sink.publish()]
        size = streams[0].size_of_frame
        return _Made(plan, facts, backend, size, jobs, files, simulation_wall, time.perf_counter() - start)


def _encodings(job: Video) -> list[Encoding]:
    """How each output is encoded."""
    found = []
    for (path, panels), stream in zip(job.outputs(job.output), job.streams(False, Overlay()), strict=True):
        coded = all(panel.view == "seg" for panel in panels)
        content = "exact" if stream.exact else "ids" if coded else "film"
        target = None if path == "-" else path
        found.append(encoding(target, job.format, job.codec, job.crf, job.preset, content))
    return found


def _plan(job: Video, encodings: Sequence[Encoding]) -> _Plan:
    fps = encodings[0].fps if job.fps is None else positive("--fps", job.fps)
    speed = positive("--speed", job.speed)
    for encoded in encodings:
        encoded.check_fps(fps)
    model = job.simulation.load()
    timeline = job.simulation.timeline(model)
    job.rigs(model)
    measures = gauges(model, timeline, job.text, job.plot)
    stepper = job.simulation.stepper(measures.model)
    size = layout_size(1 if job.separate else len(job.panels), job.size, job.layout)
    overlay = blank(size, job.corner, job.plot, job.plot_side, speed)
    frames = timeline.frames(fps, speed)
    return _Plan(model, stepper, timeline, fps, speed, frames, measures, encodings, overlay, job.additions(model))


def _remark_padding(encoded: Encoding, size: tuple[int, int], reporter: Reporter) -> None:
    padding = encoded.padding(*size)
    if any(padding):
        width, height = size
        padded = f"{width + padding[0]}x{height + padding[1]}"
        reporter.note(f"{encoded.codec} needs even sides: the film is padded from {width}x{height} to {padded}")


def _simulate(plan: _Plan, recording: Recording, path: Recording) -> tuple[float, list[Values]]:
    """Runs the whole simulation, keeps every frame's state, and those on the path of trails.

    Returns the wall time [s], and what is measured at each frame.
    """
    start, rows = time.perf_counter(), []
    taps: list[Tap] = [Tap(plan.frames, lambda stepper: stepper.state(), recording.append)]
    taps.append(Tap(plan.additions.steps(plan.timeline), lambda stepper: stepper.state(), path.append))
    if not plan.gauges.idle:
        taps.append(Tap(plan.frames, plan.gauges.read, rows.append))
    observe(plan.stepper, taps, plan.timeline.steps)
    return time.perf_counter() - start, rows


def _calibrate(job: Video, plan: _Plan, recording: Recording, calibration: Calibration) -> None:
    """Writes what every frame is seen through."""
    states = (recording[k] for k in range(len(recording)))
    seen = lenses(plan.model, job.rigs(plan.model), job.size, states, plan.phases)
    for index, (step, through) in enumerate(zip(plan.frames, seen, strict=True)):
        calibration.write(through, index, float(plan.timeline.time(step)))


def _draw(
    job: Video, drawn: ScenePainter, recording: Recording, films: Sequence[FilmWriter], reporter: Reporter
) -> int:
    """Draws every frame into the films, and returns the number of processes that did."""
    total = len(recording)
    cost = _rehearse(drawn, recording, reporter)
    # Filament's noise goes on from frame to frame: only one process makes the same film each time.
    asked = 1 if job.jobs == AUTO and job.renderer == "filament" else job.jobs
    jobs = jobs_for(asked, drawn.backend.software, total, cost, available_cores())
    if jobs > 1:
        drawn.close()
    far = [stream.exact and stream.panels[0].view == "depth" for stream in drawn.streams]
    clipped = 0
    with Pool(drawn, (drawn.bytes,), jobs) as pool:
        for index, frames in enumerate(pool.frames(recording[k] for k in range(total))):
            for film, part, depth in zip(films, drawn.parts(frames), far, strict=True):
                film.write(part)
                clipped += np.count_nonzero(part == MOST) if depth else 0
            reporter.progress("frames", index + 1, total)
    if clipped:
        share = clipped / (total * sum(far) * job.size[0] * job.size[1])
        reporter.warn(f"{share:.2%} of the pixels are at 65.535 m or farther, the most that 16 bits hold")
    return jobs


def _rehearse(drawn: ScenePainter, recording: Recording, reporter: Reporter) -> float | None:
    """Chooses the colours of depth, and tells what a frame costs where a CPU draws: wall time [s]."""
    total, cost = len(recording), None
    colored = any(panel.view == "depth" and not stream.exact for stream in drawn.streams for panel in stream.panels)
    if colored and not drawn.ranges:
        drawn.open()
        chosen = dict.fromkeys(np.linspace(0, total - 1, LOOKS).astype(int).tolist())
        drawn.look_ahead({index: recording[index] for index in chosen})
    if drawn.backend.software:
        drawn.open()
        frames = np.empty(drawn.bytes, np.uint8)
        for index in (0, min(1, total - 1)):  # frame 0 also compiles the shaders
            before = time.perf_counter()
            drawn.paint(recording[index], index, frames)
            cost = time.perf_counter() - before
        reporter.warn(_software_cost(drawn, cost or 0.0, total))
    return cost


def _software_cost(drawn: ScenePainter, cost: float, frames: int) -> str:
    """The warning that a CPU draws, with what a frame costs [s] and would cost as a draft."""
    text = f"drawing in software ({clean(drawn.backend.renderer)}): {1e3 * cost:.0f} ms per frame"
    text += f", {frames * cost:.0f} s in all by one process"
    draft = None if drawn.visual.quality == "draft" else drawn.draft_cost()
    if draft is not None and draft < 0.7 * cost:
        text += f"; --quality draft takes about {1e3 * draft:.0f} ms, without shadows and reflections"
    return text
