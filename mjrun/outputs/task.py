"""The phases of an output, each a value that returns the next: task, plan, output, artifact.

A *job* is an output as the user asks for it. Its *task* is all that can be decided without the model. A *plan* knows
the model: every name is found, every number checked, nothing opened. An *output* is open and looks at the simulation
through its taps. An *artifact* is complete, and only has to be moved to its place.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Generic, Protocol, TypeVar

import mujoco

from mjrun.formats.atomic_output import OutputWriter, publish_together
from mjrun.options.option import options
from mjrun.options.output import OutputOptions
from mjrun.outputs.shared_rendering import RendererRequest, SharedRendering
from mjrun.physics.observe import AnyTap, observe
from mjrun.physics.stepper import Stepper
from mjrun.probe.episode import EpisodeColumns
from mjrun.reporter import Reporter
from mjrun.simulation.episode import EpisodeResult
from mjrun.simulation.simulation import Simulation, require_simulation
from mjrun.timeline import Timeline

# Of each condition, the steps at which it begins to hold.
EventSteps = Mapping[str, Sequence[int]]


@dataclass(frozen=True)
class OutputResult:
    """What was made.

    Attributes:
      path: where it is; `-` is standard output.
      episode: what came of the policy's episode; None without a policy.
    """

    path: str
    episode: EpisodeResult | None = field(default=None, kw_only=True)


R_co = TypeVar("R_co", bound=OutputResult, covariant=True)


@dataclass(frozen=True)
class Context:
    """What the outputs of one pass have in common.

    Attributes:
      episode: what can be measured besides, where a policy acts.
    """

    simulation: Simulation
    model: mujoco.MjModel
    timeline: Timeline
    reporter: Reporter
    episode: EpisodeColumns | None = None


@dataclass(frozen=True)
class Preview:
    """What will be made.

    Attributes:
      kind: `video`, `image`, `trace`, `plot`, `recording` or `keyframe`.
      path: where.
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
class Artifact(Generic[R_co]):
    """An output that is complete and verified, but not published.

    Attributes:
      facts: for the manifest.
      writers: whose `publish` is all that is left to do.
      result: makes the result, once the files are in their places.
      failed_assertions: messages of the assertions that do not hold.
      golden_differences: messages that say how the output differs from a golden table.
    """

    facts: Mapping[str, object]
    writers: Sequence[OutputWriter]
    result: Callable[[Sequence[Path], PassSummary], R_co]
    failed_assertions: Sequence[str] = ()
    golden_differences: Sequence[str] = ()

    @property
    def paths(self) -> list[str]:
        """What will be made: files, or a folder or a pattern of many."""
        return [str(part.destination.shown) for writer in self.writers for part in writer.together]

    def publish(self, manifest: Callable[[Sequence[Path]], OutputWriter] | None = None) -> list[Path]:
        """Moves every file to its place, or none if one cannot be, and returns them.

        Args:
          manifest: writes one of these files, which is published with them or not at all.
        """
        return publish_together(self.writers, manifest)


class Output(ABC, Generic[R_co]):
    """An output whose files are open.

    Attributes:
      taps: what it takes from the simulation.
    """

    taps: Sequence[AnyTap]

    def simulate(self, stepper: Stepper, until: int) -> None:
        """Runs the simulation up to step `until` for this output alone."""
        observe(stepper, self.taps, until)

    @abstractmethod
    def finish(self) -> Artifact[R_co]:
        """Completes and verifies everything, after the simulation.

        Raises:
          MjrunError: the output cannot be completed.
        """


class EventDrivenOutput(Protocol[R_co]):
    """An output whose files are open, and whose instants depend on events of the simulation.

    Attributes:
      conditions: those whose steps have to be known.
    """

    @property
    def conditions(self) -> Sequence[str]: ...

    def schedule(self, event_steps: EventSteps) -> Output[R_co]:
        """The output, with the steps at which each of `conditions` begins to hold.

        Raises:
          UsageError: an event that it waits for does not happen.
        """
        ...


class Plan(Protocol[R_co]):
    """An output with every name found in the model and every number checked; nothing is open yet."""

    @property
    def enable_flags(self) -> int:
        """Flags of MuJoCo's that must be set for what it measures."""
        ...

    @property
    def until(self) -> int:
        """The last step that it needs."""
        ...

    @property
    def keep_partial(self) -> bool:
        """Whether what there is when the simulation becomes unstable is worth publishing."""
        ...

    def preview(self) -> Preview:
        """What will be made."""
        ...

    def open(self, stack: ExitStack, rendering: SharedRendering) -> Output[R_co] | EventDrivenOutput[R_co]:
        """Opens the files, which proves that they can be written; `stack` discards what is not published."""
        ...


class Task(Protocol[R_co]):
    """An output with all that can be decided without the model."""

    @property
    def renderer(self) -> RendererRequest | None:
        """What it draws with, if it draws: worth detecting while the model loads."""
        ...

    def plan(self, context: Context) -> Plan[R_co]:
        """Finds every name in the model and checks every number.

        Raises:
          UsageError: a name that is not there, or a value that cannot be.
        """
        ...


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
        """Every file that it reads besides those of the simulation, with what it is."""
        return ()

    @property
    def rewritten_inputs(self) -> Sequence[str]:
        """Those of its files that may take the place of what the simulation reads."""
        return ()

    def run(self, reporter: Reporter | None = None) -> R_co:
        """Makes the output. What can fail early fails before the first step.

        Raises:
          FailedAssertionError: what a trace asserts does not hold; its table is published all the same.
          GoldenDifferenceError: a trace differs from its golden table; its own is published all the same.
          MjrunError: nothing was published, unless `keep_partial`, and existing outputs are untouched.
        """
        from mjrun.outputs.perform import perform  # which performs tasks, and imports this

        return perform([self], reporter)[0]

    @abstractmethod
    def task(self) -> Task[R_co]:
        """Its task.

        Raises:
          UsageError: a format that cannot hold the output, or a value that cannot be.
        """
