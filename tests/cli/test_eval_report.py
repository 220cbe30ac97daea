"""What is said of an evaluation."""

from types import SimpleNamespace
from typing import cast

import numpy as np

from mjrun.cli.eval_report import evaluation_report
from mjrun.evaluation.comparison import compared
from mjrun.evaluation.result import EvaluationResult, Film, PointSummary
from mjrun.evaluation.summary import summary_of
from tests.evaluation.episodes import episodes, played

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
        "films": [],
        "assertions": [],
        "steps": 1234,
        "wall": 2.0,
    }
    return cast("EvaluationResult", SimpleNamespace(**{**usual, **facts}))


def test_every_number_stands_with_its_interval() -> None:
    text = evaluation_report(result())
    assert OWN.returns.mean is not None
    assert f"{OWN.returns.mean:.5g}" in text
    assert f"{OWN.returns.mean_interval.low:.5g}..{OWN.returns.mean_interval.high:.5g}" in text
    for name in ("return", "length [s]", "reward/near", "reward/cost", "effort", "arrived", "fallen", "90 %"):
        assert name in text
    assert OWN.success
    assert f"{OWN.success.count} of 30 episodes (90 %" in text
    assert "out: 30 episodes, seeds 7 to 36, 1,234 control periods; 2.0 s" in text
    assert "policy" not in text


def test_a_comparison_names_the_better_one_or_nobody() -> None:
    ours, theirs = [played(3, 4, 5.1, policy="a")], [played(0, 1, 2, policy="b")]
    clear = compared(ours, theirs, 0.9, can_succeed=False)
    assert "a is better: a - b is +3" in evaluation_report(result(comparison=clear))
    equal = compared(ours, ours, 0.9, can_succeed=True)
    text = evaluation_report(result(comparison=equal))
    assert text.count("no difference can be told") == 2
    assert "neither in 3" in text


def test_points_films_and_requirements_have_their_lines() -> None:
    point = PointSummary(0, {"mass": "2.5"}, [OWN], None)
    film = Film("worst", "out/worst_seed9.mp4", 9, None, -1.5, "fallen")
    text = evaluation_report(result(points=[point], names=["mass"], films=[film]))
    assert "2.5" in text
    assert "out/worst_seed9.mp4: return -1.5, fallen" in text
    assert "at 1 points" in text


def test_names_cannot_steer_the_terminal() -> None:
    hostile = summary_of("\x1b[31m.onnx", SOME, [], [], 0.9, can_succeed=False)
    film = Film("best", "\x1b[2J.mp4", 9, None, 1.0, "\x1b")
    assert "\x1b" not in evaluation_report(result(policies=[hostile, OWN], films=[film], path="\x1b"))
