"""An output in two phases: a plan, with everything checked and nothing open, and an output, whose files are open.

A *job* is an output as the user asks for it. Its *plan* knows the model: every name is resolved, every number checked.
An *output* observes the simulation through its taps. `finish` completes its files, which are then left to publish.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar

import mujoco

from mjrun.closable import Closable
from mjrun.errors import clean
from mjrun.formats.atomic_output import OutputWriter
from mjrun.options.option import options
from mjrun.options.output import OutputOptions
from mjrun.physics.observe import AnyTap, observe
from mjrun.physics.stepper import Stepper
from mjrun.probe.episode import EpisodeColumns
from mjrun.reporter import Reporter
from mjrun.simulation.episode import EpisodeResult
from mjrun.simulation.manifest import origin
from mjrun.simulation.simulation import Simulation, require_simulation
from mjrun.timeline import Timeline

if TYPE_CHECKING:
    from mjrun.options.view import ViewOptions
    from mjrun.rendering.backend import Backend
    from mjrun.rendering.backend_detection import BackendDetection, VulkanDetection
    from mjrun.rendering.workers import PainterProcesses

# Of each condition, the steps at which it begins to hold.
EventSteps = Mapping[str, Sequence[int]]


@dataclass(frozen=True)
class OutputResult:
    """The result of an output.

    Attributes:
      path: of the output; `-` is standard output.
      episode: the result of the policy's episode; None without a policy.
    """

    path: str
    episode: EpisodeResult | None = field(default=None, kw_only=True)


R_co = TypeVar("R_co", bound=OutputResult, covariant=True)


@dataclass(frozen=True)
class Context:
    """What the outputs of one pass have in common."""

    simulation: Simulation
    model: mujoco.MjModel
    timeline: Timeline
    reporter: Reporter

    @property
    def episode(self) -> EpisodeColumns | None:
        """The columns that can be measured in addition where a policy acts."""
        return self.simulation.episode.columns if self.simulation.episode else None

    def facts(self, job: object, timeline: Timeline | None = None) -> dict[str, object]:
        """The facts about an output for its manifest: what makes it, in the whole `timeline` or part of it."""
        return {**origin(job, self.simulation, self.model, timeline or self.timeline)}


@dataclass(frozen=True)
class Preview:
    """A description of an output that will be made.

    Attributes:
      kind: `video`, `image`, `trace`, `plot`, `recording` or `keyframe`.
      path: of the output.
      count: frames, images, rows, samples or states; None while an event decides.
      unit: what is counted.
      size: width and height [pixels], or columns alone.
      about: what else there is to know, in words.
    """

    kind: str
    path: str
    count: int | None
    unit: str
    size: Sequence[int]
    about: str = ""


@dataclass(frozen=True)
class PassSummary:
    """What is known at the end of a pass: wall time of all and of the simulation [s], and MuJoCo's warnings."""

    wall: float
    simulation_wall: float
    warnings: Sequence[str]


@dataclass(frozen=True)
class RendererRequest:
    """A renderer, as options ask for it: `classic` by an OpenGL backend, or `filament` by Vulkan."""

    renderer: str
    gl: str | None
    require_gpu: bool

    @classmethod
    def of(cls, options: "ViewOptions") -> "RendererRequest":
        """What `options` ask for."""
        return cls(options.renderer, None if options.renderer == "filament" else options.gl, options.require_gpu)

    def detection(self) -> "BackendDetection | VulkanDetection":
        """Starts to try what can draw."""
        from mjrun.rendering.backend_detection import BackendDetection, VulkanDetection

        return VulkanDetection() if self.renderer == "filament" else BackendDetection(self.gl)


class SharedRendering(Closable):
    """Detects each backend once and starts each worker process once, for all outputs of a pass. To be closed."""

    def __init__(self) -> None:
        self._detections: dict[RendererRequest, BackendDetection | VulkanDetection] = {}
        self._backends: dict[RendererRequest, Backend] = {}
        self._workers: PainterProcesses | None = None

    def detect(self, choice: RendererRequest) -> None:
        """Starts the detection in a child process, so that it runs while the model loads.

        Raises:
          UnknownNameError: no such backend.
          NoRendererError: rendering is switched off by MUJOCO_GL.
        """
        if choice not in self._detections:
            self._detections[choice] = choice.detection()

    def backend(self, choice: RendererRequest) -> "Backend":
        """The backend that was detected.

        Raises:
          RendererError: there is none.
        """
        if choice not in self._backends:
            self.detect(choice)
            self._backends[choice] = self._detections[choice].result(choice.require_gpu)
        return self._backends[choice]

    def workers(self, count: int) -> "PainterProcesses":
        """At least `count` processes that draw, started without waiting for them.

        Raises:
          DrawError: they cannot be started.
        """
        from mjrun.rendering.compositor import SceneCompositor
        from mjrun.rendering.workers import PainterProcesses

        if self._workers is None:
            self._workers = PainterProcesses(count, SceneCompositor.__module__)
        else:
            self._workers.grow(count)
        return self._workers

    def close(self) -> None:
        """Ends the workers, and detections that are still running."""
        if self._workers:
            self._workers.close()
        for detection in self._detections.values():
            detection.cancel()


class Output(ABC, Generic[R_co]):
    """An output whose files are open, which proves that they can be written.

    Attributes:
      facts: for the manifest.
      failed_assertions: messages of the assertions that do not hold, once it is finished.
      golden_differences: messages that say how the output differs from a golden table, once it is finished.
    """

    facts: Mapping[str, object]
    failed_assertions: Sequence[str] = ()
    golden_differences: Sequence[str] = ()

    @abstractmethod
    def taps(self, event_steps: EventSteps) -> Sequence[AnyTap]:
        """Returns what it takes from the simulation; called once.

        Args:
          event_steps: of the conditions of its plan.

        Raises:
          UsageError: an event that it waits for does not happen.
        """

    def simulate(self, stepper: Stepper, until: int) -> None:
        """Runs the simulation up to step `until` for this output alone."""
        observe(stepper, self.taps({}), until)

    @abstractmethod
    def finish(self) -> Sequence[OutputWriter]:
        """Completes and verifies everything, after the simulation, and returns the writers, which are left to publish.

        Raises:
          MjrunError: the output cannot be completed.
        """

    @abstractmethod
    def result(self, files: Sequence[Path], summary: PassSummary) -> R_co:
        """Returns the result, once the files are published."""

    def remarks(self) -> Sequence[str]:
        """Returns warnings about what is published."""
        return ()


@dataclass(frozen=True)
class Plan(Generic[R_co]):
    """An output of a model, with every name resolved and every number checked; nothing is open yet.

    Attributes:
      preview: describes it.
      until: the last step that it needs.
      open: opens the files, of which the stack discards those that are not published, and starts what draws.
      enable_flags: flags of MuJoCo's that must be set for what it measures.
      conditions: of the events that it waits for.
    """

    preview: Preview
    until: int
    open: Callable[[ExitStack, SharedRendering], Output[R_co]]
    enable_flags: int = 0
    conditions: Sequence[str] = ()


@options
class Job(OutputOptions, ABC, Generic[R_co]):
    """An output as the user asks for it: a simulation, and the options of its kind."""

    simulation: Simulation = field(kw_only=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_simulation(self.simulation)

    @property
    @abstractmethod
    def files(self) -> Sequence[tuple[str, str]]:
        """Every file that it writes, with what it is."""

    @property
    def inputs(self) -> Sequence[tuple[str, str]]:
        """Every file that it reads in addition to those of the simulation, with what it is."""
        return ()

    @property
    def rewritten_inputs(self) -> Sequence[str]:
        """Those of its files that may replace files that the simulation reads."""
        return ()

    @property
    def renderer_request(self) -> RendererRequest | None:
        """The renderer that it needs, if it draws: worth detecting while the model loads."""
        return None

    @property
    def keeps_partial(self) -> bool:
        """Whether it is worth publishing when the simulation becomes unstable."""
        return False

    def run(self, reporter: Reporter | None = None) -> R_co:
        """Makes the output. What can fail early fails before the first step.

        Raises:
          FailedAssertionError: an assertion of a trace does not hold; its table is published all the same.
          GoldenDifferenceError: a trace differs from its golden table; its own is published all the same.
          MjrunError: nothing was published, unless `keep_partial`, and existing outputs are untouched.
        """
        from mjrun.outputs.perform import perform  # which imports this

        return perform([self], reporter)[0]

    def check(self) -> None:
        """Checks everything that does not depend on the model.

        Raises:
          UsageError: a format that cannot hold the output, or an invalid value.
        """
        return

    @abstractmethod
    def plan(self, context: Context) -> Plan[R_co]:
        """Resolves every name in the model and checks every number.

        Raises:
          UsageError: a missing name, or an invalid value.
        """


def metadata_tags(path: str | None, facts: Mapping[str, object]) -> dict[str, str]:
    """What is embedded in a video or picture: its title, what made it, and all `facts` about it as JSON."""
    made_by = [f"mjrun {facts['mjrun']}", f"MuJoCo {facts['mujoco']}"]
    if "renderer" in facts:
        made_by.append(str(facts["renderer"]))
    title = {} if path is None else {"title": Path(path).stem}
    return {**title, "comment": clean(", ".join(made_by)), "description": dumps(facts)}
