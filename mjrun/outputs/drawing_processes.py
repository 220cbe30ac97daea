"""The processes that draw the frames of an output: as many as pay off, which is decided from what frames cost."""

import math
from collections.abc import Iterator
from contextlib import closing

import numpy as np

from mjrun.errors import BadValueError, clean, option
from mjrun.options.number_kinds import AUTO
from mjrun.options.rendering import ViewOptions
from mjrun.outputs.camera_panels import panels_of
from mjrun.outputs.output import PassRenderers
from mjrun.physics.recorded_states import StateBuffer
from mjrun.platform import system
from mjrun.platform.cores import available_cores
from mjrun.rendering.backend import Backend
from mjrun.rendering.compositor import DrawingCosts, SceneCompositor
from mjrun.rendering.compositor_pool import CompositorPool, CompositorProcesses
from mjrun.reporter import Reporter

LONG = 2.0  # [s] of rendering on a CPU above which the user is warned
TRIED = 2  # frames after which the cost of one is known: the first also compiles shaders
WORTHWHILE = 0.7  # share of the cost of a frame above which a draft is not recommended
WORTH = 2.0  # [s] of rendering above which more processes save more time than they take to start
FRAME, PIXEL = 0.03, 1e-7  # [s] that llvmpipe takes, roughly, for the shadows of a frame and for each pixel


class DrawingProcesses:
    """The processes that draw the frames of one output.

    If the number of frames alone justifies several, they start before anything is ready to render. Otherwise this
    process renders the first frames, and their cost decides who renders the rest.

    Args:
      options: what the frames show.
      asked: the number of processes, or `auto`.

    Attributes:
      count: the number of processes that render; 1 is this process.
    """

    def __init__(self, options: ViewOptions, asked: int | str, renderers: PassRenderers, reporter: Reporter) -> None:
        # Filament's noise continues from frame to frame: only a single process makes the same video each time.
        self._asked = 1 if asked == AUTO and options.renderer == "filament" else asked
        self._cost = estimated_cost(options.size, len(panels_of(options)))
        self._renderers, self._reporter = renderers, reporter
        self._processes: CompositorProcesses | None = None
        self.count = 1

    def start(self, frames: int, *, software: bool, cost: float | None = None) -> None:
        """Starts as many processes as pay off for this number of frames, unless some are already running.

        Args:
          cost: the measured wall time of a frame [s], if known.

        Raises:
          BadValueError: the requested number of processes is invalid.
          DrawError: the processes cannot be started.
        """
        if self._processes is None:
            cores = available_cores() if system.PASSES_DESCRIPTORS else 1  # by which the processes share memory
            self.count = jobs_for(self._asked, software, frames, cost or self._cost, cores)
            self._processes = self._renderers.workers(self.count) if self.count > 1 else None

    def frames(self, compositor: SceneCompositor, states: StateBuffer, backend: Backend) -> Iterator[np.ndarray]:
        """Yields every frame in order, the files of a frame one after the other in flat bytes."""
        total, done, reported = len(states), 0, not backend.software
        self.start(total, software=backend.software)
        early = self._processes
        if early:
            compositor.close()  # the processes render instead
        with closing(self._pool(compositor)) as pool:
            for frame in pool.frames(states[k] for k in range(total)):
                yield frame
                done += 1
                if done == TRIED and not reported:
                    pool.ask(SceneCompositor.costs)
                if isinstance(pool.answer, DrawingCosts) and not reported:
                    self.start(total - done, software=True, cost=pool.answer.frame)
                    self._report_costs(backend, total, pool.answer, alone=early is None)
                    reported = True
                if self._processes is not early:
                    break
        if isinstance(pool.answer, DrawingCosts) and not reported:
            self._report_costs(backend, total, pool.answer, alone=early is None)
        if done < total:
            with closing(self._pool(compositor)) as pool:
                yield from pool.frames((states[k] for k in range(done, total)), done)

    def _pool(self, compositor: SceneCompositor) -> CompositorPool[SceneCompositor]:
        return CompositorPool(compositor, (compositor.bytes,), self.count, workers=self._processes)

    def _report_costs(self, backend: Backend, frames: int, costs: DrawingCosts, *, alone: bool) -> None:
        """Reports the cost of slow software rendering: of a frame, of all, and of a draft."""
        whole = frames * costs.frame
        if whole < LONG:
            return
        if self.count > 1:
            # A single process renders with more threads than one of several.
            total = f"less than {whole:.0f}" if alone else f"about {whole / self.count:.0f}"
            by = f" by {self.count} processes"
        else:
            total, by = f"about {whole:.0f}", ""
        text = f"software rendering ({clean(backend.renderer)}): {1e3 * costs.frame:.0f} ms per frame, "
        text += f"{total} s in total{by}"
        if costs.draft is not None and costs.draft < WORTHWHILE * costs.frame:
            draft = f"{option('quality')} draft takes about {1e3 * costs.draft:.0f} ms"
            text += f"; {draft}, without shadows and reflections"
        self._reporter.note(text)


def estimated_cost(size: tuple[int, int], panels: int = 1) -> float:
    """Estimates the wall time of a frame [s], before one is measured; `size` is that of a panel [pixels]."""
    return panels * (FRAME + PIXEL * math.prod(size))


def jobs_for(asked: int | str, software: bool, frames: int, cost: float, cores: int) -> int:
    """Returns the number of processes that render a video.

    `auto` means one on a GPU, which processes would only share, and one for a video that takes less than `WORTH`
    seconds; else one per core. A process takes half a second of its core to start, and llvmpipe has its own threads:
    on two cores, two processes save a tenth to a sixth of the time, on more cores more. There are never more
    processes than frames.

    Args:
      asked: the number of processes, or `auto`.
      software: whether a CPU renders.
      cost: wall time to render one frame in one process [s].
      cores: the number of available cores, from `available_cores`.

    Raises:
      BadValueError: `asked` is invalid.
    """
    if asked == AUTO:
        asked = cores if software and frames * cost > WORTH else 1
    if not isinstance(asked, int) or asked < 1:
        raise BadValueError(option("jobs"), asked, f"a number of processes, at least 1, or {AUTO}")
    return max(1, min(asked, frames))
