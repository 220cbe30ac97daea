"""A film: simulate and keep the state of every frame, then draw the states into the encoder."""

import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import KW_ONLY, dataclass
from fractions import Fraction

import numpy as np

from mjrun.camera.pose import Pose
from mjrun.errors import UnknownNameError, UsageError, clean
from mjrun.formats.codecs import Encoding, encoding
from mjrun.formats.labels import LabelsWriter
from mjrun.formats.video_writer import VideoWriter
from mjrun.job.calibration import Calibration
from mjrun.job.event_detection import conditions
from mjrun.job.frame_drawing import Filming
from mjrun.job.frame_schedule import FrameSchedule, events, pacing
from mjrun.job.manifest import origin
from mjrun.job.overlay import Values, blank, gauges
from mjrun.job.perform import Artifact, Context, Preview, Work, perform
from mjrun.job.simulation import Simulation, lone, positive
from mjrun.job.view import Drawing, painter, tags, unused
from mjrun.model.uint16_pixels import UINT16_MAX
from mjrun.rendering.compositor import Overlay, SceneCompositor, Stream
from mjrun.rendering.graph import SIDES
from mjrun.rendering.layout import layout_size
from mjrun.rendering.process_count import AUTO
from mjrun.reporter import Reporter
from mjrun.sim.observe import Tap
from mjrun.sim.state_buffer import StateBuffer
from mjrun.sim.stepper import Stepper


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
        lone(self, "plot")
        if self.plot_side not in SIDES:
            raise UnknownNameError("side", self.plot_side, SIDES, where="--plot-side")
        if self.plot and self.separate:
            raise UsageError("--plot stands under one picture; it does not go with --separate")

    @property
    def files(self) -> list[tuple[str, str]]:
        """Every file that it writes, with what it is."""
        return self.written(self.output)

    def run(self, reporter: Reporter | None = None) -> "VideoResult":
        """Makes the film. What can fail early fails before the first step.

        Raises:
          MjrunError: nothing was published, and an existing output is untouched.
        """
        return perform([self], reporter)[0]

    def work(self, stack: ExitStack) -> "FilmWork":
        """The work that makes it."""
        return FilmWork(self, stack)


@dataclass(frozen=True)
class VideoResult:
    """What film was made.

    Attributes:
      path: where it is; `-` is standard output.
      paths: all files, labels and calibration included.
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


class FilmWork(Work):
    """A film in the making."""

    def __init__(self, job: Video, stack: ExitStack) -> None:
        self._job = job
        self._encodings = _encodings(job)
        self._fps = self._encodings[0].fps if job.fps is None else positive("--fps", job.fps)
        self._speed = positive("--speed", job.speed)
        for encoded in self._encodings:
            encoded.check_fps(self._fps)
        self._search = job.search()  # tries a backend while the model loads
        stack.callback(self._search.cancel)
        self._pacing: FrameSchedule | None = None
        self._rows: list[Values] = []

    def plan(self, ground: Context) -> None:
        job, model = self._job, ground.model
        self._ground, self.until = ground, ground.timeline.steps
        self._scripts, self._courses = job.scripts(model), job.courses(model)
        self.conditions = conditions(events(self._scripts), model)
        self._gauges = gauges(model, ground.timeline, job.text, job.plot)
        self.model = self._gauges.model
        size = layout_size(1 if job.separate else len(job.panels), job.size, job.layout)
        self._overlay = blank(size, job.corner, job.plot, job.plot_side)
        self._additions = job.additions(model)
        if not self.conditions:
            self.settle({})

    def settle(self, happened: Mapping[str, Sequence[int]]) -> None:
        self._pacing = pacing(self._scripts, self._ground.timeline, self._fps, self._speed, happened)
        for text in self._pacing.remarks:
            self._ground.reporter.warn(text)

    def open(self, stack: ExitStack) -> None:
        job, ground = self._job, self._ground
        self._backend = self._search.result(job.require_gpu)
        exact = all(stream.exact for stream in self._streams(self._overlay))
        for text in [*job.check(ground.model, self._backend), *(unused(job, plot=job.plot) if exact else [])]:
            ground.reporter.warn(text)
        known = {} if self._pacing is None else {"frames": len(self._pacing.steps)}
        self._facts = {**origin(job, job.simulation, ground.model, ground.timeline), **known}
        self._facts["renderer"] = self._backend.renderer
        self._films, self._legends = [], []
        for (path, panels), encoded, stream in zip(
            job.outputs(job.output), self._encodings, self._streams(self._overlay), strict=True
        ):
            _remark_padding(encoded, stream.size_of_frame, ground.reporter)
            target = None if path == "-" else path
            film = VideoWriter(target, encoded, stream.size_of_frame, self._fps, tags=tags(target, self._facts))
            self._films.append(stack.enter_context(film))
            if path != "-" and [panel.view for panel in panels] == ["seg"]:
                self._legends.append((stack.enter_context(LabelsWriter(path)), stream))
        self._calibration = None
        if job.calibration is not None:
            self._calibration = Calibration(job, self._courses, job.output, job.style == "exact")
            stack.enter_context(self._calibration.writer)
        # Filament's noise goes on from frame to frame: only one process makes the same film each time.
        asked = 1 if job.jobs == AUTO and job.renderer == "filament" else job.jobs
        self._filming = stack.enter_context(Filming(asked, self._backend, job.size, len(job.panels)))
        self._recording = stack.enter_context(StateBuffer(ground.model))
        self._path = stack.enter_context(StateBuffer(ground.model))

    def taps(self) -> Sequence[Tap]:
        """Keeps every frame's state, those on the path of trails, and what is measured at each frame."""
        assert self._pacing
        frames, path = self._pacing.steps, self._additions.steps(self._ground.timeline)
        taps: list[Tap] = [Tap(frames, lambda stepper: stepper.state(), self._recording.append)]
        taps.append(Tap(path, lambda stepper: stepper.state(), self._path.append))
        if not self._gauges.idle:
            taps.append(Tap(frames, self._gauges.read, self._rows.append))
        return taps

    def drive(self, stepper: Stepper) -> None:
        assert self._pacing
        self._filming.start(len(self._pacing.steps))  # they get ready meanwhile
        super().drive(stepper)

    def outline(self) -> Preview:
        job, encoded, stream = self._job, self._encodings[0], self._streams(self._overlay)[0]
        frames = None if self._pacing is None else len(self._pacing.steps)
        about = f"{encoded.codec}, {float(self._fps):g} fps, {' and '.join(job.names)}"
        return Preview("film", job.output, frames, "frames", stream.size_of_frame, about)

    def finish(self, wall: float) -> Artifact:
        assert self._pacing
        job, pace, start = self._job, self._pacing, time.perf_counter()
        overlay = self._gauges.overlay(self._overlay, self._rows, pace.steps, pace.speeds, self._ground.timeline)
        poses, moments = self._poses(pace), self._times(pace)
        decors = self._additions.decors((self._path[k] for k in range(len(self._path))), moments)
        drawn = painter(job, self._ground.model, self._backend, self._streams(overlay), poses, decors)
        self._draw(drawn)
        if self._calibration:
            for index, (seen, moment) in enumerate(zip(poses, moments, strict=True)):
                self._calibration.write(seen, index, moment)
        for legend, stream in self._legends:
            legend.write(job.size, drawn.segmentation.legend, None if stream.exact else drawn.colors)
        legends = [legend for legend, _ in self._legends]
        written = [*self._films, *legends, *([self._calibration.writer] if self._calibration else [])]
        files = [file for sink in written for file in sink.publish()]
        for others in filter(None, (film.others for film in self._films)):
            more = f" and {len(others) - 1} more" if len(others) > 1 else ""
            self._ground.reporter.warn(
                f"{clean(others[0])}{more} were there before and follow the last frame: not of this film"
            )
        draw_wall = time.perf_counter() - start
        self._facts["frames"] = len(pace.steps)
        return Artifact(self._facts, files, lambda total, heard: self._result((wall, draw_wall, total), heard))

    def _draw(self, drawn: SceneCompositor) -> None:
        """Draws every frame into the films."""
        job, reporter, total = self._job, self._ground.reporter, len(self._recording)
        for film in self._films:
            film.count = total
        far = [stream.exact and stream.panels[0].view == "depth" for stream in drawn.streams]
        clipped = 0
        for index, frames in enumerate(self._filming.draw(drawn, self._recording, reporter)):
            for film, part, depth in zip(self._films, drawn.parts(frames), far, strict=True):
                film.write(part)
                clipped += np.count_nonzero(part == UINT16_MAX) if depth else 0
            reporter.progress("frames", index + 1, total)
        if clipped:
            share = clipped / (total * sum(far) * job.size[0] * job.size[1])
            reporter.warn(f"{share:.2%} of the pixels are at 65.535 m or farther, the most that 16 bits hold")

    def _streams(self, overlay: Overlay) -> list[Stream]:
        return self._job.streams(with_legend=False, overlay=overlay)

    def _times(self, pace: FrameSchedule) -> list[float]:
        """The instant of each frame [s]."""
        return [float(self._ground.timeline.time(step)) for step in pace.steps]

    def _poses(self, pace: FrameSchedule) -> list[tuple[Pose, ...]]:
        """Of each frame, of each camera."""
        count, moments = len(self._recording), self._times(pace)
        courses = [
            course.poses((self._recording[k] for k in range(count)), moments, pace.times, spans)
            for course, spans in zip(self._courses, pace.spans, strict=True)
        ]
        return list(zip(*courses, strict=True))

    def _result(self, walls: tuple[float, float, float], heard: Sequence[str]) -> VideoResult:
        assert self._pacing
        job, encoded, film, count = self._job, self._encodings[0], self._films[0], len(self._pacing.steps)
        padding = encoded.padding(*film.size)
        films = [path for path, _ in job.outputs(job.output)]
        paths = [*films, *(path for what, path in job.files if what != "manifest" and path not in films)]
        simulation_wall, draw_wall, wall = walls
        return VideoResult(
            path=job.output,
            paths=paths,
            format=encoded.format,
            codec=encoded.codec,
            size=(film.size[0] + padding[0], film.size[1] + padding[1]),
            frames=count,
            fps=float(self._fps),
            duration=float(count / self._fps),
            simulated=float(self._ground.timeline.duration),
            steps=self._ground.timeline.steps,
            jobs=self._filming.jobs,
            renderer=self._backend.renderer,
            gl=self._backend.name,
            software=self._backend.software,
            simulation_wall=simulation_wall,
            draw_wall=draw_wall,
            wall=wall,
            warnings=heard,
        )


def _encodings(job: Video) -> list[Encoding]:
    """How each output is encoded."""
    found = []
    for (path, panels), stream in zip(job.outputs(job.output), job.streams(False, Overlay()), strict=True):
        coded = all(panel.view == "seg" for panel in panels)
        content = "exact" if stream.exact else "ids" if coded else "video"
        target = None if path == "-" else path
        found.append(encoding(target, job.format, job.codec, job.crf, job.preset, content))
    return found


def _remark_padding(encoded: Encoding, size: tuple[int, int], reporter: Reporter) -> None:
    padding = encoded.padding(*size)
    if any(padding):
        width, height = size
        padded = f"{width + padding[0]}x{height + padding[1]}"
        reporter.note(f"{encoded.codec} needs even sides: the film is padded from {width}x{height} to {padded}")
