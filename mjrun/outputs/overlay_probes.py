"""Values shown over frames and plotted beside them, measured at the instants of the frames.

The text over frames is a template: time, speed and measured values in braces.
"""

import string
from collections.abc import Mapping, Sequence
from dataclasses import replace

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UnknownNameError, UsageError, concerning, option, quoted
from mjrun.outputs.trace_rows import ProbeSampler
from mjrun.physics.stepper import Stepper
from mjrun.probe.episode_columns import EpisodeColumns
from mjrun.probe.select import available_columns, split
from mjrun.rendering.compositor import Overlay
from mjrun.rendering.graph import Graph, aligned, graph_size
from mjrun.timeline import Timeline

# The values of each table at one frame.
FrameValues = Sequence[np.ndarray]
BUILTIN = {"time": ".2f", "frame": "d", "step": "d", "speed": "g"}
DEFAULT_FORMAT = ".4g"


@dataclass(frozen=True)
class OverlayTextPart:
    """Literal text, then a value by name and format, if any."""

    literal: str
    name: str = ""
    form: str = ""


@dataclass(frozen=True)
class OverlayText:
    """A text with values in braces: `{time:.2f} s  {qpos/knee:.1f}`; `\\n` begins a line, `{{` is a brace."""

    parts: Sequence[OverlayTextPart]

    @property
    def columns(self) -> list[str]:
        """The columns that the text shows, without duplicates."""
        return list(dict.fromkeys(part.name for part in self.parts if part.name and part.name not in BUILTIN))

    def filled(self, values: Mapping[str, float]) -> str:
        """Returns the text with `values` inserted by name."""
        texts: list[str] = []
        for part in self.parts:
            value = format(values[part.name], part.form) if part.name else ""
            texts.append(part.literal + value)
        return "".join(texts)


@dataclass(frozen=True)
class OverlayProbes:
    """The measurement of the values in a text and in plots.

    Attributes:
      text: the template.
      tables: the columns of the text, then those of each plot.
      model: the model with all flags enabled that the measured values require.
    """

    text: OverlayText
    tables: Sequence[ProbeSampler]
    model: mujoco.MjModel

    @property
    def idle(self) -> bool:
        """True if nothing is measured."""
        return all(len(table.columns) == 1 for table in self.tables)

    def read(self, stepper: Stepper) -> list[np.ndarray]:
        """Returns the values of each table at the stepper's instant."""
        return [table.values(stepper) for table in self.tables]

    def overlay(
        self,
        empty: Overlay,
        rows: Sequence[FrameValues],
        steps: Sequence[int],
        speeds: Sequence[float],
        timeline: Timeline,
    ) -> Overlay:
        """Returns `empty` with its texts and graphs.

        Args:
          rows: the values read at each frame; empty if nothing is measured.
          steps, speeds: step and speed of each frame.
        """
        times = [float(timeline.time(step)) for step in steps]
        texts = self._texts(rows, steps, times, speeds) if self.text.parts else []
        graphs: list[Graph] = []
        for index, (table, size) in enumerate(zip(self.tables[1:], empty.plots, strict=True), start=1):
            values = np.array([row[index] for row in rows])
            names, units = zip(*((column.name, column.unit) for column in table.columns[1:]), strict=True)
            graphs.append(Graph(np.array(times), values, names, units, size))
        return replace(empty, texts=texts, graphs=aligned(graphs), times=times)

    def _texts(
        self, rows: Sequence[FrameValues], steps: Sequence[int], times: Sequence[float], speeds: Sequence[float]
    ) -> list[str]:
        names = [column.name for column in self.tables[0].columns[1:]]
        texts: list[str] = []
        for index, (step, time, speed) in enumerate(zip(steps, times, speeds, strict=True)):
            row = dict(zip(names, rows[index][0].tolist(), strict=True)) if names else {}
            texts.append(self.text.filled({**row, "time": time, "frame": index, "step": step, "speed": speed}))
        return texts


def parse_template(text: str, columns: Sequence[str]) -> OverlayText:
    """Parses a template.

    Args:
      columns: the columns that can be measured.

    Raises:
      UnknownNameError: a value is unknown.
      UsageError: a brace is not closed, or a format does not suit numbers.
    """
    try:
        parsed = list(string.Formatter().parse(text.replace("\\n", "\n")))
    except ValueError as error:
        raise UsageError(
            f"{option('text')} {quoted(text)}: {error}\nwrite a value as {{time:.2f}} and a brace as {{{{"
        ) from None
    valid = [*BUILTIN, *columns]
    return OverlayText([_part(literal, name, form, valid) for literal, name, form, _ in parsed])


def _part(literal: str, name: str | None, form: str | None, valid: Sequence[str]) -> OverlayTextPart:
    if name is None:
        return OverlayTextPart(literal)
    whole = f"{name}:{form}" if form else name  # a column may hold a colon itself, as in qpos/joint:0
    column = max((column for column in valid if whole == column or whole.startswith(f"{column}:")), key=len, default="")
    if not column:
        raise UnknownNameError("value", name, valid, where=option("text"))
    form = whole[len(column) + 1 :] or BUILTIN.get(column, DEFAULT_FORMAT)
    try:
        format(1 if column in ("frame", "step") else 1.0, form)
    except ValueError as error:
        raise UsageError(f"{option('text')}: {quoted(form)} cannot format {quoted(column)}: {error}") from None
    return OverlayTextPart(literal, column, form)


def overlay_probes(
    model: mujoco.MjModel,
    timeline: Timeline,
    text: str | None,
    plots: Sequence[str] = (),
    episode: EpisodeColumns | None = None,
) -> OverlayProbes:
    """Returns the probes for the values in `text` and in each of `plots`.

    Raises:
      UnknownNameError: a value cannot be measured.
      UsageError: a plot selects no column.
    """
    with concerning("text"):
        columns = [column.name for column in available_columns(model, episode)] if text else []
        template = parse_template(text, columns) if text else OverlayText([])
        tables = [ProbeSampler(model, template.columns, timeline, episode)]
    for index, plot in enumerate(plots):
        with concerning("plot", index):
            tables.append(ProbeSampler(tables[-1].model, split(plot), timeline, episode))
            if len(tables[-1].columns) == 1:
                raise UsageError(f"{option('plot')} {quoted(plot)}: this model has no such values")
    return OverlayProbes(template, tables, tables[-1].model)


def empty_overlay(size: tuple[int, int], corner: str, plots: Sequence[str] = (), side: str = "under") -> Overlay:
    """Returns an overlay without content, whose size is known.

    Args:
      size: width and height of the frame without the overlay [pixels].
    """
    return Overlay(corner=corner, plots=[graph_size(size, side)] * len(plots), side=side)
