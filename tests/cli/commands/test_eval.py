"""`mjrun eval` as a user runs it."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np
import pandas as pd
import pytest

from mjrun.cli.commands.eval import evaluation_markdown, evaluation_report
from mjrun.evaluation.evaluation import EpisodeVideo, EvaluationResult
from mjrun.evaluation.summaries import PointSummary, compared, summary_of
from tests.cases import cases
from tests.evaluation.episodes import episodes, played
from tests.evaluation.tasks import XML, write_policies
from tests.study.in_process import simulate_here

if TYPE_CHECKING:
    from tests.conftest import Command

TASK = """
model: cart.xml
control_dt: 0.02
duration: 1
reset: {set: {qpos/slider: "uniform(-0.9, 0.9)"}, noise: {qvel/slider: "normal(0, 1)"}}
observations: [{name: x, joints: [slider]}, {name: v, joints: [slider], of: qvel}]
actions: [{actuators: [push]}]
rewards: {near: -abs(qpos/slider)}
terminations:
  home: {when: abs(qpos/slider) < 0.02 and abs(qvel/slider) < 0.1, as: success}
  lost: {when: abs(qpos/slider) > 1, as: failure}
"""
ACT = ("--policy", "policies.py:act", "--jobs", "1")


@pytest.fixture
def cart(mjrun_here: Command, monkeypatch: pytest.MonkeyPatch) -> str:
    simulate_here(monkeypatch)
    (mjrun_here.folder / "cart.xml").write_text(XML)
    (mjrun_here.folder / "cart.yaml").write_text(TASK)
    write_policies(mjrun_here.folder)
    return "cart.yaml"


def test_the_report_tells_returns_endings_and_success(mjrun_here: Command, cart: str) -> None:
    done = mjrun_here("eval", cart, *ACT, "--episodes", "12", "--seed", "5")
    assert (done.returncode, done.stderr) == (0, b"")
    text = done.stdout.decode()
    rows = pd.read_csv(mjrun_here.folder / "cart_eval" / "episodes.csv")
    assert rows["seed"].tolist() == list(range(5, 17))
    count = (rows["outcome"] == "success").sum()
    assert f"{count} of 12 episodes" in text
    assert "Wilson" in text
    assert "seeds 5 to 16" in text
    assert {path.name for path in (mjrun_here.folder / "cart_eval").iterdir()} == {
        *("episodes.csv", "episodes.parquet", "evaluation.json"),
    }


def test_json_and_csv_are_all_that_is_on_standard_output(mjrun_here: Command, cart: str) -> None:
    some = ("eval", cart, *ACT, "--episodes", "4", "-o", "out")
    result = json.loads(mjrun_here(*some, "--json").stdout)
    assert result["schema"] == "mjrun-eval-1"
    assert result["policies"][0]["episodes"] == 4
    assert result["policies"][0]["policy"] == "policies.py:act"

    printed = mjrun_here(*some, "--csv")
    assert printed.stdout == (mjrun_here.folder / "out" / "episodes.csv").read_bytes()
    assert b"number" in printed.stderr
    assert mjrun_here(*some, "--csv", "--json").returncode == 2


def test_values_of_the_document_and_of_the_model_are_changed(mjrun_here: Command, cart: str) -> None:
    long = json.loads(mjrun_here("eval", cart, "duration=0.2", *ACT, "--episodes", "3", "-o", "a", "--json").stdout)
    assert long["policies"][0]["lengths"]["max"] <= 0.2
    heavy = mjrun_here("eval", cart, *ACT, "--episodes", "3", "-o", "b", "--set", "geom/box.mass=1e6", "--json")
    assert json.loads(heavy.stdout)["policies"][0]["returns"] != long["policies"][0]["returns"]


def test_what_is_required_decides_the_exit_code_and_everything_is_written(mjrun_here: Command, cart: str) -> None:
    some = ("eval", cart, *ACT, "--episodes", "4", "-o", "out")
    assert mjrun_here(*some, "--fail-below", "success=0%", "--require", "share(lost) <= 1").returncode == 0
    failed = mjrun_here(*some, "--fail-below", "return=1000")
    assert failed.returncode == 1
    assert b"return >= 1000" in failed.stderr
    assert b"FAILS" in failed.stdout
    document = json.loads(mjrun_here(*some, "--fail-below", "return=1000", "--json").stdout)
    assert document["error"]["exit_code"] == 1
    assert not document["assertions"][0]["passed"]


def test_policies_are_compared_on_the_same_episodes(mjrun_here: Command, cart: str) -> None:
    done = mjrun_here("eval", cart, *ACT, "--compare", "policies.py:weak", "--episodes", "16", "-o", "out")
    rows = pd.read_csv(mjrun_here.folder / "out" / "episodes.csv")
    wide = rows.pivot(index="seed", columns="policy", values="return")
    difference = (wide["policies.py:act"] - wide["policies.py:weak"]).mean()
    assert f"policies.py:act - policies.py:weak is {difference:+.5g}" in done.stdout.decode()
    assert len(rows) == 32


def test_what_varies_makes_a_map_that_can_be_plotted(mjrun_here: Command, cart: str) -> None:
    varied = ("--vary", "geom/box.mass=1,4", "--vary", "observations[0].scale=1,2")
    done = mjrun_here("eval", cart, *ACT, *varied, "--episodes", "3", "-o", "out")
    assert done.returncode == 0, done.stderr
    points = pd.read_csv(mjrun_here.folder / "out" / "results.csv")
    rows = pd.read_csv(mjrun_here.folder / "out" / "episodes.csv")
    assert points["point"].tolist() == [0, 1, 2, 3]
    means = [rows["return"][rows["point"] == point].mean() for point in range(4)]
    assert points["return"].tolist() == pytest.approx(means)
    assert rows["observations[0].scale"].tolist() == [1] * 3 + [2] * 3 + [1] * 3 + [2] * 3
    assert len({*rows["return"]}) > 9  # some are lost at once
    plotted = mjrun_here("plot", "out", "-o", "map.png")
    assert plotted.returncode == 0, plotted.stderr


def test_policies_that_vary_are_a_learning_curve(mjrun_here: Command, cart: str) -> None:
    some = ("--vary", "policy=zero,policies.py:act", "--episodes", "3", "--jobs", "1", "-o", "out")
    result = json.loads(mjrun_here("eval", cart, *some, "--json").stdout)
    assert result["policies"][0]["policy"] == "2 policies"
    assert [point["policies"][0]["policy"] for point in result["points"]] == ["zero", "policies.py:act"]
    points = pd.read_csv(mjrun_here.folder / "out" / "results.csv")
    assert points["policy"].tolist() == ["zero", "policies.py:act"]


@cases("arguments, code, text")
def test_what_cannot_be_is_told_and_leaves_nothing(
    mjrun_here: Command, cart: str, arguments: list[str], code: int, text: str
) -> None:
    before = {path.name for path in mjrun_here.folder.iterdir()}
    done = mjrun_here("eval", *arguments)
    assert (done.returncode, done.stdout) == (code, b""), done.stderr
    assert text in done.stderr.decode()
    assert {path.name for path in mjrun_here.folder.iterdir()} - {"__pycache__"} == before


def test_episodes_that_fail_are_counted_with_their_reasons(mjrun_here: Command, cart: str) -> None:
    done = mjrun_here("eval", cart, "--policy", "policies.py:Broken", "--jobs", "1", "--json", "-o", "out")
    document = json.loads(done.stdout)
    rows = pd.read_csv(mjrun_here.folder / "out" / "episodes.csv")
    failed = rows["status"].tolist().count("failed")
    assert (done.returncode, document["error"]["exit_code"]) == (8, 8)
    assert 0 < failed < 100
    assert document["policies"][0]["failed"] == failed == 100 - document["policies"][0]["episodes"]
    again = mjrun_here("eval", cart, "--policy", "policies.py:Broken", "--jobs", "1", "-o", "out")
    assert again.returncode == 8
    assert f"failed, {failed}" in again.stdout.decode()
    assert "step 14" in again.stdout.decode()
    assert "100 of 100 episodes are known already" in again.stderr.decode()


SOME = episodes(30, np.random.default_rng(3))
OWN = summary_of("walk.onnx", SOME, ["near", "cost"], ["effort"], 0.9, can_succeed=True)


def result(**facts: object) -> EvaluationResult:
    usual = {
        "path": "out",
        "task": "t.yaml",
        "episodes": 30,
        "seed": 7,
        "confidence": 0.9,
        "policies": [OWN],
        "comparison": None,
        "names": [],
        "points": [],
        "units": {"effort": "N"},
        "videos": [],
        "assertions": [],
        "failures": [],
        "steps": 1234,
        "wall": 2.0,
    }
    return cast("EvaluationResult", SimpleNamespace(**{**usual, **facts}))


def test_every_number_stands_with_its_interval() -> None:
    text = evaluation_report(result())
    assert OWN.returns.mean is not None
    assert f"{OWN.returns.mean:.5g}" in text
    assert f"{OWN.returns.mean_interval.low:.5g}..{OWN.returns.mean_interval.high:.5g}" in text
    for name in ("return", "length [s]", "reward/near", "reward/cost", "effort [N]", "arrived", "fallen", "90 %"):
        assert name in text
    assert OWN.success
    assert f"{OWN.success.count} of 30 episodes (90 %" in text
    assert "out: 30 episodes, seeds 7 to 36, 1,234 control periods; 2.0 s" in text
    assert "policy" not in text


def test_returns_of_few_episodes_are_reported_with_caution_and_markdown_has_the_same_numbers() -> None:
    few = summary_of("walk.onnx", SOME[:10], ["near", "cost"], ["effort"], 0.9, can_succeed=True)
    for form in (evaluation_report, evaluation_markdown):
        assert "may be too narrow" not in form(result())
        text = " ".join(form(result(policies=[few])).split())
        assert "the 90 % interval of the mean may be too narrow: 35 % of samples of 10 episodes lack" in text
        assert f"{few.returns.iqm:.5g}" in text
        assert f"{few.returns.iqm_interval.low:.5g}..{few.returns.iqm_interval.high:.5g}" in text
    table = [line for line in evaluation_markdown(result()).splitlines() if line.startswith("|")]
    assert table[0].startswith("| number | mean | 90 % | iq mean | 90 % | median")
    assert len({line.replace("\\|", "").count("|") for line in table[:7]}) == 1


def test_a_comparison_names_the_better_one_or_nobody() -> None:
    ours, theirs = [played(3, 4, 5.1, policy="a")], [played(0, 1, 2, policy="b")]
    clear = compared(ours, theirs, 0.9, can_succeed=False)
    assert "a is better: a - b is +3" in evaluation_report(result(comparison=clear))
    equal = compared(ours, ours, 0.9, can_succeed=True)
    text = evaluation_report(result(comparison=equal))
    assert text.count("no significant difference") == 2
    assert "neither in 3" in text


def test_points_films_and_requirements_have_their_lines() -> None:
    point = PointSummary(0, {"mass": "2.5"}, [OWN], None)
    video = EpisodeVideo("worst", "out/worst_seed9.mp4", 9, None, -1.5, "fallen")
    text = evaluation_report(result(points=[point], names=["mass"], videos=[video]))
    assert "2.5" in text
    assert "out/worst_seed9.mp4: return -1.5, fallen" in text
    assert "at 1 points" in text


def test_parameters_of_points_have_few_digits() -> None:
    point = PointSummary(0, {"mass": "0.12345678901234567"}, [OWN], None)
    assert "0.12346 " in evaluation_report(result(points=[point], names=["mass"]))


def test_names_cannot_steer_the_terminal() -> None:
    hostile = summary_of("\x1b[31m.onnx", SOME, [], [], 0.9, can_succeed=False)
    video = EpisodeVideo("best", "\x1b[2J.mp4", 9, None, 1.0, "\x1b")
    assert "\x1b" not in evaluation_report(result(policies=[hostile, OWN], videos=[video], path="\x1b"))
