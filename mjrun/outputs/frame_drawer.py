"""Drawing the frames of a video: in how many processes, and what the user should know of the cost."""

from collections.abc import Iterator

import numpy as np

from mjrun.errors import clean, option
from mjrun.outputs.output import SharedRendering
from mjrun.physics.replay import StateBuffer
from mjrun.platform.cores import available_cores
from mjrun.rendering.backend import Backend
from mjrun.rendering.compositor import DrawingCosts, SceneCompositor
from mjrun.rendering.workers import PainterProcesses, ParallelPainter, estimated_cost, jobs_for
from mjrun.reporter import Reporter

DEPTH_SAMPLES = 8  # frames that are looked at to choose the colours of depth
LONG = 2.0  # [s] of drawing by a CPU that a user is warned of
TRIED = 2  # frames after which the cost of one is known: the first also compiles shaders
WORTHWHILE = 0.7  # of the time of a frame: a draft that takes more is not recommended


class FrameDrawer:
    """Draws a video in as many processes as are worth it.

    Where the number of frames speaks for several, they may start before there is anything to draw. Else the first
    frames are drawn here, and what they cost decides who draws the others.

    Args:
      asked: a number of processes, or `auto`.
      size, panels: of one panel [pixels], and how many there are.
      rendering: whose workers draw.

    Attributes:
      jobs: processes that draw.
    """

    def __init__(
        self, asked: int | str, backend: Backend, size: tuple[int, int], panels: int, rendering: SharedRendering
    ) -> None:
        self.jobs = 1
        self._estimate = estimated_cost(size, panels)
        self._asked, self._backend, self._rendering = asked, backend, rendering
        self._workers: PainterProcesses | None = None

    def start(self, frames: int, cost: float | None = None) -> None:
        """Starts the processes that are worth it for so many frames, if there are none.

        Args:
          cost: wall time of a frame [s], if one was measured.

        Raises:
          BadValueError: the number asked for cannot be.
          DrawError: they cannot be started.
        """
        if self._workers is None:
            cost = cost or self._estimate
            self.jobs = jobs_for(self._asked, self._backend.software, frames, cost, available_cores())
            self._workers = self._rendering.workers(self.jobs) if self.jobs > 1 else None

    def draw(self, compositor: SceneCompositor, states: StateBuffer, reporter: Reporter) -> Iterator[np.ndarray]:
        """Every frame, in order; an array is valid until the next one is asked for.

        Raises:
          MjrunError: a frame cannot be drawn.
        """
        total, done, reported = len(states), 0, not self._backend.software
        _choose_depth_colours(compositor, states)
        self.start(total)
        early = self._workers
        if early:
            compositor.close()  # it draws elsewhere
        with self._pool(compositor) as pool:
            for frame in pool.frames(states[k] for k in range(total)):
                yield frame
                done += 1
                if done == TRIED and not reported:
                    pool.ask(SceneCompositor.costs)
                if isinstance(pool.answer, DrawingCosts) and not reported:
                    self.start(total - done, pool.answer.frame)
                    self._warn(reporter, total, pool.answer, alone=early is None)
                    reported = True
                if self._workers is not early:
                    break
        if isinstance(pool.answer, DrawingCosts) and not reported:
            self._warn(reporter, total, pool.answer, alone=early is None)
        if done < total:
            with self._pool(compositor) as pool:
                yield from pool.frames((states[k] for k in range(done, total)), done)

    def _pool(self, compositor: SceneCompositor) -> ParallelPainter[SceneCompositor]:
        return ParallelPainter(compositor, (compositor.bytes,), self.jobs, workers=self._workers)

    def _warn(self, reporter: Reporter, frames: int, costs: DrawingCosts, *, alone: bool) -> None:
        """Warns that a CPU draws, if that takes long, with what a frame costs and would cost as a draft."""
        whole = frames * costs.frame
        if whole < LONG:
            return
        if self.jobs > 1:
            # Alone a process draws with more threads than beside others.
            total = f"less than {whole:.0f}" if alone else f"about {whole / self.jobs:.0f}"
            by = f" by {self.jobs} processes"
        else:
            total, by = f"about {whole:.0f}", ""
        text = f"drawing in software ({clean(self._backend.renderer)}): {1e3 * costs.frame:.0f} ms per frame, "
        text += f"{total} s in all{by}"
        if costs.draft is not None and costs.draft < WORTHWHILE * costs.frame:
            draft = f"{option('quality')} draft takes about {1e3 * costs.draft:.0f} ms"
            text += f"; {draft}, without shadows and reflections"
        reporter.warn(text)


def _choose_depth_colours(compositor: SceneCompositor, states: StateBuffer) -> None:
    """Looks at some frames for the colours of depth, unless a range was given."""
    coloured = any(panel.view == "depth" and not s.exact for s in compositor.streams for panel in s.panels)
    if coloured and not compositor.ranges:
        compositor.open()
        chosen = dict.fromkeys(np.linspace(0, len(states) - 1, DEPTH_SAMPLES).astype(int).tolist())
        compositor.look_ahead({index: states[index] for index in chosen})
