"""All episodes of an evaluation, cut into chunks and played in processes, each with one core.

An episode is a function of its seed: which process plays it, and beside which others, changes no bit of it.
"""

import threading
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace

from mjrun.errors import LostEpisodesError, MjrunError
from mjrun.evaluation.episode import Episode, EpisodeSpec, PlayedEpisodes
from mjrun.evaluation.player import EpisodePlayer, player_of
from mjrun.evaluation.prepared import EpisodeGroup
from mjrun.options.number_kinds import AUTO
from mjrun.platform.cores import available_cores
from mjrun.python_code import import_from
from mjrun.reporter import Reporter
from mjrun.worker import Worker, WorkerEndedError

CHUNKS = 4  # for each process, so that all end at about the same time
MOST = 64  # episodes in a chunk


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


class EpisodeServer:
    """Plays episodes in a process of its own."""

    def __init__(self) -> None:
        warnings.simplefilter("ignore")  # the parent tells what there is to tell
        self._group = -1
        self._player: EpisodePlayer | None = None

    def play(self, chunk: Chunk) -> Sequence[Episode]:
        """Returns the episodes of a chunk; raises what one of them raises."""
        if self._player is None or self._group != chunk.group:
            import_from(chunk.spec.chosen.modules)
            self._group, self._player = chunk.group, player_of(chunk.spec)
        return self._player.play(chunk.seeds)


def play_all(
    groups: Sequence[EpisodeGroup], seeds: Sequence[int], jobs: int | str, reporter: Reporter
) -> list[PlayedEpisodes]:
    """Plays the episodes of `seeds` of each group, and returns them in that order.

    Args:
      jobs: how many processes play, or `auto`. Policies that are no text are played in this process: nobody else may
        be able to make them.

    Raises:
      MjrunError: what an episode raises.
    """
    episodes: list[dict[int, Episode]] = [{} for _ in groups]  # of each group, by their seeds
    total = len(groups) * len(seeds)

    def take(chunk: Chunk, results: Sequence[Episode]) -> None:
        episodes[chunk.group].update({episode.seed: episode for episode in results})
        reporter.progress("episodes", sum(map(len, episodes)), total)

    count = jobs if isinstance(jobs, int) else available_cores() if jobs == AUTO else 1
    shared = [place for place, group in enumerate(groups) if isinstance(group.spec.chosen.policy, str)]
    chunks = _chunks(groups, shared, seeds, count)
    if chunks:
        for chunk, results in played(chunks, min(count, len(chunks))):
            take(chunk, results)
    for place in sorted({*range(len(groups))} - {*shared}):
        player = player_of(groups[place].spec)
        for chunk in _chunks(groups, [place], seeds, 1):
            take(chunk, player.play(chunk.seeds))
    return [
        PlayedEpisodes(group.name, group.point, [episodes[place][seed] for seed in seeds])
        for place, group in enumerate(groups)
    ]


def played(chunks: Sequence[Chunk], processes: int) -> Iterator[tuple[Chunk, Sequence[Episode]]]:
    """The episodes of each chunk, in the order of its seeds; chunks in the order in which they end.

    Args:
      processes: how many play.

    Raises:
      MjrunError: that of the first episode that fails, in the order of the chunks, whichever fails first in time.
      LostEpisodesError: a process ended in the middle of that episode.
    """
    local, started, is_over = threading.local(), list[Worker](), threading.Event()

    def start() -> None:
        local.worker = Worker("mjrun.evaluation.schedule:EpisodeServer")
        started.append(local.worker)
        if is_over.is_set():
            local.worker.process.end()

    def play(chunk: Chunk) -> Sequence[Episode]:
        if not hasattr(local, "worker"):
            start()
        try:
            return local.worker.ask("play", chunk)
        except WorkerEndedError as error:
            if not is_over.is_set():
                start()
                if len(chunk.seeds) > 1:
                    for seed in chunk.seeds:  # one by one, to find the first that ends its process
                        play(replace(chunk, seeds=[seed]))
            raise LostEpisodesError(chunk.seeds, str(error)) from None

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
        for worker in list(started):
            worker.process.end()
        pool.shutdown()  # threads that have waited for a process go on when it ends
        for worker in started:
            worker.close()


def _chunks(groups: Sequence[EpisodeGroup], places: Sequence[int], seeds: Sequence[int], processes: int) -> list[Chunk]:
    size = max(1, min(MOST, -(-len(places) * len(seeds) // (CHUNKS * processes))))
    return [
        Chunk(place, groups[place].spec, seeds[start : start + size])
        for place in places
        for start in range(0, len(seeds), size)
    ]
