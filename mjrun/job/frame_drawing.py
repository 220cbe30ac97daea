"""Drawing the frames of a film: by how many processes, and what is told of the cost."""

from collections.abc import Iterator
from types import TracebackType

import numpy as np

from mjrun.errors import clean
from mjrun.rendering.backend import Backend
from mjrun.rendering.compositor import Costs, SceneCompositor
from mjrun.rendering.process_count import available_cores, guess, jobs_for
from mjrun.rendering.workers import Pool, Workers
from mjrun.reporter import Reporter
from mjrun.sim.state_buffer import StateBuffer

LOOKS = 8  # frames that are looked at to choose the colours of depth
LONG = 2.0  # [s] of drawing by a CPU that a user is told of
TRIED = 2  # frames after which it is known what one costs: the first also compiles shaders
WORTHWHILE = 0.7  # of the time of a frame: a draft that takes more is not spoken of


class Filming:
    """Draws a film by as many processes as are worth it. To be closed.

    Where the number of frames speaks for several, they may start before there is anything to draw. Else the first
    frames are drawn here, and what they cost decides who draws the others.

    Args:
      asked: a number of processes, or `auto`.
      size, panels: of one panel [pixels], and how many there are.

    Attributes:
      jobs: processes that draw.
    """

    def __init__(self, asked: int | str, backend: Backend, size: tuple[int, int], panels: int) -> None:
        self.jobs = 1
        self._guess = guess(size, panels)
        self._asked, self._backend = asked, backend
        self._crew: Workers | None = None

    def start(self, frames: int, cost: float | None = None) -> None:
        """Starts the processes that are worth it for so many frames, if there are none.

        Args:
          cost: wall time of a frame [s], if one was measured.

        Raises:
          BadValueError: the number asked for is none.
          DrawError: they cannot be started.
        """
        if self._crew is None:
            self.jobs = jobs_for(self._asked, self._backend.software, frames, cost or self._guess, available_cores())
            self._crew = Workers(self.jobs, SceneCompositor.__module__) if self.jobs > 1 else None

    def draw(self, drawn: SceneCompositor, states: StateBuffer, reporter: Reporter) -> Iterator[np.ndarray]:
        """Every frame, in order; an array is valid until the next one is asked for.

        Raises:
          MjrunError: a frame cannot be drawn.
        """
        total, done, told = len(states), 0, not self._backend.software
        _choose_colours(drawn, states)
        self.start(total)
        early = self._crew
        if early:
            drawn.close()  # it draws elsewhere
        with Pool(drawn, (drawn.bytes,), early or 1) as pool:
            for frame in pool.frames(states[k] for k in range(total)):
                yield frame
                done += 1
                if done == TRIED and not told:
                    pool.ask("costs")
                if pool.answer and not told:
                    self.start(total - done, pool.answer.frame)
                    self._tell(reporter, total, pool.answer, alone=early is None)
                    told = True
                if self._crew is not early:
                    break
        if pool.answer and not told:
            self._tell(reporter, total, pool.answer, alone=early is None)
        if done < total:
            with Pool(drawn, (drawn.bytes,), self._crew or 1) as pool:
                yield from pool.frames((states[k] for k in range(done, total)), done)

    def close(self) -> None:
        """Ends the processes."""
        if self._crew:
            self._crew.close()

    def __enter__(self) -> "Filming":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _tell(self, reporter: Reporter, frames: int, costs: Costs, *, alone: bool) -> None:
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
            text += f"; --quality draft takes about {1e3 * costs.draft:.0f} ms, without shadows and reflections"
        reporter.warn(text)


def _choose_colours(drawn: SceneCompositor, states: StateBuffer) -> None:
    """Looks at some frames for the colours of depth, where nothing is said of them."""
    colored = any(panel.view == "depth" and not stream.exact for stream in drawn.streams for panel in stream.panels)
    if colored and not drawn.ranges:
        drawn.open()
        chosen = dict.fromkeys(np.linspace(0, len(states) - 1, LOOKS).astype(int).tolist())
        drawn.look_ahead({index: states[index] for index in chosen})
