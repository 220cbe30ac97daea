"""A film: simulate and keep the state of every frame, then draw the states into the encoder."""

import json
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import mujoco

from mjrun.errors import clean
from mjrun.export.codecs import Encoding, encoding
from mjrun.export.manifest import ManifestWriter
from mjrun.export.video import FilmWriter
from mjrun.job.manifest import origin
from mjrun.job.report import QuietReporter, Reporter, pass_on
from mjrun.job.simulation import Simulation, positive
from mjrun.model.native import collected_warnings
from mjrun.render.backend import Backend, Search
from mjrun.render.camera import Rig, rig
from mjrun.render.classic import ClassicRenderer
from mjrun.render.visual import Visual
from mjrun.sim.observe import Tap, observe
from mjrun.sim.recording import Recording
from mjrun.sim.stepper import Stepper
from mjrun.timeline import Timeline

SIZE = (1280, 720)


@dataclass(frozen=True)
class Video:
    """What film to make.

    Args:
      simulation: what happens.
      output: a file, a folder, a pattern such as `frame_%04d.png`, or `-` for stdout.
      camera: `free`, a camera of the model, `orbit:…` or `track:…`.
      size: width and height [pixels].
      fps: frames per second of the film; 30, or 25 in a GIF, when None.
      speed: simulated seconds per second of film; below 1 is slow motion.
      visual: flags, groups, frames, labels and quality of what is drawn.
      format, codec, crf, preset: how it is encoded; chosen by the output's suffix when None.
      gl: OpenGL backend; `auto` tries all.
      require_gpu: refuse to draw in software.
      manifest: a file for what made the film.
      command: the command line, for the manifest.
    """

    simulation: Simulation
    output: str
    camera: str = "free"
    size: tuple[int, int] = SIZE
    fps: float | str | Fraction | None = None
    speed: float | str | Fraction = 1
    visual: Visual = field(default_factory=Visual)
    format: str | None = None
    codec: str | None = None
    crf: int | None = None
    preset: str | None = None
    gl: str | None = None
    require_gpu: bool = False
    manifest: str | None = None
    command: str = ""

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
      format, codec: how it is encoded.
      size: width and height of the film [pixels], padding included.
      frames, fps, duration: number, rate, and length of the film [s].
      simulated, steps: simulated time [s] and steps taken.
      renderer, gl, software: who drew, by OpenGL's own name; the backend; whether it is a CPU.
      simulation_wall, draw_wall, wall: wall time of stepping, of drawing and encoding, of all [s].
      warnings: what MuJoCo warned of.
    """

    path: str
    format: str
    codec: str
    size: tuple[int, int]
    frames: int
    fps: float
    duration: float
    simulated: float
    steps: int
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
    stepper: Stepper
    timeline: Timeline
    fps: Fraction
    frames: Sequence[int]
    rig: Rig
    encoding: Encoding

    def phase(self, index: int) -> float:
        """How far along the simulation frame `index` is, from 0 to 1."""
        return float(self.timeline.time(self.frames[index]) / self.timeline.duration)


def _make(job: Video, reporter: Reporter) -> VideoResult:
    start = time.perf_counter()
    with ManifestWriter(job.manifest) as manifest:
        with collected_warnings() as heard:
            made = _film(job, reporter)
        pass_on(heard, reporter)
        padding = made.plan.encoding.padding(*job.size)
        count = len(made.plan.frames)
        result = VideoResult(
            path=job.output,
            format=made.plan.encoding.format,
            codec=made.plan.encoding.codec,
            size=(job.size[0] + padding[0], job.size[1] + padding[1]),
            frames=count,
            fps=float(made.plan.fps),
            duration=float(count / made.plan.fps),
            simulated=float(made.plan.timeline.duration),
            steps=made.plan.timeline.steps,
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


@dataclass(frozen=True)
class _Made:
    """What is known of a film once it is in its place."""

    plan: _Plan
    facts: Mapping[str, Any]
    backend: Backend
    files: Sequence[Path]
    simulation_wall: float
    draw_wall: float


def _film(job: Video, reporter: Reporter) -> _Made:
    with ExitStack() as stack:
        target = None if job.output == "-" else job.output
        encoded = encoding(target, job.format, job.codec, job.crf, job.preset)
        search = Search(job.gl)  # tries a backend while the model loads
        stack.callback(search.cancel)
        plan = _plan(job, encoded)
        _remark(job, plan, reporter)
        backend = search.result(job.require_gpu)
        count = len(plan.frames)
        facts = {
            **origin(job, job.simulation, plan.model, plan.timeline),
            "frames": count,
            "renderer": backend.renderer,
        }
        film = stack.enter_context(FilmWriter(target, encoded, job.size, plan.fps, count, _tags(job, facts)))
        renderer = stack.enter_context(ClassicRenderer(plan.model, job.size, backend, job.visual))
        recording = stack.enter_context(Recording(plan.model))
        simulation_wall = _simulate(plan, recording)
        draw_wall = _draw(plan, recording, renderer, backend, film, reporter)
        return _Made(plan, facts, backend, film.publish(), simulation_wall, draw_wall)


def _plan(job: Video, encoded: Encoding) -> _Plan:
    fps = encoded.fps if job.fps is None else positive("--fps", job.fps)
    speed = positive("--speed", job.speed)
    encoded.check_fps(fps)
    model = job.simulation.load()
    timeline = job.simulation.timeline(model)
    return _Plan(
        model=model,
        stepper=job.simulation.stepper(model),
        timeline=timeline,
        fps=fps,
        frames=timeline.frames(fps, speed),
        rig=rig(job.camera, model),
        encoding=encoded,
    )


def _remark(job: Video, plan: _Plan, reporter: Reporter) -> None:
    for text in job.simulation.remarks(plan.model):
        reporter.warn(text)
    padding = plan.encoding.padding(*job.size)
    if any(padding):
        width, height = job.size
        padded = f"{width + padding[0]}x{height + padding[1]}"
        reporter.note(f"{plan.encoding.codec} needs even sides: the film is padded from {width}x{height} to {padded}")


def _simulate(plan: _Plan, recording: Recording) -> float:
    """Runs the whole simulation, keeps the state at every frame, and returns the wall time [s]."""
    start = time.perf_counter()
    observe(plan.stepper, [Tap(plan.frames, lambda stepper: stepper.state(), recording.append)], plan.timeline.steps)
    return time.perf_counter() - start


def _draw(
    plan: _Plan,
    recording: Recording,
    renderer: ClassicRenderer,
    backend: Backend,
    film: FilmWriter,
    reporter: Reporter,
) -> float:
    """Draws every frame into the film, and returns the wall time [s]."""
    start = time.perf_counter()
    total = len(plan.frames)
    for index in range(total):
        before = time.perf_counter()
        frame = renderer.draw(recording[index], plan.rig, plan.phase(index))
        cost = time.perf_counter() - before
        film.write(frame)
        reporter.progress("frames", index + 1, total)
        if backend.software and index == min(1, total - 1):  # frame 0 also compiles the shaders
            reporter.warn(_software_cost(backend, cost, renderer.draft_cost(), total))
    return time.perf_counter() - start


def _software_cost(backend: Backend, cost: float, draft: float, frames: int) -> str:
    """The warning that a CPU draws, with what a frame costs [s] and would cost as a draft."""
    text = (
        f"drawing in software ({clean(backend.renderer)}): {1e3 * cost:.0f} ms per frame, {frames * cost:.0f} s in all"
    )
    if draft < 0.7 * cost:
        text += f"; --quality draft takes about {1e3 * draft:.0f} ms, without shadows and reflections"
    return text


def _tags(job: Video, facts: Mapping[str, Any]) -> dict[str, str]:
    made_by = f"mjrun {facts['mjrun']}, MuJoCo {facts['mujoco']}, {facts['renderer']}"
    title = {} if job.output == "-" else {"title": Path(job.output).stem}
    return {**title, "comment": clean(made_by), "description": json.dumps(facts)}
