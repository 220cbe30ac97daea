"""A film of a fit: the fitted model as it goes along, and what was measured as a ghost."""

import itertools
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from mjrun.errors import UsageError, clean, concerning, option
from mjrun.fit.comparison import TIME
from mjrun.fit.prediction import Chunk
from mjrun.fit.starting_states import measured_positions
from mjrun.formats.atomic_output import OutputWriter
from mjrun.formats.destinations import StagedFile
from mjrun.formats.table_writer import TableWriter
from mjrun.formats.tables import output_format
from mjrun.formats.temporary_output import scratch_folder
from mjrun.options.fit import FitOptions
from mjrun.outputs.perform import perform, preview
from mjrun.outputs.video import Video
from mjrun.probe.fields import field_probe
from mjrun.reporter import Reporter, WarningReporter
from mjrun.simulation.simulation import Simulation

TEXT = "fitted model; ghost: as measured"


@dataclass(frozen=True, eq=False)
class FilmedStretch:
    """A stretch of a log, and where the fitted model is at its rows.

    Attributes:
      chunk: the stretch.
      positions: `qpos` of the fitted model, `(n, nq)`.
    """

    chunk: Chunk
    positions: np.ndarray


class _Progress(WarningReporter):
    """Passes on how far it is, and no warnings: of what the tables of a film lack, nobody needs to know."""

    def __init__(self, reporter: Reporter) -> None:
        self._reporter = reporter

    def warn(self, text: str) -> None:
        pass

    def progress(self, what: str, done: int, total: int) -> None:
        self._reporter.progress(what, done, total)


class FitFilm:
    """The film that the options ask for, of a model.

    Args:
      signals: names of what was measured.

    Raises:
      UsageError: no position is measured, there is no such camera, or no format for a film of this name.
    """

    def __init__(self, options: FitOptions, model: mujoco.MjModel, signals: Sequence[str]) -> None:
        assert options.video is not None
        self._options, self._measured = options, measured_positions(model, signals)
        if not self._measured:
            raise UsageError(
                f"{option('video')}: no position is measured, as qpos/knee would be, so there is no motion to show"
            )
        if "%" in options.video or not Path(options.video).suffix:
            raise UsageError(f"{option('video')} {clean(options.video)}: a film of a fit is one file, such as fit.mp4")
        with concerning("video"):
            preview([self._video(Simulation(model, duration=1), options.video)], WarningReporter())

    def writer(
        self, model: mujoco.MjModel, stretches: Sequence[FilmedStretch], delays: Sequence[float], reporter: Reporter
    ) -> OutputWriter:
        """The film, drawn but not published; the caller closes it.

        One stretch follows the other; time between segments and logs is left out. What was not measured is in the
        ghost as in the model.

        Args:
          model: the fitted one.
          delays: of each signal [s], by which it was measured late.

        Raises:
          MjrunError: it cannot be drawn or written.
        """
        options = self._options
        writer = OutputWriter(StagedFile(Path(str(options.video))))
        with writer.opening(), scratch_folder() as folder:
            modelled, measured = self._rows(stretches, delays)
            for name, rows in (("model", modelled), ("log", measured)):
                path = f"{folder}/{name}.npz"
                columns = [TIME, *field_probe(model, "qpos").columns]
                with TableWriter(path, output_format(path).name, columns) as table:
                    table.write(rows)
                    table.publish()
            film = str(folder / f"film{Path(str(options.video)).suffix}")
            simulation = Simulation(model, replay=f"{folder}/model.npz")
            perform([self._video(simulation, film, f"trace={folder}/log.npz")], _Progress(reporter))
            shutil.copyfile(film, writer.destination.path)
        return writer

    def _video(self, simulation: Simulation, path: str, *ghosts: str) -> Video:
        options = self._options
        return Video(simulation, path, camera=options.camera, size=options.size, text=TEXT, ghost=ghosts)

    def _rows(self, stretches: Sequence[FilmedStretch], delays: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
        """Times of the film and positions, of the model and of the ghost: `(n, 1 + nq)` each."""
        tables: list[np.ndarray] = []
        ghosts: list[np.ndarray] = []
        end = 0.0
        for stretch, following in itertools.zip_longest(stretches, stretches[1:]):
            chunk = stretch.chunk
            times = chunk.segment.times[chunk.rows]
            usual = float(np.median(np.diff(times)))
            goes_on = following is not None and following.chunk.segment is chunk.segment
            rows = slice(0, len(times) - goes_on)  # its last row is the first of the next
            ghost = stretch.positions.copy()
            for place, signal in self._measured.items():
                values = chunk.segment.values[:, signal]
                known = np.isfinite(values)
                if known.any():
                    ghost[:, place] = np.interp(times + delays[signal], chunk.segment.times[known], values[known])
            shown = end + times - times[0]
            tables.append(np.column_stack([shown, stretch.positions])[rows])
            ghosts.append(np.column_stack([shown, ghost])[rows])
            end = shown[-1] if goes_on else shown[-1] + usual
        return np.concatenate(tables), np.concatenate(ghosts)
