"""Execution of all episodes of an evaluation, in chunks and in processes with one core each.

An episode is a function of its seed: neither its process nor the episodes beside it change a bit of the result.
"""

import threading
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

from mjrun.dataclass import dataclass
from mjrun.errors import LostEpisodesError
from mjrun.evaluation.episode import EpisodeRecord, EpisodeSpec, PlayedEpisodes
from mjrun.evaluation.player import EpisodePlayer, player_of
from mjrun.evaluation.prepared import EpisodeGroup
from mjrun.platform.cores import available_cores
from mjrun.python_code import import_from
from mjrun.reporter import Reporter
from mjrun.worker import Worker, WorkerEndedError

CHUNKS = 4  # per process, so that all processes end at about the same time
MOST = 64  # episodes in a chunk


@dataclass(frozen=True)
class EpisodeChunk:
    """Episodes that one process plays in one go.

    Attributes:
      group: index of their group, in which all episodes have one specification.
      spec: the specification.
      seeds: seeds of the episodes.
    """

    group: int
    spec: EpisodeSpec
    seeds: Sequence[int]


def play_all(
    groups: Sequence[EpisodeGroup], seeds: Sequence[int], jobs: int | str, reporter: Reporter
) -> list[PlayedEpisodes]:
    """Plays the episodes of `seeds` of each group, and returns them in that order.

    Args:
      jobs: number of processes, or `auto`. Python policies that are not named by a text play in this process, since no
        other could create them.

    Raises:
      MjrunError: an episode failed.
    """
    episodes: list[list[EpisodeRecord]] = [[] for _ in groups]

    def add(chunk: EpisodeChunk, records: Sequence[EpisodeRecord]) -> None:
        episodes[chunk.group] += records
        reporter.progress("episodes", sum(map(len, episodes)), len(groups) * len(seeds))

    count = jobs if isinstance(jobs, int) else available_cores()
    shared = [place for place, group in enumerate(groups) if isinstance(group.spec.chosen.policy, str)]
    chunks = _chunks(groups, shared, seeds, count)
    for chunk, records in played(chunks, max(1, min(count, len(chunks)))):
        add(chunk, records)
    for place in sorted({*range(len(groups))} - {*shared}):
        player = player_of(groups[place].spec)
        for chunk in _chunks(groups, [place], seeds, 1):
            add(chunk, player.play(chunk.seeds))
    return [PlayedEpisodes(group.name, group.point, episodes[place]) for place, group in enumerate(groups)]


def _chunks(
    groups: Sequence[EpisodeGroup], places: Sequence[int], seeds: Sequence[int], processes: int
) -> list[EpisodeChunk]:
    size = max(1, min(MOST, -(-len(places) * len(seeds) // (CHUNKS * processes))))
    return [
        EpisodeChunk(place, groups[place].spec, seeds[start : start + size])
        for place in places
        for start in range(0, len(seeds), size)
    ]


def played(chunks: Sequence[EpisodeChunk], processes: int) -> Iterator[tuple[EpisodeChunk, Sequence[EpisodeRecord]]]:
    """Plays chunks in several processes, and yields each chunk with its episodes, in order.

    Raises:
      MjrunError: error of the first episode that fails in the order of the chunks, whichever fails first in time.
      LostEpisodesError: the process ended during that episode.
    """
    players = _PlayerProcesses()
    pool = ThreadPoolExecutor(processes, thread_name_prefix="episodes")
    try:
        yield from zip(chunks, pool.map(players.play, chunks), strict=True)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        players.end()
        pool.shutdown()  # waits for threads, which return when their process has ended
        players.close()


class _PlayerProcesses:
    """Processes that play episodes, one for each thread that calls `play`."""

    def __init__(self) -> None:
        self._local, self._workers, self._is_over = threading.local(), list[Worker](), threading.Event()

    def play(self, chunk: EpisodeChunk) -> Sequence[EpisodeRecord]:
        """Plays a chunk in the process of this thread.

        Raises:
          MjrunError: an episode failed.
          LostEpisodesError: the process ended; names the first episode that ends it.
        """
        if not hasattr(self._local, "worker"):
            self._start()
        try:
            return self._local.worker.ask("play", chunk)
        except WorkerEndedError as error:
            if not self._is_over.is_set():
                self._start()
                if len(chunk.seeds) > 1:
                    for seed in chunk.seeds:
                        self.play(replace(chunk, seeds=[seed]))
            raise LostEpisodesError(chunk.seeds, str(error)) from None

    def end(self) -> None:
        """Ends all processes, also those that are only being started."""
        self._is_over.set()
        for worker in list(self._workers):
            worker.process.end()

    def close(self) -> None:
        """Closes the connections to all processes, once no thread uses them."""
        for worker in self._workers:
            worker.close()

    def _start(self) -> None:
        self._local.worker = Worker("mjrun.evaluation.execution:EpisodeServer")
        self._workers.append(self._local.worker)
        if self._is_over.is_set():
            self._local.worker.process.end()


class EpisodeServer:
    """Server of a process that plays episodes."""

    def __init__(self) -> None:
        warnings.simplefilter("ignore")  # the parent process reports them
        self._group = -1
        self._player: EpisodePlayer | None = None

    def play(self, chunk: EpisodeChunk) -> Sequence[EpisodeRecord]:
        """Plays a chunk; raises the error of an episode that fails."""
        if self._player is None or self._group != chunk.group:
            import_from(chunk.spec.chosen.modules)
            self._group, self._player = chunk.group, player_of(chunk.spec)
        return self._player.play(chunk.seeds)
