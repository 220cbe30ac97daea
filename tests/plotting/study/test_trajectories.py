"""Trajectories are the traces that a study has kept, as they are read by anybody else."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from mjrun.errors import UnknownNameError, UsageError
from mjrun.formats.study_reader import StudyResults, TextColumn
from mjrun.options.plot import FigureOptions
from mjrun.plotting.study import plan as study_plan
from mjrun.plotting.study.figure_data import DrawnStudyFigure, GraphPanel
from mjrun.plotting.study.plan import StudyFigurePlan

TIMES = np.arange(50) * 0.1


def results(folder: Path, count: int) -> StudyResults:
    """A study of some seeds, every other one with a trace."""
    for point in range(0, count, 2):
        home = folder / "points" / f"{point:06}"
        home.mkdir(parents=True)
        (home / "point.json").write_text(json.dumps({"values": {"seed": str(point)}}))
        trace = pd.DataFrame({"time": TIMES, "qpos/hip": np.sin(TIMES + point), "qpos/knee": TIMES, "ctrl/m": TIMES})
        trace.to_parquet(home / "trace.parquet")
    seeds, texts = np.arange(count, dtype=float), {"status": TextColumn.of(["ok"] * count)}
    return StudyResults(
        folder=str(folder),
        parameters=["seed"],
        metrics=["far"],
        numbers={"seed": seeds, "far": seeds**2},
        texts=texts,
        metric_columns=["qpos/knee", "xpos/hip/x"],
        with_files=frozenset(range(0, count, 2)),
    )


def drawing(study: StudyResults, **options: object) -> DrawnStudyFigure:
    return StudyFigurePlan(study, FigureOptions(**options)).drawing  # type: ignore[arg-type]


def test_what_the_metrics_read_is_shown_over_time(tmp_path: Path) -> None:
    panels = drawing(results(tmp_path, 6)).panels
    assert [panel.label for panel in panels] == ["far", "qpos/knee"]
    over_time = panels[1]
    assert isinstance(over_time, GraphPanel)
    assert over_time.x.name == "time [s]"
    assert [series.name for series in over_time.series] == ["seed 0", "seed 2", "seed 4"]
    assert len({series.colour for series in over_time.series}) == 3


def test_columns_and_metrics_are_chosen_alike(tmp_path: Path) -> None:
    study = results(tmp_path, 6)
    assert [panel.label for panel in drawing(study, y="qpos/*").panels] == ["qpos/hip", "qpos/knee"]
    assert [panel.label for panel in drawing(study, y=["ctrl/m", "far"]).panels] == ["far", "ctrl/m"]
    (hip,) = drawing(study, y="qpos/hip").panels
    assert isinstance(hip, GraphPanel)
    for point, series in zip((0, 2, 4), hip.series, strict=True):
        np.testing.assert_array_equal(series.x, TIMES)
        np.testing.assert_array_equal(series.y, np.sin(TIMES + point))
    with pytest.raises(UnknownNameError, match=r"no column 'qpos/hop'[\s\S]*columns: seed, far, qpos/hip") as caught:
        drawing(study, y="qpos/hop")
    assert caught.value.__notes__ == [f"mjrun sweep {tmp_path} --keep trace --probe NAME stores more columns over time"]
    (tmp_path / "episodes.csv").write_text("seed\n")  # as in the folder of an evaluation
    with pytest.raises(UnknownNameError) as caught:
        drawing(study, y="qpos/hop")
    assert [note.partition(";")[0] for note in caught.value.__notes__] == ["an evaluation keeps none over time"]


def test_expressions_over_time_are_drawn(tmp_path: Path) -> None:
    study = results(tmp_path, 6)
    (angle,) = drawing(study, y="angle [°]=(qpos/hip - qpos/knee)*180/pi").panels
    assert isinstance(angle, GraphPanel)
    assert angle.label == "angle [°]"
    for point, series in zip((0, 2, 4), angle.series, strict=True):
        np.testing.assert_allclose(series.y, np.degrees(np.sin(TIMES + point) - TIMES), rtol=1e-12)
    assert [panel.label for panel in drawing(study, y="far/2").panels] == ["far/2"]
    with pytest.raises(UsageError, match="'far/2 \\+ qpos/hip' reads both metrics and columns over time"):
        drawing(study, y="far/2 + qpos/hip")


def test_a_study_whose_metrics_read_no_column_of_the_traces_has_no_panels_over_time(tmp_path: Path) -> None:
    study = replace(results(tmp_path, 6), metric_columns=["xpos/hip/x"])
    assert [panel.label for panel in drawing(study).panels] == ["far"]
    bare = replace(study, metrics=[])
    assert [panel.label for panel in drawing(bare).panels] == ["qpos/hip", "qpos/knee", "ctrl/m"]


def test_curves_over_time_have_the_axes_and_marks_that_are_requested(tmp_path: Path) -> None:
    study = results(tmp_path, 6)
    axes = {"xlim": (1.0, 2.0), "ylim": ("2:1..10",), "log": ("2:y",), "xlabel": "t", "ylabel": ("1:angle",)}
    marks = {"mark": ("1:stop=5", "x:kick=1.5", "zero=0")}
    hip, knee = (panel for panel in drawing(study, y="qpos/*", **axes, **marks).panels if isinstance(panel, GraphPanel))
    for panel in (hip, knee):
        assert (panel.x.name, panel.x.low, panel.x.high, panel.x.log) == ("t", 1, 2, False)
    assert {mark.label for mark in hip.marks} == {"stop", "kick", "zero"}
    assert {mark.label for mark in knee.marks} == {"kick", "zero"}
    assert hip.y.high > 5
    assert (knee.y.low, knee.y.high, knee.y.log, hip.y.log) == (1, 10, True, False)
    assert (hip.axis_label, knee.axis_label) == ("angle", "")
    assert all(panel.x.log for panel in drawing(study, y="qpos/*", log="x").panels if isinstance(panel, GraphPanel))
    with pytest.raises(UsageError, match="x does not apply to columns over time"):
        drawing(study, y="qpos/hip", x="seed")


def test_beside_metrics_the_x_axis_of_the_metrics_has_the_options(tmp_path: Path) -> None:
    options = {"y": ["far", "qpos/hip"], "xlim": (1.0, 2.0), "mark": ("x:best=1.5", "2:stop=5")}
    far, hip = (panel for panel in drawing(results(tmp_path, 6), **options).panels if isinstance(panel, GraphPanel))
    assert (far.x.low, far.x.high, hip.x.low, hip.x.high) == (1, 2, TIMES[0], TIMES[-1])
    assert ([mark.label for mark in far.marks], [mark.label for mark in hip.marks]) == (["best"], ["stop"])


def test_rounding_errors_are_drawn_as_zero(tmp_path: Path) -> None:
    hip, noise = drawing(results(tmp_path, 6), y=["qpos/hip", "qpos/knee*1e-17"]).panels
    assert isinstance(hip, GraphPanel)
    assert isinstance(noise, GraphPanel)
    assert hip.y.high < 1.2
    assert noise.y.low < -0.9
    assert noise.y.high > 0.9


def test_many_lines_are_faint_and_have_no_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study_plan, "POINTS", 10)
    monkeypatch.setattr(study_plan, "ROWS", 20)
    plan = StudyFigurePlan(results(tmp_path, 30), FigureOptions(y="qpos/knee"))
    (knee,) = plan.drawing.panels
    assert isinstance(knee, GraphPanel)
    assert plan.notes == ["10 of 15 points with traces have a line, evenly chosen"]
    assert {(series.name, series.colour, series.opacity < 1) for series in knee.series} == {("", 0, True)}
    assert all(20 <= len(series.x) <= 40 and series.x[-1] == TIMES[-1] for series in knee.series)


def test_a_range_of_time_is_drawn_with_the_rows_that_it_has(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A long trace is thinned within the range, not over its whole length."""
    monkeypatch.setattr(study_plan, "ROWS", 10)
    (hip,) = drawing(results(tmp_path, 2), y="qpos/hip", xlim=(1.95, 2.55)).panels
    assert isinstance(hip, GraphPanel)
    (series,) = hip.series
    np.testing.assert_allclose(series.x, [0, *np.arange(19, 27) * 0.1, 4.9])
    np.testing.assert_allclose(series.y, np.sin(series.x))
