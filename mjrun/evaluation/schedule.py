"""All episodes of an evaluation, cut into chunks and played on all cores."""

from collections.abc import Sequence

from mjrun.evaluation.episode import Episode
from mjrun.evaluation.player import player_of
from mjrun.evaluation.prepared import EpisodeGroup
from mjrun.evaluation.processes import Chunk, played
from mjrun.evaluation.table import PlayedEpisodes
from mjrun.options.kinds import AUTO
from mjrun.platform.cores import available_cores
from mjrun.reporter import Reporter

CHUNKS = 4  # for each process, so that all end at about the same time
MOST = 64  # episodes in a chunk


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


def _chunks(groups: Sequence[EpisodeGroup], places: Sequence[int], seeds: Sequence[int], processes: int) -> list[Chunk]:
    size = max(1, min(MOST, -(-len(places) * len(seeds) // (CHUNKS * processes))))
    return [
        Chunk(place, groups[place].spec, seeds[start : start + size])
        for place in places
        for start in range(0, len(seeds), size)
    ]
