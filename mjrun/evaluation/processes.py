"""Plays episodes in processes of their own, each with one core, so that all cores are busy whatever the policy is.

Every process has the same environment, and an episode is a function of its seed: which process plays it, and beside
which others, changes no bit of it.
"""

import contextlib
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection, Pipe

from mjrun.child_process import ChildProcess, limit_this_process, python_call
from mjrun.errors import LostEpisodesError, MjrunError
from mjrun.evaluation.episode import Episode, EpisodeSpec
from mjrun.evaluation.player import EpisodePlayer, player_of
from mjrun.python_code import import_from

ENVIRONMENT = {"MUJOCO_GL": "disable", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
BUG = 70


@dataclass(frozen=True)
class Chunk:
    """Episodes that are played in one go.

    Attributes:
      group: which of several they belong to; all of a group have one specification.
      spec: what they have in common.
      seeds: of the episodes.
    """

    group: int
    spec: EpisodeSpec
    seeds: Sequence[int]


@dataclass(frozen=True)
class Failure:
    """An error of mjrun's, as it goes from one process to another."""

    kind: type[MjrunError]
    arguments: tuple[object, ...]
    facts: dict[str, object]

    @classmethod
    def of(cls, error: MjrunError) -> "Failure":
        """`error`, to be sent."""
        return cls(type(error), error.args, dict(vars(error)))

    def error(self) -> MjrunError:
        """The error, as it was raised there."""
        error = self.kind.__new__(self.kind)
        Exception.__init__(error, *self.arguments)
        vars(error).update(self.facts)
        return error


def played(chunks: Sequence[Chunk], processes: int) -> Iterator[tuple[Chunk, Sequence[Episode]]]:
    """The episodes of each chunk, in the order of its seeds; chunks in the order in which they end.

    Args:
      processes: how many play.

    Raises:
      MjrunError: that of the first episode that fails, in the order of the chunks, whichever fails first in time.
      LostEpisodesError: a process ended in the middle of that episode.
    """
    local, started, is_over = threading.local(), list[PlayerProcess](), threading.Event()

    def start() -> None:
        local.process = PlayerProcess()
        started.append(local.process)
        if is_over.is_set():
            local.process.end()

    def play(chunk: Chunk) -> Sequence[Episode]:
        if not hasattr(local, "process"):
            start()
        try:
            return local.process.play(chunk)
        except LostEpisodesError:
            if is_over.is_set():
                raise
            start()
            if len(chunk.seeds) > 1:
                for seed in chunk.seeds:  # one by one, to find the first that ends its process
                    play(replace(chunk, seeds=[seed]))
            raise

    pool = ThreadPoolExecutor(processes, thread_name_prefix="episodes")
    try:
        futures = {pool.submit(play, chunk): place for place, chunk in enumerate(chunks)}
        earlier, failure = {*range(len(chunks))}, None  # chunks that are not played yet and count
        for future in as_completed(futures):
            place = futures[future]
            if place not in earlier:
                continue
            earlier.remove(place)
            try:
                yield chunks[place], future.result()
            except MjrunError as error:
                failure = error
                for later, its_place in futures.items():
                    if its_place > place:
                        later.cancel()
                earlier = {each for each in earlier if each < place}
            if failure and not earlier:
                raise failure
    finally:
        is_over.set()
        pool.shutdown(wait=False, cancel_futures=True)
        for process in list(started):
            process.end()
        pool.shutdown()  # threads that have waited for a process go on when it ends
        for process in started:
            process.close()


class PlayerProcess:
    """A process that plays episodes, as its parent sees it. To be closed."""

    def __init__(self) -> None:
        self._connection, theirs = Pipe()
        with contextlib.closing(theirs):
            self._process = ChildProcess(
                python_call("mjrun.evaluation.processes:main"),
                environment=ENVIRONMENT,
                descriptors=[theirs.fileno()],
                stderr="capture",
            )

    def play(self, chunk: Chunk) -> Sequence[Episode]:
        """The episodes of a chunk.

        Raises:
          MjrunError: what an episode raises.
          LostEpisodesError: the process has ended.
        """
        self._send(chunk)
        try:
            answer: Failure | Sequence[Episode] = self._connection.recv()
        except (EOFError, OSError):
            ending = self._process.wait()
            words = f": {self._process.last_words}" if self._process.last_words else ""
            raise LostEpisodesError(chunk.seeds, f"{ending}{words}") from None
        if isinstance(answer, Failure):
            raise answer.error()
        return answer

    def end(self) -> None:
        """Ends the process, whatever it does; `play` fails then, in whichever thread."""
        self._process.end()

    def close(self) -> None:
        """Ends the process, and frees what it had."""
        self.end()
        self._connection.close()

    def _send(self, message: object) -> None:
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # it has ended; `play` says why
            self._connection.send(message)


def main(connection: str) -> None:
    """Plays what the other end of this descriptor sends, until it hangs up."""
    import os
    import warnings

    os.dup2(2, 1)  # MuJoCo's plugins print
    limit_this_process(core=0)
    warnings.simplefilter("ignore")  # the parent tells what there is to tell
    with contextlib.suppress(EOFError, ConnectionError), Connection(int(connection)) as parent:
        player: tuple[int, EpisodePlayer] | None = None
        while True:
            chunk: Chunk = parent.recv()
            try:
                if player is None or player[0] != chunk.group:
                    import_from(chunk.spec.chosen.modules)
                    player = chunk.group, player_of(chunk.spec)
                parent.send(player[1].play(chunk.seeds))
            except MjrunError as error:
                parent.send(Failure.of(error))
    os._exit(0)  # shutting down an interpreter takes time
