"""The number of processes that are worth drawing with."""

import math

from mjrun.errors import BadValueError, option
from mjrun.options.kinds import AUTO

WORTH = 2.0  # [s] of drawing above which more processes save more time than they take to start
FRAME, PIXEL = 0.03, 1e-7  # [s] that llvmpipe takes, roughly, for the shadows of a frame and for each pixel


def estimated_cost(size: tuple[int, int], panels: int = 1) -> float:
    """An estimate of the wall time of a frame [s], before one is measured; `size` is that of a panel [pixels]."""
    return panels * (FRAME + PIXEL * math.prod(size))


def jobs_for(asked: int | str, software: bool, frames: int, cost: float, cores: int) -> int:
    """The number of processes that draw a video.

    `auto` means one on a GPU, which processes would only share, and one for a video that it draws within `WORTH`
    seconds; else one per core. A process takes half a second of its core to start, and llvmpipe has threads of its
    own: on two cores, two processes save a tenth to a sixth of the time, on more cores more. There are never more
    processes than frames.

    Args:
      asked: a number from 1 on, or `auto`.
      software: whether a CPU draws.
      cost: wall time to draw one frame in one process [s].
      cores: that may be used, from `available_cores`.

    Raises:
      BadValueError: `asked` is neither.
    """
    if asked == AUTO:
        asked = cores if software and frames * cost > WORTH else 1
    if not isinstance(asked, int) or asked < 1:
        raise BadValueError(option("jobs"), asked, f"a number of processes from 1 on, or {AUTO}")
    return max(1, min(asked, frames))
