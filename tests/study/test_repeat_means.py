"""Means over repeats, against pandas and scipy."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import scipy
from markdown_it import MarkdownIt

from mjrun.cli.sweep_report import study_markdown, study_report
from mjrun.experiment.design import Design
from mjrun.formats.study_reader import read_study
from mjrun.options.plot import FigureOptions
from mjrun.plotting.study.figure_data import SensitivityPanel
from mjrun.plotting.study.plan import StudyFigurePlan
from mjrun.simulation.simulation import Simulation
from mjrun.study.results import REPEAT_FILES, SUMMARIZED, RepeatMeans
from mjrun.study.study import Study
from tests.page_cells import PageCells


def test_each_row_has_mean_and_students_interval_of_points_that_differ_in_their_seed_only(
    ball: Simulation, tmp_path: Path
) -> None:
    folder, page = tmp_path / "study", tmp_path / "study.html"
    base = replace(ball, steps=30, perturb=0.1)
    options = {"metric": {"low [mm]": "1000*min(qpos/ball/z)"}, "confidence": 0.9, "jobs": 1}
    vary = {"qpos/ball/z": "0.2,0.3", "opt.integrator": "euler,rk4"}
    study = Study(base, str(folder), vary=vary, repeats=3, html=str(page), **options)  # type: ignore[arg-type]
    result = study.run()

    points, rows = pd.read_csv(folder / "results.csv"), pd.read_parquet(folder / "repeats.parquet")
    keys = zip(points["qpos/ball/z"], points["opt.integrator"], strict=True)
    groups = dict[tuple[float, str], list[float]]()
    for key, low in zip(keys, points["low"], strict=True):
        groups.setdefault(key, []).append(low)
    repeats = np.array(list(groups.values()))
    assert rows["qpos/ball/z"].tolist() == [0.2, 0.2, 0.3, 0.3]
    assert rows["opt.integrator"].tolist() == ["euler", "rk4"] * 2
    assert rows["repeats"].tolist() == rows["low/count"].tolist() == [3] * 4
    np.testing.assert_allclose(rows["low/mean"], repeats.mean(axis=1), rtol=1e-12)
    np.testing.assert_allclose(rows["low/std"], repeats.std(axis=1, ddof=1), rtol=1e-9)
    low, high = scipy.stats.t.interval(0.9, 2, repeats.mean(axis=1), scipy.stats.sem(repeats, axis=1))
    np.testing.assert_allclose(rows["low/low"], low, rtol=1e-9)
    np.testing.assert_allclose(rows["low/high"], high, rtol=1e-9)

    first = f"{repeats[0].mean():.5g}"
    report = study_report(result, base)
    assert "90 %" in report
    assert first in report
    cells = PageCells(MarkdownIt("commonmark").enable("table").render(study_markdown(result, base))).texts
    assert {"low [mm]", "90 %", first} <= {*cells}
    assert {"low [mm]", "90 % interval", first} <= {*PageCells(page.read_text("utf-8")).texts}

    replace(study, repeats=1, html=None, confidence=0.95).run()
    assert not any((folder / name).exists() for name in REPEAT_FILES)


@pytest.mark.parametrize(
    ("sampler", "expected", "tolerance"),
    [
        ("morris", {"mu_star": (2, 6), "sigma": (0, 0)}, 1e-9),
        ("saltelli", {"first": (0.1, 0.9), "total": (0.1, 0.9)}, 0.1),
    ],
)
def test_a_linear_metric_has_known_sensitivities(
    ball: Simulation, tmp_path: Path, sampler: str, expected: dict[str, tuple[float, float]], tolerance: float
) -> None:
    vary = {"qvel/ball/vx": "uniform(-1,1)", "qvel/ball/vy": "uniform(-1,1)"}
    metric = {"v": "first(qvel/ball/vx) + 3*first(qvel/ball/vy)"}
    study = Study(
        replace(ball, steps=1), str(tmp_path / "s"), vary=vary, metric=metric, sampler=sampler, samples=64, jobs=1
    )
    result = study.run()
    rows = pd.read_csv(tmp_path / "s" / "sensitivity.csv")
    assert rows["parameter"].tolist() == list(vary)
    (panel,) = StudyFigurePlan(read_study(tmp_path / "s"), FigureOptions()).drawing.panels
    assert isinstance(panel, SensitivityPanel)
    assert panel.parameters == ["qvel/ball/vy", "qvel/ball/vx"]  # the strongest first
    shown = [each.tolist() for each in (panel.correlations, panel.dependences)]
    assert shown == [rows[name][::-1].tolist() for name in expected]
    for name, values in expected.items():
        np.testing.assert_allclose(rows[name], values, atol=tolerance)
        for report in (study_report(result, study.simulation), study_markdown(result, study.simulation)):
            assert f"{result.sensitivities[1].indices[name].value or 0:.5g}" in report


def test_values_that_are_not_finite_are_left_out() -> None:
    design = Design(("mass", "seed"), [(f"{k // 3}", f"{k % 3}") for k in range(6)])
    values = [1.0, np.nan, 3.0, np.nan, np.nan, 5.0]
    made, alone = RepeatMeans(design, {"v": values}, 0.95).summaries()
    assert (made.points, made.values, made.metrics["v"].count, made.metrics["v"].mean) == (3, {"mass": "0"}, 2, 2.0)
    only = alone.metrics["v"]
    assert (only.count, only.mean, only.std, only.interval.low) == (1, 5.0, None, None)


@pytest.mark.parametrize(
    ("names", "points"),
    [(("mass",), [("1",), ("2",)]), (("mass", "seed"), [("1", "0"), ("2", "1")])],
)
def test_points_without_repeats_have_no_means(names: tuple[str, ...], points: list[tuple[str, ...]]) -> None:
    made = RepeatMeans(Design(names, points), {"v": [1.0, 2.0]}, 0.95)
    assert not made.design.points
    assert not made.summaries()


def test_a_report_has_a_limited_number_of_rows_and_the_table_all() -> None:
    count = 2 * SUMMARIZED
    design = Design(("mass", "seed"), [(f"{k // 2}", f"{k % 2}") for k in range(2 * count)])
    made = RepeatMeans(design, {"v": np.arange(2 * count).tolist()}, 0.95)
    assert len(made.summaries()) == SUMMARIZED
    assert made.table().numbers["v/mean"].tolist() == (np.arange(count) * 2 + 0.5).tolist()
