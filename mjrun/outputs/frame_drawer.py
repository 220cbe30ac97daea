"""Rendering of a video's frames: the number of processes, and a warning about the cost."""

import math
from collections.abc import Iterator
from contextlib import closing

import numpy as np

from mjrun.errors import BadValueError, clean, option
from mjrun.options.number_kinds import AUTO
from mjrun.outputs.output import PassRenderers
from mjrun.physics.recorded_states import StateBuffer
from mjrun.platform import system
from mjrun.platform.cores import available_cores
from mjrun.rendering.backend import Backend, lacks_gpu
from mjrun.rendering.compositor import DrawingCosts, SceneCompositor
from mjrun.rendering.workers import PainterProcesses, ParallelPainter
from mjrun.reporter import Reporter

DEPTH_SAMPLES = 8  # frames sampled to choose the colour range of depth
LONG = 2.0  # [s] of rendering on a CPU above which the user is warned
TRIED = 2  # frames after which the cost of one is known: the first also compiles shaders
WORTHWHILE = 0.7  # share of the cost of a frame above which a draft is not recommended
WORTH = 2.0  # [s] of rendering above which more processes save more time than they take to start
FRAME, PIXEL = 0.03, 1e-7  # [s] that llvmpipe takes, roughly, for the shadows of a frame and for each pixel


class FrameDrawer:
    """A renderer of whole videos that uses as many processes as pay off.

    If the number of frames alone justifies several processes, they can start before anything is ready to render.
    Otherwise the first frames are rendered in this process, and their cost decides who renders the rest.

    Args:
      asked: the number of processes, or `auto`.
      size, panels: the size of one panel [pixels] and the number of panels.
      rendering: the owner of the worker processes.

    Attributes:
      jobs: the number of processes that render.
    """

    def __init__(
        self, asked: int | str, backend: Backend, size: tuple[int, int], panels: int, rendering: PassRenderers
    ) -> None:
        self.jobs = 1
        self._estimate = estimated_cost(size, panels)
        self._asked, self._backend, self._rendering = asked, backend, rendering
        self._workers: PainterProcesses | None = None

    def start(self, frames: int, cost: float | None = None) -> None:
        """Starts as many processes as pay off for this number of frames, unless some are already running.

        Args:
          cost: the measured wall time of a frame [s], if known.

        Raises:
          BadValueError: the requested number of processes is invalid.
          DrawError: the processes cannot be started.
        """
        if self._workers is None:
            cost = cost or self._estimate
            cores = available_cores() if system.PASSES_DESCRIPTORS else 1  # by which the processes share memory
            self.jobs = jobs_for(self._asked, self._backend.software, frames, cost, cores)
            self._workers = self._rendering.workers(self.jobs) if self.jobs > 1 else None

    def draw(self, compositor: SceneCompositor, states: StateBuffer, reporter: Reporter) -> Iterator[np.ndarray]:
        """Yields every frame in order; an array is valid until the next one is requested.

        Raises:
          MjrunError: a frame cannot be rendered.
        """
        total, done, reported = len(states), 0, not self._backend.software
        _choose_depth_colours(compositor, states)
        self.start(total)
        early = self._workers
        if early:
            compositor.close()  # the workers render instead
        with closing(self._pool(compositor)) as pool:
            for frame in pool.frames(states[k] for k in range(total)):
                yield frame
                done += 1
                if done == TRIED and not reported:
                    pool.ask(SceneCompositor.costs)
                if isinstance(pool.answer, DrawingCosts) and not reported:
                    self.start(total - done, pool.answer.frame)
                    self._report_costs(reporter, total, pool.answer, alone=early is None)
                    reported = True
                if self._workers is not early:
                    break
        if isinstance(pool.answer, DrawingCosts) and not reported:
            self._report_costs(reporter, total, pool.answer, alone=early is None)
        if done < total:
            with closing(self._pool(compositor)) as pool:
                yield from pool.frames((states[k] for k in range(done, total)), done)

    def _pool(self, compositor: SceneCompositor) -> ParallelPainter[SceneCompositor]:
        return ParallelPainter(compositor, (compositor.bytes,), self.jobs, workers=self._workers)

    def _report_costs(self, reporter: Reporter, frames: int, costs: DrawingCosts, *, alone: bool) -> None:
        """Reports the cost of slow software rendering: of a frame, of all, and of a draft."""
        whole = frames * costs.frame
        if whole < LONG:
            return
        if self.jobs > 1:
            # A single process renders with more threads than one of several.
            total = f"less than {whole:.0f}" if alone else f"about {whole / self.jobs:.0f}"
            by = f" by {self.jobs} processes"
        else:
            total, by = f"about {whole:.0f}", ""
        text = f"software rendering ({clean(self._backend.renderer)}): {1e3 * costs.frame:.0f} ms per frame, "
        text += f"{total} s in total{by}"
        if costs.draft is not None and costs.draft < WORTHWHILE * costs.frame:
            draft = f"{option('quality')} draft takes about {1e3 * costs.draft:.0f} ms"
            text += f"; {draft}, without shadows and reflections"
        reporter.note(text)


def _choose_depth_colours(compositor: SceneCompositor, states: StateBuffer) -> None:
    """Chooses the colour range of depth from sampled frames, unless a range was set."""
    coloured = any(panel.view == "depth" and not s.exact for s in compositor.streams for panel in s.panels)
    if coloured and not compositor.ranges:
        compositor.open()
        chosen = dict.fromkeys(np.linspace(0, len(states) - 1, DEPTH_SAMPLES).astype(int).tolist())
        compositor.look_ahead({index: states[index] for index in chosen})


def start_early(asked: int | str, size: tuple[int, int], panels: int, frames: int, rendering: PassRenderers) -> None:
    """Starts the processes of a `FrameDrawer` while the backend is being detected, where their number is certain."""
    if system.PASSES_DESCRIPTORS and lacks_gpu():
        jobs = jobs_for(asked, True, frames, estimated_cost(size, panels), available_cores())
        if jobs > 1:
            rendering.workers(jobs)


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
