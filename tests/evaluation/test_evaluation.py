"""Evaluations in Python: the same table every time, and the folder after a failure."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pandas as pd
import pytest

import mjrun
from mjrun.document.json_schema import report_schema
from mjrun.errors import FailedAssertionError, FailedEpisodesError, FileError, MjrunWarning, TerminatedError
from mjrun.evaluation.evaluation import SCHEMA, Evaluation, EvaluationResult
from mjrun.evaluation.prepared import play_all
from mjrun.evaluation.summaries import FILES
from mjrun.formats.temporary_output import TemporaryOutput
from mjrun.options.sweep import PARTS
from mjrun.study import executors
from mjrun.study.isolation import PointChunk
from mjrun.study.spec import ChunkResult
from mjrun.task.task import Reward
from tests.document.schema_oracle import fits
from tests.evaluation.tasks import XML, cart_task, write_policies
from tests.policy.networks import linear
from tests.study.in_process import simulate_here


@pytest.fixture(autouse=True)
def _here(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if "processes" not in request.node.name:
        simulate_here(monkeypatch)


def evaluation(folder: Path, out: str = "out", name: str = "act", **options: object) -> Evaluation:
    task, policies = cart_task(folder), write_policies(folder)
    arguments = {"policy": f"{policies}:{name}", "episodes": 9, "seed": 3, "jobs": 1, **options}
    return Evaluation(task, str(folder / out), **arguments)  # type: ignore[arg-type]


@pytest.mark.slow
def test_the_table_is_the_same_bytes_whatever_the_number_of_processes(tmp_path: Path) -> None:
    varied = {"vary": {"geom/box.mass": "1,2"}, "compare": "random", "episodes": 4}
    evaluation(tmp_path, "a", **varied).run()
    evaluation(tmp_path, "b", **varied, jobs=2, command="mjrun eval --jobs 2").run()
    for name in (*FILES, "results.parquet", "results.csv"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_the_result_is_that_of_the_table(tmp_path: Path) -> None:
    result = evaluation(tmp_path).run()
    rows = pd.read_csv(tmp_path / "out" / FILES[1])
    (summary,) = result.policies
    assert summary.returns.mean == pytest.approx(rows["return"].mean())
    assert summary.success
    assert summary.success.count == (rows["outcome"] == "success").sum()
    assert result.steps == rows["steps"].sum()
    assert sorted(result.files) == sorted(str(path) for path in (tmp_path / "out").iterdir())  # of code, no results
    manifest = json.loads((tmp_path / "out" / "evaluation.json").read_text())
    assert manifest["policies"][0]["returns"]["mean"] == summary.returns.mean
    assert manifest["mjrun"] == mjrun.__version__


def test_more_episodes_begin_with_those_of_fewer(tmp_path: Path) -> None:
    evaluation(tmp_path, "few", episodes=4).run()
    evaluation(tmp_path, "more", episodes=7).run()
    few, more = (pd.read_csv(tmp_path / name / FILES[1]) for name in ("few", "more"))
    pd.testing.assert_frame_equal(few, more.head(4))


def test_a_second_evaluation_replaces_the_first_and_nothing_else(tmp_path: Path) -> None:
    evaluation(tmp_path).run()
    (tmp_path / "out" / "notes.txt").write_text("mine")
    evaluation(tmp_path, episodes=2).run()
    assert len(pd.read_csv(tmp_path / "out" / FILES[1])) == 2
    assert (tmp_path / "out" / "notes.txt").read_text() == "mine"


def test_an_interrupted_evaluation_continues_to_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    varied: dict[str, Any] = {"policy": "random", "compare": "zero", "vary": {"geom/box.mass": "1,2"}}
    options = {**varied, "episodes": 5, "chunk": 2, "command": "mjrun eval"}
    whole = evaluation(tmp_path, "whole", **options).run()
    run_chunk, left = executors.run_chunk, [2]

    def interrupted(chunk: PointChunk) -> ChunkResult:
        left[0] -= 1
        if left[0] < 0:
            raise TerminatedError(15)
        return run_chunk(chunk)

    with monkeypatch.context() as patch:
        patch.setattr(executors, "run_chunk", interrupted)
        with pytest.raises(TerminatedError):
            evaluation(tmp_path, "cut", **options).run()
    assert {path.name for path in (tmp_path / "cut").iterdir()} == {"evaluation.json", PARTS}
    result = evaluation(tmp_path, "cut", **options).run()
    assert 0 < result.simulated < len(pd.read_csv(tmp_path / "cut" / FILES[1]))
    for path in (tmp_path / "whole").glob("[er]*.[pc]*"):
        assert (tmp_path / "cut" / path.name).read_bytes() == path.read_bytes()
    assert (result.policies, result.points) == (whole.policies, whole.points)


def test_an_error_of_an_output_states_where_finished_episodes_are_kept(tmp_path: Path) -> None:
    options: dict[str, Any] = {"policy": "random", "episodes": 2}
    (tmp_path / "out" / FILES[0]).mkdir(parents=True)
    (tmp_path / "out" / "evaluation.json").write_text("{}")
    with pytest.raises(FileError) as caught:
        evaluation(tmp_path, **options).run()
    where = f"finished episodes are kept in {tmp_path / 'out' / PARTS}; repeat the command to continue"
    assert caught.value.__notes__ == [where]
    (tmp_path / "out" / FILES[0]).rmdir()
    assert evaluation(tmp_path, **options).run().simulated == 0


def test_where_all_episodes_fail_no_table_is_written(tmp_path: Path) -> None:
    with pytest.raises(FailedEpisodesError, match="9 of 9 episodes failed; there is no table") as caught:
        evaluation(tmp_path, name="wide").run()
    assert caught.value.exit_code == 2  # of each of them
    assert not (tmp_path / "out").exists()
    with pytest.raises(FailedEpisodesError, match=r'policies\.py", line \d+, in raising\n') as caught:
        evaluation(tmp_path, name="raising").run()
    assert str(caught.value).count("Traceback") == 1  # of the first of nine
    assert "--policy" not in str(caught.value)
    evaluation(tmp_path).run()
    before = {path: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    with pytest.raises(FailedEpisodesError):
        evaluation(tmp_path, name="wide").run()
    after = {path: path.read_bytes() for path in (tmp_path / "out").iterdir() if path.is_file()}
    assert after == before


def test_an_evaluation_that_ends_at_its_limit_is_continued_to_the_same_bytes(tmp_path: Path) -> None:
    options = {"name": "NotNumber", "require": ["return > -100"]}
    with pytest.raises(FailedEpisodesError):
        evaluation(tmp_path, "whole", **options).run()  # type: ignore[arg-type]
    with pytest.raises(FailedEpisodesError, match="9 of 9 episodes are not simulated yet; there is no table"):
        evaluation(tmp_path, time_budget="1us", **options).run()  # type: ignore[arg-type]
    with pytest.raises(FailedEpisodesError, match="episodes are not simulated yet; the table has the others") as caught:
        evaluation(tmp_path, max_failures=1, chunk=1, **options).run()  # type: ignore[arg-type]
    (result,) = caught.value.results
    assert (caught.value.exit_code, result.assertions) == (8, [])
    assert 0 < result.simulated < 9
    summary = result.policies[0]
    assert (summary.episodes + summary.failed, summary.missing) == (result.simulated, 9 - result.simulated)
    with pytest.raises(FailedEpisodesError, match="of 9 episodes failed; the table has the others") as caught:
        evaluation(tmp_path, **options).run()  # type: ignore[arg-type]
    assert [verdict.passed for verdict in caught.value.results[0].assertions] == [True]
    for name in FILES:
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


def test_the_table_has_failed_episodes_with_their_reasons_and_no_number_includes_them(tmp_path: Path) -> None:
    """Of the episodes of seeds 3 to 11, those that still run after 5 + 3·(seed − 7) periods fail from seed 7 on."""
    with pytest.raises(FailedEpisodesError, match="of 18 episodes failed; the table has the others") as caught:
        evaluation(tmp_path, name="NotNumber", compare="zero", require=["return > -100"], html=None).run()
    assert caught.value.exit_code == 8
    (result,) = caught.value.results
    rows = pd.read_csv(tmp_path / "out" / FILES[1]).to_dict("records")
    own, other = rows[:9], {row["seed"]: row["return"] for row in rows[9:]}
    failed, completed = ([row for row in own if (row["status"] == "ok") == ok] for ok in (False, True))
    assert 0 < len(failed) < 6
    for row in failed:
        assert row["status"] == "failed"
        assert "push = nan" in row["message"]
        assert all(pd.isna(row[name]) for name in ("return", "length", "ending", "outcome", "reward/near"))
    returns = np.array([row["return"] for row in completed])
    assert result.policies[0].failed == len(failed)
    assert result.policies[0].returns.mean == pytest.approx(returns.mean())
    assert result.policies[0].success.of == result.comparison.pairs == len(completed)
    differences = returns - [other[row["seed"]] for row in completed]
    assert result.comparison.returns.difference == pytest.approx(differences.mean())
    assert sum(each.count for each in result.failures) == len(failed)
    assert result.assertions[0].passed


def test_what_does_not_hold_is_raised_with_what_was_found(tmp_path: Path) -> None:
    with pytest.raises(FailedAssertionError, match="return >= 5") as caught:
        evaluation(tmp_path, fail_below={"return": 5}, require=["steps > 0"]).run()
    (result,) = caught.value.results
    assert [verdict.passed for verdict in result.assertions] == [True, False]
    assert (tmp_path / "out" / FILES[0]).is_file()


@pytest.mark.parametrize(
    ("out", "match"),
    [
        (".", "contains other files, but no evaluation"),
        ("cart.xml", "is not a folder"),
        ("cart.xml/a", "is not a folder"),
    ],
)
def test_what_is_no_folder_of_an_evaluation_is_left_alone(tmp_path: Path, out: str, match: str) -> None:
    some = evaluation(tmp_path, out)
    before = {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    with pytest.raises(FileError, match=match):
        some.run()
    assert {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()} == before


def test_an_evaluation_begins_beside_another_one_that_writes_its_manifest(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    other = TemporaryOutput(tmp_path / "out/evaluation.json")
    assert evaluation(tmp_path, episodes=2).run().episodes == 2
    other.remove()


def test_returns_that_are_not_finite_are_reported(tmp_path: Path) -> None:
    task = replace(cart_task(tmp_path), rewards={"bad": Reward(value="log(-1 - abs(qpos/slider))")})
    with pytest.warns(
        MjrunWarning, match=r"^zero: 2 of 2 returns not finite, because of bad; the summaries exclude them"
    ):
        result = Evaluation(task, str(tmp_path / "out"), policy="zero", episodes=2, jobs=1).run()
    assert result.policies[0].returns.count == 0


@pytest.mark.slow
def test_edits_while_episodes_are_played_by_processes_change_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for folder in ("quiet", "edited"):
        (tmp_path / folder).mkdir()
    evaluation(tmp_path / "quiet").run()

    def edited_and_played(*arguments: Any) -> Any:
        (tmp_path / "edited" / "cart.xml").write_text(XML.replace('gear="5"', 'gear="-5"'))
        (tmp_path / "edited" / "policies.py").write_text("def act(observation):\n    return -observation[:1]\n")
        return play_all(*arguments)

    monkeypatch.setattr("mjrun.evaluation.evaluation.play_all", edited_and_played)
    evaluation(tmp_path / "edited", jobs=2).run()
    tables = [tmp_path / folder / "out" / FILES[1] for folder in ("quiet", "edited")]
    assert tables[0].read_bytes() == tables[1].read_bytes()


def test_a_policy_is_read_with_its_weights_before_the_first_episode(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The weights of the ONNX file are in a separate file."""
    network = onnx.load(linear(tmp_path / "p.onnx", np.array([[-2.0, -1.2]], np.float32)))
    onnx.save(network, tmp_path / "p.onnx", save_as_external_data=True, location="p.weights", size_threshold=0)
    options: dict[str, Any] = {"policy": str(tmp_path / "p.onnx"), "jobs": 1}
    evaluation(tmp_path, "quiet", **options).run()

    def edited_and_played(*arguments: Any) -> Any:
        (tmp_path / "p.weights").write_bytes(np.zeros(2, np.float32).tobytes())
        return play_all(*arguments)

    monkeypatch.setattr("mjrun.evaluation.evaluation.play_all", edited_and_played)
    evaluation(tmp_path, "edited_in_processes", **options).run()
    tables = [tmp_path / folder / FILES[1] for folder in ("quiet", "edited_in_processes")]
    assert tables[0].read_bytes() == tables[1].read_bytes()
    shown = (tmp_path / "edited_in_processes" / "evaluation.json").read_text()
    assert str(tmp_path / "p.onnx") in shown
    assert "/files/" not in shown


def test_functions_with_a_memory_that_episodes_share_are_reported(tmp_path: Path) -> None:
    compared = evaluation(tmp_path, compare=f"{write_policies(tmp_path)}:counting", episodes=1)
    with pytest.warns(MjrunWarning, match=r"policy .*:counting acts differently .* depend on the order of episodes"):
        compared.run()


def test_networks_with_random_numbers_are_reported(tmp_path: Path) -> None:
    path = linear(tmp_path / "noisy.onnx", np.array([[-2.0, -1.2]], np.float32))
    network = onnx.load(path)
    network.graph.node[1].CopyFrom(onnx.helper.make_node("RandomNormalLike", ["product"], ["actions"]))
    onnx.save(network, path)
    with pytest.warns(MjrunWarning, match=r"noisy.onnx acts differently .*; export the network without random numbers"):
        evaluation(tmp_path, policy=str(path), episodes=1).run()


@pytest.mark.parametrize(
    "options", [{}, {"compare": "random", "vary": {"control_dt": "0.02,0.04"}, "fail_below": {"length": 0}}]
)
def test_a_report_is_what_its_schema_says(
    tmp_path: Path, options: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    simulate_here(monkeypatch)
    task, schema = cart_task(tmp_path, duration=0.2), report_schema("eval", "mjrun eval", EvaluationResult)
    result = Evaluation(task, str(tmp_path / "out"), policy="zero", episodes=2, jobs=1, **options).run()  # type: ignore[arg-type]
    report = json.loads(json.dumps(asdict(result)))
    assert report["schema"] == SCHEMA
    assert fits(report, schema, schema)
    for key in report:
        assert not fits({name: value for name, value in report.items() if name != key}, schema, schema)
