"""A process that simulates points of a study: it may crash, hang or run out of memory, and costs nothing else.

`mjrun.study.isolation` starts it, and sends it the study and the folder of its files first, then lists of points. It
answers with the result of each point, and with what it simulates with when it is ready: at the start, and after the
last of a list.
"""

import contextlib
import gc
import os
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, cast

from mjrun.child_process import limit_this_process

if TYPE_CHECKING:
    from mjrun.python_code import Sealed
    from mjrun.study.simulate import StudyPoint, StudySpec


def main(connection: str) -> None:
    """Serves the connection with this descriptor until the other end hangs up."""
    os.dup2(2, 1)  # MuJoCo's plugins print
    limit_this_process(core=0)
    gc.disable()  # modules are no garbage
    from mjrun.study.proof import Proof
    from mjrun.study.simulate import PointSimulator

    gc.freeze()
    gc.enable()
    with contextlib.suppress(EOFError, ConnectionError), Connection(int(connection)) as parent:
        received: tuple[Sealed, Path] = parent.recv()
        sealed, root = received
        spec = cast("StudySpec", sealed.open()).with_files_in(root)
        simulator = PointSimulator(spec)
        parent.send(Proof.here(spec.models([])))
        while True:
            points: Sequence[StudyPoint] = parent.recv()
            for result in simulator.run(points):
                parent.send(result)
            parent.send(Proof.here(spec.models(point.values for point in points)))
    os._exit(0)  # shutting down an interpreter takes time
