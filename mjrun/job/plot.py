"""A plot: measured values over time, as a picture."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import KW_ONLY, dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np

from mjrun.errors import BadValueError, UsageError, quoted
from mjrun.formats.image_format import image_format
from mjrun.formats.image_writer import ImageWriter
from mjrun.job.manifest import origin
from mjrun.job.output_files import named
from mjrun.job.perform import Artifact, Context, Preview, Work, perform
from mjrun.job.simulation import Simulation, lone
from mjrun.job.trace import rows
from mjrun.job.trace_rows import RowBuffer, Rows, Table
from mjrun.job.view import tags
from mjrun.probe.select import split
from mjrun.rendering.graph import Graph
from mjrun.reporter import Reporter
from mjrun.sim.observe import Tap

SIZE = (1280, 720)
SMALLEST = (80, 60)  # of a graph [pixels]
LETTERS, SMALLEST_LETTERS = 0.022, 9  # size of letters: a share of the picture's shorter side, [pixels]


@dataclass(frozen=True)
class Plot:
    """What to plot.

    Args:
      simulation: what happens.
      output: a picture: .png, .jpg, .webp, .tiff.
      probes: values of each graph: `energy`, `qpos[left_*],qvel/hip`. Graphs stand one under the other.
      size: width and height of the picture [pixels].
      every: steps between samples.
      rate: samples per simulated second [Hz], instead of `every`.
      format: instead of the output's suffix.
      manifest: a file for what made the plot.
      command: the command line, for the manifest.
    """

    simulation: Simulation
    output: str
    _: KW_ONLY
    probes: Sequence[str]
    size: tuple[int, int] = SIZE
    every: int = 1
    rate: float | str | Fraction | None = None
    format: str | None = None
    manifest: str | None = None
    command: str = ""

    def __post_init__(self) -> None:
        lone(self, "probes")
        if not self.probes:
            raise UsageError("a plot needs values: energy, qpos[left_*], …")
        width, height = self.size
        if width < SMALLEST[0] or height // len(self.probes) < SMALLEST[1]:
            least = f"at least {SMALLEST[0]}x{SMALLEST[1] * len(self.probes)} for {len(self.probes)} graphs"
            raise BadValueError("size", f"{width}x{height}", least)

    @property
    def files(self) -> list[tuple[str, str]]:
        """Every file that it writes, with what it is."""
        return named(self, "output", "manifest")

    def run(self, reporter: Reporter | None = None) -> "PlotResult":
        """Makes the plot. What can fail early fails before the first step.

        Raises:
          MjrunError: nothing was published, and an existing output is untouched.
        """
        return perform([self], reporter)[0]

    def work(self, stack: ExitStack) -> "PlotWork":
        """The work that makes it."""
        return PlotWork(self)


@dataclass(frozen=True)
class PlotResult:
    """What plot was made.

    Attributes:
      path: where it is.
      size: width and height [pixels].
      samples: of each curve.
      wall: wall time of all [s].
      warnings: what MuJoCo warned of.
    """

    path: str
    size: tuple[int, int]
    samples: int
    wall: float
    warnings: Sequence[str]


class PlotWork(Work):
    """A plot in the making."""

    def __init__(self, job: Plot) -> None:
        self._job = job
        self._format = image_format(job.output, "rgb", job.format)

    def plan(self, ground: Context) -> None:
        job = self._job
        self._ground, self.until = ground, ground.timeline.steps
        self._rows = rows(ground.timeline, job.every, job.rate)
        self._tables = [Table(ground.model, split(text), ground.timeline) for text in job.probes]
        for text, table in zip(job.probes, self._tables, strict=True):
            if len(table.columns) == 1:
                raise UsageError(f"plot {quoted(text)}: this model has none of it")
        # One table of all, so that each instant is computed once.
        asked = [part for text in job.probes for part in split(text)]
        self._table = Table(ground.model, list(dict.fromkeys(asked)), ground.timeline)
        self.model = self._table.model

    def open(self, stack: ExitStack) -> None:
        job, ground = self._job, self._ground
        self._facts = origin(job, job.simulation, ground.model, ground.timeline)
        sink = ImageWriter(job.output, "rgb", self._format, job.size, tags(job.output, self._facts))
        self._sink = stack.enter_context(sink)
        self._blocks: list[np.ndarray] = []
        self._waiting = RowBuffer(self._table, self._rows, self._keep)

    def taps(self) -> Sequence[Tap]:
        """A sample at each of its instants."""
        return [Tap(self._rows, self._table.read, self._waiting.add)]

    def outline(self) -> Preview:
        about = f"{self._format}, {'; '.join(self._job.probes)}"
        return Preview("plot", self._job.output, len(self._rows), "samples", self._job.size, about)

    def finish(self, wall: float) -> Artifact:
        self._waiting.flush()
        values = np.concatenate(self._blocks)
        index = {column.name: k for k, column in enumerate(self._table.columns)}
        heights = np.diff(np.linspace(0, self._job.size[1], len(self._tables) + 1).astype(int))
        em, pictures = max(SMALLEST_LETTERS, LETTERS * min(self._job.size)), []
        for table, height in zip(self._tables, heights, strict=True):
            shown = table.columns[1:]
            found = values[:, [index[column.name] for column in shown]]
            names, units = [column.name for column in shown], [column.unit for column in shown]
            graph = Graph(values[:, 0], found, names, units, (self._job.size[0], int(height)), em)
            pictures.append(graph.draw(float(values[-1, 0])))
        self._sink.write(np.concatenate(pictures))
        files = self._sink.publish()
        return Artifact(self._facts, files, lambda total, heard: self._result(len(values), total, heard))

    def _keep(self, block: Rows) -> None:
        self._blocks.append(block.values)

    def _result(self, samples: int, wall: float, heard: Sequence[str]) -> PlotResult:
        return PlotResult(str(Path(self._job.output)), self._job.size, samples, wall, heard)
