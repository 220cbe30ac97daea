"""Episodes are points: any processes give the same records, a failure costs its episode, and nothing is repeated."""

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mjrun.errors import UsageError
from mjrun.evaluation.episode import EpisodeRecord, player_of
from mjrun.evaluation.prepared import PreparedEpisodes, PreparedEvaluation, play_all
from mjrun.options.evaluation import EvaluationOptions
from mjrun.options.sweep import ExecutionOptions
from mjrun.reporter import PythonApiReporter
from mjrun.task.task import Task
from tests.evaluation.tasks import cart_task, write_policies
from tests.study.in_process import simulate_here
from tests.study.slurm_stand_in import install


class Progress(PythonApiReporter):
    def __init__(self) -> None:
        self.reported, self.notes = list[tuple[int, int]](), list[str]()

    def progress(self, what: str, done: int, total: int) -> None:
        assert what.startswith("episodes")
        self.reported.append((done, total))

    def note(self, text: str) -> None:
        self.notes.append(text)


def prepared(folder: Path, policy: object, task: Task | None = None, **options: object) -> PreparedEvaluation:
    task = task or cart_task(folder)
    return PreparedEvaluation(EvaluationOptions(task, "out", policy=policy, **options), task, None)  # type: ignore[arg-type]


def play(
    some: PreparedEvaluation, seeds: Sequence[int], out: Path, reporter: PythonApiReporter | None = None, **options: Any
) -> tuple[list[list[EpisodeRecord]], int]:
    """Returns the records of each group, and the number of episodes that were played."""
    groups, simulated = play_all(some, ExecutionOptions(**options), seeds, out, reporter or Progress())
    return [list(group.episodes) for group in groups], simulated


@pytest.mark.slow
def test_episodes_are_the_same_whatever_the_number_of_processes_and_worlds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    some = prepared(tmp_path, f"{write_policies(tmp_path)}:act", compare="random")
    expected = [player_of(group.spec).play(range(5, 16)) for group in some.groups]
    progress = Progress()
    assert play(some, range(5, 16), tmp_path / "out", progress, jobs=2, chunk=3) == (expected, 22)
    assert progress.reported[-1] == (22, 22)
    assert progress.reported == sorted(progress.reported)
    monkeypatch.setattr("mjrun.evaluation.episode.SIDE_BY_SIDE", 2)
    assert [player_of(group.spec).play(range(5, 16)) for group in some.groups] == expected


@pytest.mark.slow
def test_episodes_in_jobs_of_slurm_are_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(tmp_path / "cluster")
    monkeypatch.setenv("PATH", str(tmp_path / "cluster"), prepend=os.pathsep)
    some = prepared(tmp_path, f"{write_policies(tmp_path)}:act")
    expected = [player_of(group.spec).play(range(4)) for group in some.groups]
    options = {"engine": "slurm", "chunk": 2, "slurm": "time=10min,array=2"}
    assert play(some, range(4), tmp_path / "out", **options) == (expected, 4)
    assert (tmp_path / "cluster" / "log").read_text() == "sbatch 0-1%2\n"


@pytest.mark.slow
def test_a_crash_a_hang_an_exception_and_an_action_that_is_no_number_cost_their_episode(tmp_path: Path) -> None:
    endless = replace(cart_task(tmp_path, duration=0.3), terminations={})
    policies = write_policies(tmp_path)
    (mixed,), _ = play(
        prepared(tmp_path, f"{policies}:Mixed", endless), range(5, 13), tmp_path / "out", jobs=1, time_limit=1
    )
    (act,), _ = play(prepared(tmp_path, f"{policies}:act", endless), range(5, 13), tmp_path / "act", jobs=1)
    status = {each.seed: each.status for each in mixed if each.status != "ok"}
    assert status == {6: "failed", 8: "crashed", 9: "failed", 11: "timeout"}
    assert [each for each in mixed if each.status == "ok"] == [each for each in act if each.seed not in status]
    reasons = {each.seed: each.message for each in mixed}
    assert "push = nan" in reasons[6]
    assert "SIGABRT" in reasons[8]
    assert "KeyError: 'seed 9'" in reasons[9]


def test_known_episodes_are_not_played_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """More episodes, another point and another policy add what is missing; another task shares nothing."""
    simulate_here(monkeypatch)
    out = tmp_path / "out"
    alone, _ = play(prepared(tmp_path, "random"), range(5), tmp_path / "whole")
    assert play(prepared(tmp_path, "random"), range(2), out)[1] == 2
    reporter = Progress()
    assert play(prepared(tmp_path, "random"), range(5), out, reporter) == (alone, 3)
    assert reporter.notes == ["2 of 5 episodes are known already"]
    compared, simulated = play(prepared(tmp_path, "random", compare="zero"), range(5), out)
    assert (compared[0], simulated) == (alone[0], 5)
    varied = prepared(tmp_path, "random", vary={"geom/box.mass": "1,2"})
    assert play(varied, range(5), out)[1] == 10
    wider = prepared(tmp_path, "random", vary={"geom/box.mass": "3,2"})
    assert play(wider, range(5), out)[1] == 5  # of the new point
    longer = prepared(tmp_path, "random", cart_task(tmp_path, duration=0.5))
    assert play(longer, range(5), out)[1] == 5
    (tmp_path / "cart.xml").write_text((tmp_path / "cart.xml").read_text().replace('gear="5"', 'gear="4"'))
    assert play(PreparedEvaluation(wider_options(longer.task), longer.task, None), range(5), out)[1] == 5


def wider_options(task: object) -> EvaluationOptions:
    return EvaluationOptions(task, "out", policy="random")


def test_failed_episodes_are_known_until_they_are_to_be_retried(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulate_here(monkeypatch)
    some = prepared(tmp_path, f"{write_policies(tmp_path)}:NotNumber", replace(cart_task(tmp_path), terminations={}))
    first, _ = play(some, range(5, 9), tmp_path / "out")
    assert [each.status for each in first[0]] == ["ok", "ok", "failed", "failed"]
    again, simulated = play(some, range(5, 9), tmp_path / "out")
    assert (repr(again), simulated) == (repr(first), 0)
    assert play(some, range(5, 9), tmp_path / "out", retry_failed=True)[1] == 2


def test_a_policy_that_is_no_text_plays_in_this_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    simulate_here(monkeypatch)

    def act(observation: np.ndarray) -> np.ndarray:  # nobody else could find it
        return np.array([-2.0 * observation[0] - 1.2 * observation[1]])

    some = prepared(tmp_path, act, compare=f"{write_policies(tmp_path)}:act")
    (own, other), simulated = play(some, range(4), tmp_path / "out", jobs=1)
    assert (own, simulated) == (other, 8)
    assert play(some, range(4), tmp_path / "out", jobs=1)[1] == 4  # nothing identifies a function
    limits: dict[str, Any] = {"time_limit": 1, "time_budget": 1, "max_failures": 1}
    for name, limit in limits.items():
        with pytest.raises(UsageError, match=f"{name} requires a policy that other processes can load"):
            play(some, range(4), tmp_path / "out", **{name: limit})


def test_a_run_begins_with_chunks_of_one_episode_so_that_a_kill_loses_few(tmp_path: Path) -> None:
    some = prepared(tmp_path, "random")
    sizes = PreparedEpisodes(some, some.groups, range(99), tmp_path / "out").chunk_sizes(ExecutionOptions(), 6)
    assert sizes.next(np.zeros(99)) == 1


def test_results_have_the_numbers_of_their_records(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Records survive the files, to the last bit."""
    simulate_here(monkeypatch)
    some = prepared(tmp_path, "random", metric=(("never", "first(time, qpos/slider > 50)"), ("end", "last(time)")))
    expected = player_of(some.groups[0].spec).play(range(3))
    played, _ = play(some, range(3), tmp_path / "out")
    assert repr(played) == repr([expected])
    assert repr(PreparedEpisodes(some, some.groups, range(3), tmp_path / "out").taken_records()) == repr([expected])


def test_an_episode_that_one_of_two_equal_policies_has_played_is_known_of_both(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulate_here(monkeypatch)
    some = prepared(tmp_path, "random", compare="random")
    expected = player_of(some.groups[0].spec).play(range(2))
    episodes = PreparedEpisodes(some, some.groups, range(2), tmp_path / "out")
    episodes.files.create()
    episodes.simulate([0, 3], ExecutionOptions(), Progress())
    assert [each.status for each in episodes.known] == ["ok", "missing", "missing", "ok"]
    assert repr(episodes.taken_records()) == repr([expected, expected])
