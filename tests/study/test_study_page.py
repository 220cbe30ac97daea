"""Pages about studies, against the table of the study."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from mjrun.errors import BadValueError, FailedPointsError
from mjrun.simulation.simulation import Simulation
from mjrun.study.study import Study
from tests.page_cells import PageCells


def test_the_page_shows_the_numbers_of_the_table_and_how_it_was_made(ball: Simulation, tmp_path: Path) -> None:
    folder, page = tmp_path / "study", tmp_path / "study.html"
    Study(
        ball,
        str(folder),
        vary={"qpos/ball/z": "0.2..1:5"},
        metric={"low": "min(qpos/ball/z)"},
        require="max(low) < 9",
        jobs=1,
        html=str(page),
        command="mjrun sweep <ball>",
    ).run()
    text = page.read_text("utf-8")
    cells = PageCells(text).texts
    low = pd.read_csv(folder / "results.csv")["low"]
    shown = PageCells(text).numbers_after("low [m]", 9)
    expected = [5, *np.quantile(low, (0, 0.05, 0.25, 0.5, 0.75, 0.95, 1)), low.mean()]
    np.testing.assert_allclose(shown, expected, rtol=1e-4)
    assert "0.2, 0.4, 0.6, 0.8, 1" in cells
    assert "<dt>Engine</dt><dd><code>MuJoCo</code></dd>" in text
    assert "max(low) &lt; 9" in text
    assert "mjrun sweep &lt;ball&gt;" in text.replace("<span>", "").replace("</span>", "")
    assert text.count("<svg") == 1
    assert not re.search(r"<script|https?://(?!www.w3.org)", text)


def test_failures_are_listed_with_their_reasons(ball: Simulation, tmp_path: Path) -> None:
    page = tmp_path / "study.html"
    varied = {"qvel/ball/vz": "0,-1e9"}
    with pytest.raises(FailedPointsError):
        Study(ball, str(tmp_path / "study"), vary=varied, metric={"low": "min(time)"}, jobs=1, html=str(page)).run()
    cells = PageCells(page.read_text("utf-8")).texts
    assert "unstable" in cells
    assert "1: qvel/ball/vz=-1e9" in cells


def test_a_study_without_numbers_to_draw_has_a_page_without_a_plot(ball: Simulation, tmp_path: Path) -> None:
    page = tmp_path / "study.html"
    Study(ball, str(tmp_path / "study"), vary={"opt.integrator": "euler,rk4"}, jobs=1, html=str(page)).run()
    text = page.read_text("utf-8")
    assert "no plot: " in text
    assert "<svg" not in text


def test_a_wrong_name_is_refused_before_anything_is_simulated(ball: Simulation, tmp_path: Path) -> None:
    with pytest.raises(BadValueError, match=r"a file that ends with .html"):
        Study(ball, str(tmp_path / "study"), vary={"seed": "1,2"}, html="page.txt").run()
    assert not (tmp_path / "study").exists()
