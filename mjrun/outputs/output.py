"""An output in three phases, each a value: a plan, an output whose files are open, and a finished output.

A *request*, such as `Video`, is an output as requested. Its *plan*, an `OutputPlan`, knows the model: every name is
resolved, every number checked. An *open output*, `OpenVideo`, observes the simulation through its taps. A *finished
output* has its result, and its files are complete.

The pass in `perform` calls, in this order:

- of each request, `files`, `inputs` and `check`, `renderer_options` to detect a backend while the model loads (requests
  for videos and images are these options themselves), and then `plan` with the compiled model;
- of each plan, `open`, which makes the output with its files and starts encoders, before the first step;
- in the simulation, the `taps` of each output, or `simulate` of a single one that reads blocks of steps; an
  output that waits for events calls `choose_taps` first;
- of each output, `finish`, which draws what the taps recorded, ends the encoders, and returns the finished output.
"""

import os
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import field
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar

import mujoco

from mjrun.dataclass import dataclass
from mjrun.errors import UsageError, clean, option
from mjrun.formats.output_writer import OutputWriter
from mjrun.options.option import options
from mjrun.options.output import OutputOptions
from mjrun.physics.simulation_loop import Tap
from mjrun.physics.stepper import Stepper
from mjrun.probe.episode_columns import EpisodeColumns
from mjrun.reporter import Reporter
from mjrun.simulation.origin import origin
from mjrun.simulation.policy_episode import EpisodeResult
from mjrun.simulation.simulation import Simulation, require_simulation
from mjrun.timeline import Timeline

if TYPE_CHECKING:
    from mjrun.options.rendering import RendererOptions
    from mjrun.rendering.backend import BackendDetector, WorkingBackend
    from mjrun.rendering.compositor_pool import CompositorProcesses

# The steps at which each condition becomes true.
EventSteps = Mapping[str, Sequence[int]]
_NUMBER = re.compile(r"%[0-9]*d")  # the frame number in a pattern such as frame_%04d.png


@dataclass(frozen=True)
class OutputResult:
    """The result of an output.

    Attributes:
      path: path of the output; `-` is standard output.
      episode: the result of the policy's episode; None if there is no policy.
      wall: total wall time [s].
      warnings: MuJoCo's warnings.
    """

    path: str
    episode: EpisodeResult | None = field(default=None, kw_only=True)
    wall: float = field(default=0.0, kw_only=True)
    warnings: Sequence[str] = field(default=(), kw_only=True)

    def _repr_html_(self) -> str | None:
        """Returns the images and videos for a notebook, or None."""
        from mjrun.plotting.html_page import media_html

        return media_html(getattr(self, "paths", [self.path]))


R_co = TypeVar("R_co", bound=OutputResult, covariant=True)


@dataclass(frozen=True)
class PassContext:
    """The context of the outputs of one pass: the simulation that they share."""

    simulation: Simulation
    model: mujoco.MjModel
    timeline: Timeline
    reporter: Reporter

    @property
    def episode(self) -> EpisodeColumns | None:
        """Additional columns that can be measured if a policy acts."""
        return self.simulation.episode.columns if self.simulation.episode else None

    def require_before_end(self, step: int, name: str) -> None:
        """Checks that `until` does not end the simulation before a step, which may be after its duration.

        Args:
          step: the step that the option `name` selects.

        Raises:
          UsageError: the simulation ends before.
        """
        end, simulation = self.timeline, self.simulation
        if simulation.until is None or step <= end.steps:
            return
        from mjrun.outputs.event_detection import final_timeline  # which few simulations need

        if end.steps == simulation.timeline(self.model).steps:  # the duration, after which the condition may hold
            end = final_timeline(simulation.with_values({"steps": step, "duration": None}), self.model)
        if end.steps < step:
            shown = f"{option(name)}: {float(step * end.timestep):g} s is after the end of the simulation"
            raise UsageError(f"{shown}, at {float(end.duration):g} s, where {option('until')} holds", (name,))

    def facts(self, request: object, timeline: Timeline | None = None) -> dict[str, object]:
        """Returns the facts for an output's manifest: its origin, in the whole `timeline` or part of it."""
        return {**origin(request, self.simulation, self.model, timeline or self.timeline)}


@dataclass(frozen=True)
class OutputPreview:
    """A description of an output before it is made.

    Attributes:
      kind: `video`, `image`, `trace`, `plot`, `recording`, `keyframe` or `export`.
      path: path of the output.
      count: number of frames, images, rows, samples or states; None if an event decides.
      unit: noun for what is counted.
      size: width and height [pixels], or the number of columns.
      about: further details, in words.
    """

    kind: str
    path: str
    count: int | None
    unit: str
    size: Sequence[int]
    about: str = ""


class RenderingResources:
    """The backends and rendering processes of a pass: each is detected or started only once. To be closed."""

    def __init__(self) -> None:
        self._detections: dict[tuple[str, str | None], BackendDetector] = {}
        self._workers: CompositorProcesses | None = None

    def detect(self, options: "RendererOptions") -> None:
        """Starts the detection of a backend in a child process, so that it runs while the model loads.

        Raises:
          UnknownNameError: the backend is unknown.
          NoRendererError: MUJOCO_GL switches rendering off.
        """
        self._detection(options)

    def backend(self, options: "RendererOptions") -> "WorkingBackend":
        """Returns the detected backend, whose driver rendering processes load in advance.

        Raises:
          RendererError: no backend works.
        """
        backend = self._detection(options).result(options.require_gpu)
        if self._workers:
            self._workers.prepare(backend.load)
        return backend

    def _detection(self, options: "RendererOptions") -> "BackendDetector":
        from mjrun.rendering.backend import BackendDetector, VulkanDetector

        is_filament = options.renderer == "filament"  # which draws with Vulkan
        choice = options.renderer, None if is_filament else options.gl
        if choice not in self._detections:
            self._detections[choice] = VulkanDetector() if is_filament else BackendDetector(options.gl)
        return self._detections[choice]

    def workers(self, count: int) -> "CompositorProcesses":
        """Returns at least `count` rendering processes, started without waiting for them.

        Raises:
          DrawError: the processes cannot be started.
        """
        from mjrun.rendering.compositor import SceneCompositor
        from mjrun.rendering.compositor_pool import CompositorProcesses

        if self._workers is None:
            self._workers = CompositorProcesses(count, SceneCompositor.__module__)
        else:
            self._workers.grow(count)
        return self._workers

    def close(self) -> None:
        """Ends the workers and any detection that is still running."""
        if self._workers:
            self._workers.close()
        for detection in self._detections.values():
            detection.cancel()


@dataclass(frozen=True)
class FinishedOutput(Generic[R_co]):
    """An output whose files are complete, and remain to be published.

    Attributes:
      result: the result, without what the pass adds to every result.
      writers: the writers of all files.
      facts: facts for the manifest.
      failed_assertions: messages of failed assertions.
      golden_differences: messages about differences from a golden table.
      units: units of the columns of a table, which its file may not hold.
    """

    result: R_co
    writers: Sequence[OutputWriter]
    facts: Mapping[str, object]
    failed_assertions: Sequence[str] = ()
    golden_differences: Sequence[str] = ()
    units: Mapping[str, str] = field(default_factory=dict[str, str])


class OpenOutput(ABC, Generic[R_co]):
    """An output with open files, which proves that they can be written.

    Attributes:
      taps: the taps that observe the simulation; empty while the output waits for events.
    """

    taps: Sequence[Tap] = ()

    def choose_taps(self, event_steps: EventSteps) -> None:
        """Chooses the taps of an output that waits for events.

        Args:
          event_steps: steps of the conditions of its plan.

        Raises:
          UsageError: an event that the output waits for does not happen.
        """
        raise NotImplementedError

    @abstractmethod
    def finish(self, simulation_wall: float) -> FinishedOutput[R_co]:
        """Draws frames and figures from what the taps recorded, and completes the files.

        Args:
          simulation_wall: wall time of stepping [s].

        Raises:
          MjrunError: a frame cannot be rendered, or a file cannot be written.
        """


class OpenBlockOutput(OpenOutput[R_co]):
    """An output that can read blocks of steps, which takes less time than to read each of them."""

    @abstractmethod
    def simulate(self, stepper: Stepper, until: int) -> None:
        """Runs the simulation up to step `until` for this output alone, instead of serving its taps."""


@dataclass(frozen=True, kw_only=True)
class OutputPlan(Generic[R_co]):
    """A planned output for a model, with every name resolved and every number checked; nothing is open yet.

    Attributes:
      preview: description of the output.
      until: the last step that the output needs.
      open: opens the files, whose unpublished ones the stack removes, and starts drawing processes and encoders.
      enable_flags: MuJoCo enable flags that the measured values require.
      conditions: conditions of the events that the output waits for.
    """

    preview: OutputPreview
    until: int
    open: Callable[[ExitStack, RenderingResources], OpenOutput[R_co]]
    enable_flags: int = 0
    conditions: Sequence[str] = ()


@options
class OutputRequest(OutputOptions, ABC, Generic[R_co]):
    """A requested output: a simulation and the options of one kind of output."""

    simulation: Simulation = field(kw_only=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_simulation(self.simulation)

    @property
    def files(self) -> Sequence[tuple[str, str]]:
        """Every file that is written, with its role."""
        return named_files(output=self.output, manifest=self.manifest)

    @property
    def inputs(self) -> Sequence[tuple[str, str]]:
        """Every file that is read in addition to those of the simulation, with its role."""
        return ()

    @property
    def code(self) -> Sequence[object]:
        """Functions and objects that the user has written."""
        return self.simulation.code

    @property
    def rewritten_inputs(self) -> Sequence[str]:
        """Written files that may replace files that the simulation reads."""
        return ()

    @property
    def renderer_options(self) -> "RendererOptions | None":
        """The options of the renderer that the output needs, if any; its backend is detected while the model loads."""
        return None

    @property
    def keeps_partial(self) -> bool:
        """True if the output is published even when the simulation becomes unstable."""
        return False

    def run(self, reporter: Reporter | None = None) -> R_co:
        """Makes the output. Errors that can be detected early are raised before the first step.

        Raises:
          FailedAssertionError: an assertion of a trace fails; its table is published nevertheless.
          GoldenDifferenceError: a trace differs from its golden table; the trace is published nevertheless.
          MjrunError: nothing was published unless `keep_partial` is set, and existing outputs are unchanged.
        """
        from mjrun.outputs.perform import perform  # which imports this

        return perform([self], reporter)[0]

    def check(self) -> None:
        """Checks everything that does not depend on the model.

        Raises:
          UsageError: a format cannot hold the output, or a value is invalid.
        """
        return

    @abstractmethod
    def plan(self, context: PassContext) -> OutputPlan[R_co]:
        """Resolves every name in the model and checks every number.

        Raises:
          UsageError: a name is unknown, or a value is invalid.
        """


def metadata_tags(path: str | None, facts: Mapping[str, object]) -> dict[str, str]:
    """Returns the tags embedded in a video or image: its title, its maker, and all `facts` as JSON."""
    made_by = [f"mjrun {facts['mjrun']}", f"MuJoCo {facts['mujoco']}"]
    if "renderer" in facts:
        made_by.append(str(facts["renderer"]))
    title = {} if path is None else {"title": Path(path).stem}
    return {**title, "comment": clean(", ".join(made_by)), "description": dumps(facts)}


def named_files(**paths: str | None) -> list[tuple[str, str]]:
    """Returns pairs of role and path, without files that are not requested."""
    return [(name, path) for name, path in paths.items() if path is not None]


class ReservedFiles:
    """Paths that are already read or written."""

    def __init__(self) -> None:
        self._owners: dict[Path, str] = {}  # by file
        self._below: dict[Path, str] = {}  # owners of a file below each folder
        self._patterns: list[tuple[re.Pattern[str], str]] = []

    def reserve(self, path: str | Path, owner: str) -> None:
        """Reserves a file, a folder or a frame pattern; messages call it `owner`. `-` is ignored.

        Raises:
          UsageError: it is reserved, lies in a frame folder, or is a folder that contains a reserved file.
        """
        if path == "-":
            return
        file = Path(os.path.realpath(path))
        other = next(self._conflicts(file), None)
        if other:
            raise UsageError(f"{clean(str(path))} clashes with {other}; each output needs a separate file")
        self._add(file, owner)
        if frame := _frame(file):
            self._patterns.append((frame, owner))

    def reserve_input(self, path: str | Path, owner: str) -> None:
        """Reserves a file that is read, resolving links."""
        self._add(Path(os.path.realpath(path)), owner)

    def _add(self, file: Path, owner: str) -> None:
        self._owners.setdefault(file, owner)
        self._below.update(dict.fromkeys(file.parents, owner))

    def _conflicts(self, file: Path) -> Iterator[str]:
        """Yields the owners of `file`, of files below it, and of the folders that contain it."""
        if file in self._below:
            yield self._below[file]
        yield from (self._owners[path] for path in (file, *file.parents) if path in self._owners)
        yield from (owner for frame, owner in self._patterns if frame.fullmatch(_first(file)))
        if frame := _frame(file):
            yield from (owner for other, owner in self._owners.items() if frame.fullmatch(_first(other)))


def _first(file: Path) -> str:
    """Returns the path of a file; for a frame pattern, that of its first frame."""
    return str(file.parent / _NUMBER.sub("0", file.name, count=1))


def _frame(file: Path) -> re.Pattern[str] | None:
    """Returns the expression that matches the frames of a pattern; None if the path is not a pattern."""
    if not _NUMBER.search(file.name):
        return None
    before, after = (re.escape(part) for part in _NUMBER.split(file.name, maxsplit=1))
    return re.compile(f"{re.escape(str(file.parent))}/{before}[0-9]+{after}")
