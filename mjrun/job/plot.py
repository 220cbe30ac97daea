"""A plot: measured values over time, as a picture."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from mjrun.errors import BadValueError, UsageError, concerning, option, quoted
from mjrun.formats.image_format import image_format
from mjrun.formats.image_writer import ImageWriter
from mjrun.job.drawing import metadata_tags
from mjrun.job.manifest import origin
from mjrun.job.output_files import named_files
from mjrun.job.perform import perform
from mjrun.job.shared_rendering import SharedRendering
from mjrun.job.task import Artifact, Context, Job, Output, OutputResult, PassSummary, Preview
from mjrun.job.trace import row_steps
from mjrun.job.trace_rows import ProbeSampler, RowBuffer
from mjrun.options.option import options
from mjrun.options.trace import PlotOptions
from mjrun.probe.select import split
from mjrun.rendering.graph import Graph, aligned
from mjrun.reporter import Reporter
from mjrun.sim.observe import Tap

SMALLEST = (80, 60)  # of a graph [pixels]
LETTERS, SMALLEST_LETTERS = 0.022, 9  # size of letters: a share of the picture's shorter side, [pixels]


@options
class Plot(PlotOptions, Job["PlotResult"]):
    """A plot of values measured in a simulation: its options are keywords."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.probe:
            raise UsageError(f"{option('probe')}: a plot needs values: energy, qpos[left_*], …")
        width, height = self.size
        if width < SMALLEST[0] or height // len(self.probe) < SMALLEST[1]:
            least = f"at least {SMALLEST[0]}x{SMALLEST[1] * len(self.probe)} for {len(self.probe)} panels"
            raise BadValueError(option("size"), f"{width}x{height}", least)

    @property
    def files(self) -> list[tuple[str, str]]:
        """Every file that it writes, with what it is."""
        return named_files(output=self.output, manifest=self.manifest)

    def run(self, reporter: Reporter | None = None) -> "PlotResult":
        """Makes the plot. What can fail early fails before the first step.

        Raises:
          MjrunError: nothing was published, and an existing output is untouched.
        """
        return perform([self], reporter)[0]

    def task(self) -> "PlotTask":
        """Its task, with the format chosen.

        Raises:
          UsageError: a format that cannot hold a plot.
        """
        return PlotTask(self, image_format(self.output, "rgb", self.format))


@dataclass(frozen=True)
class PlotResult(OutputResult):
    """What plot was made.

    Attributes:
      path: where it is.
      size: width and height [pixels].
      samples: of each curve.
      wall: wall time of all [s].
      warnings: MuJoCo's.
    """

    size: tuple[int, int]
    samples: int
    wall: float
    warnings: Sequence[str]


@dataclass(frozen=True)
class PlotTask:
    """A plot, with its format chosen."""

    job: Plot
    format: str

    renderer = None

    def plan(self, context: Context) -> "PlotPlan":
        """Finds the probes in the model."""
        graphs: list[ProbeSampler] = []
        for index, text in enumerate(self.job.probe):
            with concerning("probe", index):
                graphs.append(ProbeSampler(context.model, split(text), context.timeline))
                if len(graphs[-1].columns) == 1:
                    raise UsageError(f"plot {quoted(text)}: this model has none of it")
        # One table of all, so that each instant is computed once.
        probes = [part for text in self.job.probe for part in split(text)]
        table = ProbeSampler(context.model, list(dict.fromkeys(probes)), context.timeline)
        return PlotPlan(self, context, row_steps(context.timeline, self.job.every, self.job.rate), graphs, table)


@dataclass(frozen=True)
class PlotPlan:
    """A plot of a model.

    Attributes:
      steps: of the samples.
      graphs: the columns of each graph.
      table: all columns.
    """

    task: PlotTask
    context: Context
    steps: Sequence[int]
    graphs: Sequence[ProbeSampler]
    table: ProbeSampler

    keep_partial = False

    @property
    def enable_flags(self) -> int:
        return self.table.model.opt.enableflags

    @property
    def until(self) -> int:
        return self.context.timeline.steps

    def preview(self) -> Preview:
        job = self.task.job
        about = f"{self.task.format}, {'; '.join(job.probe)}"
        return Preview("plot", job.output, len(self.steps), "samples", job.size, about)

    def open(self, stack: ExitStack, rendering: SharedRendering) -> "PlotOutput":
        job, context = self.task.job, self.context
        facts = origin(job, job.simulation, context.model, context.timeline)
        writer = ImageWriter(job.output, "rgb", self.task.format, job.size, metadata_tags(job.output, facts))
        return PlotOutput(self, facts, stack.enter_context(writer))


class PlotOutput(Output[PlotResult]):
    """A plot whose file is open."""

    def __init__(self, plan: PlotPlan, facts: Mapping[str, object], writer: ImageWriter) -> None:
        self._plan, self._facts, self._writer = plan, facts, writer
        self._blocks: list[np.ndarray] = []
        self._buffer = RowBuffer(plan.table, plan.steps, lambda block: self._blocks.append(block.values))
        self.taps = [Tap(plan.steps, plan.table.read, self._buffer.add)]

    def finish(self) -> Artifact[PlotResult]:
        self._buffer.flush()
        values = np.concatenate(self._blocks)
        self._writer.write(self._drawn(values))
        self._writer.finish()
        return Artifact(self._facts, [self._writer], partial(self._result, len(values)))

    def _drawn(self, values: np.ndarray) -> np.ndarray:
        """The picture `(height, width, 3)` of all graphs, one under the other."""
        width, height = self._plan.task.job.size
        index = {column.name: k for k, column in enumerate(self._plan.table.columns)}
        edges = np.linspace(0, height, len(self._plan.graphs) + 1).astype(int)
        em = max(SMALLEST_LETTERS, LETTERS * min(width, height))

        graphs: list[Graph] = []
        for table, rows in zip(self._plan.graphs, np.diff(edges), strict=True):
            names, units = zip(*((column.name, column.unit) for column in table.columns[1:]), strict=True)
            shown = values[:, [index[name] for name in names]]
            graphs.append(Graph(values[:, 0], shown, names, units, (width, int(rows)), em))
        return np.concatenate([graph.draw(float(values[-1, 0])) for graph in aligned(graphs)])

    def _result(self, samples: int, files: Sequence[Path], summary: PassSummary) -> PlotResult:
        job = self._plan.task.job
        return PlotResult(str(Path(job.output)), job.size, samples, summary.wall, summary.warnings)
