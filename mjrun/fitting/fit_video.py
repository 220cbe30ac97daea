"""A video of the fitted model with the measured motion as a ghost."""

import itertools
import shutil
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UsageError, clean, concerning, option
from mjrun.fitting.comparison import TIME
from mjrun.fitting.prediction import Chunk
from mjrun.fitting.starting_states import measured_positions
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
class VideoStretch:
    """A stretch of a log with the positions of the fitted model.

    Attributes:
      chunk: the stretch.
      positions: `qpos` of the fitted model at the rows of the stretch, `(n, nq)`.
    """

    chunk: Chunk
    positions: np.ndarray


class _Progress(WarningReporter):
    """A reporter that passes on progress but no warnings, which would concern temporary tables."""

    def __init__(self, reporter: Reporter) -> None:
        self._reporter = reporter

    def warn(self, text: str) -> None:
        pass

    def progress(self, what: str, done: int, total: int) -> None:
        self._reporter.progress(what, done, total)


class FitVideo:
    """The video of a fit.

    Args:
      signals: names of the measured columns.

    Raises:
      UsageError: no position is measured, the camera is unknown, or no video format matches the name.
    """

    def __init__(self, options: FitOptions, model: mujoco.MjModel, signals: Sequence[str]) -> None:
        assert options.video is not None
        self._options, self._measured = options, measured_positions(model, signals)
        if not self._measured:
            raise UsageError(
                f"{option('video')}: no position such as qpos/knee is measured, so there is no motion to show"
            )
        if "%" in options.video or not Path(options.video).suffix:
            raise UsageError(f"{option('video')} {clean(options.video)}: give a single file such as fit.mp4")
        with concerning("video"):
            preview([self._video(Simulation(model, duration=1), options.video)], WarningReporter())

    def writer(
        self, model: mujoco.MjModel, stretches: Sequence[VideoStretch], delays: Sequence[float], reporter: Reporter
    ) -> OutputWriter:
        """Renders the video, to be published and closed by the caller.

        Stretches follow each other without the time between segments and logs. Positions that were not measured are
        those of the model in the ghost too.

        Args:
          model: the fitted model.
          delays: delay of each measured signal [s].

        Raises:
          MjrunError: the video cannot be rendered or written.
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
            video = str(folder / f"video{Path(str(options.video)).suffix}")
            simulation = Simulation(model, replay=f"{folder}/model.npz")
            perform([self._video(simulation, video, f"trace={folder}/log.npz")], _Progress(reporter))
            shutil.copyfile(video, writer.destination.path)
        return writer

    def _video(self, simulation: Simulation, path: str, *ghosts: str) -> Video:
        options = self._options
        return Video(simulation, path, camera=options.camera, size=options.size, text=TEXT, ghost=ghosts)

    def _rows(self, stretches: Sequence[VideoStretch], delays: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
        """Returns times of the video with positions of the model and of the ghost, `(n, 1 + nq)` each."""
        tables: list[np.ndarray] = []
        ghosts: list[np.ndarray] = []
        end = 0.0
        for stretch, following in itertools.zip_longest(stretches, stretches[1:]):
            chunk = stretch.chunk
            times = chunk.segment.times[chunk.rows]
            usual = float(np.median(np.diff(times)))
            continues = following is not None and following.chunk.segment is chunk.segment
            rows = slice(0, len(times) - continues)  # its last row is the first of the next
            ghost = stretch.positions.copy()
            for place, signal in self._measured.items():
                values = chunk.segment.values[:, signal]
                known = np.isfinite(values)
                if known.any():
                    ghost[:, place] = np.interp(times + delays[signal], chunk.segment.times[known], values[known])
            shown = end + times - times[0]
            tables.append(np.column_stack([shown, stretch.positions])[rows])
            ghosts.append(np.column_stack([shown, ghost])[rows])
            end = shown[-1] if continues else shown[-1] + usual
        return np.concatenate(tables), np.concatenate(ghosts)
