"""Any number of processes gives the same episodes and the same error."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import ControllerError, InvalidActionError, LostEpisodesError, MjrunError
from mjrun.evaluation import execution, player
from mjrun.evaluation.episode import EpisodeRecord, EpisodeSpec, PolicyChoice
from mjrun.evaluation.execution import EpisodeChunk, play_all, played
from mjrun.evaluation.player import player_of
from mjrun.evaluation.prepared import EpisodeGroup
from mjrun.reporter import WarningReporter
from tests.evaluation.tasks import cart_task, write_policies


class Progress(WarningReporter):
    def __init__(self) -> None:
        self.reported = list[tuple[int, int]]()

    def progress(self, what: str, done: int, total: int) -> None:
        assert what == "episodes"
        self.reported.append((done, total))


def groups(folder: Path, policy: object, *others: object) -> list[EpisodeGroup]:
    specs = [EpisodeSpec(cart_task(folder), PolicyChoice(each)) for each in (policy, *others)]
    return [EpisodeGroup(place, f"p{place}", 0, spec) for place, spec in enumerate(specs)]


@pytest.mark.slow
def test_episodes_are_the_same_whatever_the_number_of_processes_and_worlds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_policies(tmp_path)
    some = groups(tmp_path, f"{path}:act", "random")
    expected = [player_of(group.spec).play(range(5, 16)) for group in some]
    progress = Progress()
    groups_played = play_all(some, range(5, 16), 2, progress)
    assert [list(each.episodes) for each in groups_played] == expected
    assert [each.policy for each in groups_played] == ["p0", "p1"]
    assert progress.reported[-1] == (22, 22)
    assert progress.reported == sorted(progress.reported)
    monkeypatch.setattr(player, "SIDE_BY_SIDE", 2)
    assert [player_of(group.spec).play(range(5, 16)) for group in some] == expected


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "all_jobs", "message"),
    [
        ("Late", (1, 3), r"raised KeyError: 'seed 7, call 35'"),
        ("NotNumber", (2,), r"step 68, .*push = nan"),
        ("LateCrash", (2,), r"episode of seed 7 was killed by SIGABRT"),
    ],
)
def test_the_failure_told_is_that_of_the_first_episode_that_fails(
    tmp_path: Path, name: str, all_jobs: Sequence[int], message: str
) -> None:
    """Later episodes fail at earlier steps, and in other processes: neither changes the error."""
    endless = replace(cart_task(tmp_path), terminations={})
    chosen = PolicyChoice(f"{write_policies(tmp_path)}:{name}")
    some = [EpisodeGroup(0, name, 0, EpisodeSpec(endless, chosen))]
    messages: set[tuple[str, ...]] = set()
    for jobs in all_jobs:
        with pytest.raises(MjrunError, match=message) as caught:
            play_all(some, range(5, 18), jobs, WarningReporter())
        messages.add((str(caught.value), *getattr(caught.value, "__notes__", ())))
    assert len(messages) == 1
    assert name == "LateCrash" or "in the episode of seed 7" in next(iter(messages))


@pytest.mark.parametrize(
    ("name", "error", "match"),
    [
        ("Broken", InvalidActionError, r"push = nan[\s\S]*seed 5"),
        ("raising", ControllerError, "nothing here"),
        ("Crashing", LostEpisodesError, "the episode of seed 5 was killed by SIGABRT.*"),
    ],
)
@pytest.mark.slow
def test_what_an_episode_raises_is_raised_here(tmp_path: Path, name: str, error: type[MjrunError], match: str) -> None:
    with pytest.raises(error, match=match):
        list(played([EpisodeChunk(0, groups(tmp_path, f"{write_policies(tmp_path)}:{name}")[0].spec, [5, 6])], 1))


@pytest.mark.usefixtures("half_a_core")
def test_processes_are_as_many_as_the_quota_of_a_container_feeds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    counts: list[int] = []

    def record(chunks: Sequence[EpisodeChunk], count: int) -> Iterator[tuple[EpisodeChunk, Sequence[EpisodeRecord]]]:
        counts.append(count)
        return played(chunks, count)

    monkeypatch.setattr(execution, "played", record)
    play_all(groups(tmp_path, "zero"), range(4), "auto", WarningReporter())
    assert counts == [1]


def test_a_policy_that_is_no_text_plays_in_this_process(tmp_path: Path) -> None:
    def act(observation: np.ndarray) -> np.ndarray:  # nobody else could find it
        return np.array([-2.0 * observation[0] - 1.2 * observation[1]])

    path = write_policies(tmp_path)
    own, other = play_all(groups(tmp_path, act, f"{path}:act"), range(4), 1, WarningReporter())
    assert own.episodes == other.episodes
