"""The choice of episodes, and their videos."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mjrun.errors import UsageError, spelled
from mjrun.evaluation.episode import PlayedEpisodes
from mjrun.evaluation.evaluation import NAMES, Evaluation, chosen_videos, remove_old_videos
from mjrun.formats.image_and_video_reader import read_video
from mjrun.outputs.video import Video
from mjrun.simulation.simulation import Simulation
from tests.evaluation.episodes import episodes, played, totals
from tests.evaluation.tasks import cart_task, write_policies
from tests.reporters import RecordingReporter
from tests.study.in_process import simulate_here


def chosen(returns: list[float], count: int | str) -> list[tuple[str, float]]:
    groups = [played(*returns)]
    return [(video.rank, totals(groups)[video.episode]) for video in chosen_videos(groups, count)]


def test_three_are_the_worst_the_median_and_the_best() -> None:
    assert chosen([5, 1, 4, 2, 3], 3) == [("worst", 1), ("median", 3), ("best", 5)]


@pytest.mark.parametrize(
    ("count", "expected"),
    [
        (1, [("median", 3)]),
        (2, [("worst", 1), ("best", 5)]),
        (4, [("worst", 1), ("rank2", 2), ("median", 3), ("best", 5)]),
        (9, [("worst", 1), ("rank2", 2), ("median", 3), ("rank4", 4), ("best", 5)]),
    ],
)
def test_any_number_is_spaced_by_rank(count: int, expected: list[tuple[str, float]]) -> None:
    result = chosen([5, 1, 4, 2, 3], count)
    assert [value for _, value in result] == sorted(value for _, value in result)
    if count != 4:
        assert result == expected
    assert (result[0], result[-1]) == (expected[0], expected[-1])
    assert len(result) == min(count, 5)


def test_the_worst_are_those_with_the_lowest_returns() -> None:
    assert chosen([5, 1, 4, 2, 3], "worst:2") == [("worst", 1), ("rank2", 2)]
    assert chosen([5, 1, 4, 2, 3], "worst:3")[2] == ("median", 3)
    assert chosen([5, 1, 4, 2, 3], "worst:9") == chosen([5, 1, 4, 2, 3], 5)


def test_of_an_even_number_the_median_is_the_lower_in_the_middle() -> None:
    assert chosen([4, 3, 2, 1], 3)[1] == ("median", 2)


@pytest.mark.parametrize("count", [1, 3])
def test_a_lone_episode_is_recorded_once(count: int) -> None:
    assert len(chosen([7], count)) == 1


def test_equal_returns_are_ranked_by_their_seeds_and_what_is_no_number_is_the_worst() -> None:
    groups = [played(1, 1, 1)]
    assert [video.episode for video in chosen_videos(groups, 3)] == [0, 1, 2]
    assert chosen_videos([played(1, float("nan"), 0)], 2)[0].episode == 1


def test_failures_are_all_episodes_that_end_in_one() -> None:
    first, second = (episodes(20, np.random.default_rng(point), seed=5) for point in range(2))
    second[3] = replace(second[3], status="failed", outcome="failure")
    groups = [PlayedEpisodes("p", 0, first), PlayedEpisodes("p", 1, second)]
    choices = chosen_videos(groups, "failures")
    expected = [
        f"failure_point{group.point}_seed{each.seed}.mp4"
        for group in groups
        for each in group.episodes
        if (each.outcome, each.status) == ("failure", "ok")
    ]
    assert 2 < len(expected) < 40
    assert [choice.name(groups, varies=True) for choice in choices] == expected
    assert all(map(NAMES.fullmatch, expected))
    assert not chosen_videos([played(1, 2)], "failures")


def test_names_tell_rank_point_and_seed_and_are_known_as_videos() -> None:
    groups = [played(3, 4, seed=10), played(1, 2, point=1, seed=10)]
    worst, best = chosen_videos(groups, 2)
    assert worst.name(groups, varies=True) == "worst_point1_seed10.mp4"
    assert best.name(groups, varies=False) == "best_seed11.mp4"
    for video in (worst, best):
        assert NAMES.fullmatch(video.name(groups, varies=True))


SMALL = {"size": (64, 48), "fps": 20, "quality": "draft"}


@pytest.mark.gl
def test_a_recorded_episode_is_the_video_of_that_episode(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    simulate_here(monkeypatch)
    task, policy = cart_task(tmp_path, duration=0.3), f"{write_policies(tmp_path)}:act"
    out = tmp_path / "out"
    some = Evaluation(task, str(out), policy=policy, episodes=3, videos=2, jobs=1, **SMALL)  # type: ignore[arg-type]
    result = some.run()
    assert [video.rank for video in result.videos] == ["worst", "best"]
    assert result.videos[0].returned == result.policies[0].returns.min
    for video in result.videos:
        assert video.path in result.files
        path = str(tmp_path / "own.mp4")
        Video(Simulation(task, policy=policy, seed=video.seed), path, **SMALL).run()  # type: ignore[arg-type]
        ours, own = (np.stack(list(read_video(each))) for each in (video.path, path))
        assert len(ours) == 6
        assert np.array_equal(ours, own)


@pytest.mark.gl
@pytest.mark.parametrize(
    ("options", "match"),
    [({"camera": "front"}, "front"), ({"size": (9, 16)}, "16x16"), ({"size": (64, 1_000_000)}, "too large")],
)
def test_videos_that_cannot_be_made_are_refused_before_anything_is_played(
    tmp_path: Path, options: dict[str, Any], match: str
) -> None:
    some = Evaluation(cart_task(tmp_path), str(tmp_path / "out"), policy="zero", videos=1, **options)
    with pytest.raises(UsageError, match=match):
        some.run()
    assert not (tmp_path / "out").exists()


@pytest.mark.gl
def test_removed_videos_of_an_earlier_run_are_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    simulate_here(monkeypatch)
    task, out = cart_task(tmp_path, duration=0.1), tmp_path / "out"

    def texts(videos: int | str) -> list[str]:
        reporter = RecordingReporter()
        some = Evaluation(task, str(out), policy="random", episodes=3, videos=videos, jobs=1, **SMALL)  # type: ignore[arg-type]
        some.run(reporter)
        return [text for text in reporter.texts if "removed" in text]

    assert texts(3) == texts("worst:3") == []
    removed = {path.name for path in out.glob("*.mp4")} - {path.name for path in out.glob("worst_*.mp4")}
    (text,) = texts("worst:1")
    assert text.startswith(f"{out}: removed 2 videos of an earlier run: {', '.join(sorted(removed))};")


@pytest.mark.gl
def test_an_evaluation_without_failures_reports_that_none_is_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulate_here(monkeypatch)
    task, reporter = cart_task(tmp_path, duration=0.1), RecordingReporter()
    some = Evaluation(task, str(tmp_path / "out"), policy="zero", episodes=1, videos="failures", jobs=1, **SMALL)  # type: ignore[arg-type]
    assert not some.run(reporter).videos
    assert [spelled(text) for text in reporter.texts] == ["videos failures: no episode ended in a failure"]


def test_videos_of_an_earlier_evaluation_go_and_other_files_stay(tmp_path: Path) -> None:
    for name in ("worst_seed1.mp4", "rank3_point2_seed7.mp4", "best_seed2.mp4", "mine.mp4", "worst_seed1.mp4.txt"):
        (tmp_path / name).touch()
    assert remove_old_videos(tmp_path, ["best_seed2.mp4"]) == ["rank3_point2_seed7.mp4", "worst_seed1.mp4"]
    assert {path.name for path in tmp_path.iterdir()} == {"best_seed2.mp4", "mine.mp4", "worst_seed1.mp4.txt"}
