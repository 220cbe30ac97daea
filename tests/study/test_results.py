"""The table of a study reads back in pandas; failures are reported by reason, immediately and at the end."""

import math
from pathlib import Path

import pandas as pd

from mjrun.experiment.design import Design
from mjrun.experiment.results_table import BLOCK
from mjrun.study.results import MOST_REASONS, FailureReporter, ResultColumns, point_failures, study_table
from mjrun.study.spec import PointResult, Status
from tests.reporters import RecordingReporter

DESIGN = Design(("opt.timestep", "integrator"), [("1e-3", "rk4"), ("0.1", "euler"), ("2", "rk4")])
RESULTS = [
    PointResult(0, "ok", (1 / 3,), 9),
    PointResult(1, "unstable", (math.nan,), 2, 4, "so,\nit"),
    PointResult(2, "ok", (-1.0,), 9),
]


def test_a_long_table_is_whole(tmp_path: Path) -> None:
    count = 2 * BLOCK + 3
    design = Design(("seed",), [(str(k),) for k in range(count)])
    made = study_table(design, ["half"], ResultColumns.of([PointResult(k, "ok", (k / 2,), 9) for k in range(count)], 1))
    for file in made.write(tmp_path, {}):
        table = pd.read_parquet(file) if file.suffix == ".parquet" else pd.read_csv(file)
        assert table["half"].tolist() == [k / 2 for k in range(count)]


def test_single_precision_is_a_column_of_its_own(tmp_path: Path) -> None:
    results = ResultColumns.of(RESULTS, 1)
    double, single = (study_table(DESIGN, ["drift"], results, is_single=each) for each in (False, True))
    for file in single.write(tmp_path, {}):
        table = pd.read_parquet(file) if file.suffix == ".parquet" else pd.read_csv(file)
        assert table["precision"].tolist() == ["single"] * 3
    assert "precision" not in [column.name for column in double.columns]


def test_the_table_holds_points_metrics_and_how_each_ended(tmp_path: Path) -> None:
    files = study_table(DESIGN, ["drift"], ResultColumns.of(RESULTS, 1)).write(tmp_path, {})
    assert [file.name for file in files] == ["results.parquet", "results.csv"]
    for table in (pd.read_parquet(files[0]), pd.read_csv(files[1])):
        assert table["point"].tolist() == [0, 1, 2]
        assert table["opt.timestep"].tolist() == [0.001, 0.1, 2]
        assert table["integrator"].tolist() == ["rk4", "euler", "rk4"]
        assert table["drift"].tolist()[::2] == [1 / 3, -1]
        assert math.isnan(table["drift"].tolist()[1])
        assert table["status"].tolist() == ["ok", "unstable", "ok"]
        assert table["exit_code"].tolist() == [0, 4, 0]
        assert table["message"].tolist()[1].startswith("so,")
        assert pd.isna(table["message"].tolist()[0])


POINTS = Design(("seed", "geom/a.size"), [(str(i), f"0.{i}") for i in range(30)])


def result(index: int, status: Status, message: str = "") -> PointResult:
    return PointResult(index, status, (math.nan,), 0, 1, message)


def test_the_first_failure_of_each_reason_is_reported() -> None:
    notes = RecordingReporter()
    failures = FailureReporter(POINTS, notes)
    failures.add([result(0, "ok"), result(4, "unstable", "unstable at step 3"), result(1, "failed", "no\nsuch")])
    failures.add([result(2, "unstable", "unstable at step 9"), result(3, "failed", "no\nother"), result(5, "crashed")])
    assert notes.texts == [
        "point 4 (seed=4, geom/a.size=0.4): unstable at step 3",
        "point 1 (seed=1, geom/a.size=0.1): no",
        "point 5 (seed=5, geom/a.size=0.5): ",
    ]
    assert (notes.warnings, notes.steps) == ([], [])


def test_reports_of_many_reasons_are_cut() -> None:
    notes = RecordingReporter()
    failures = FailureReporter(POINTS, notes)
    for index in range(30):
        failures.add([result(index, "failed", f"reason {index}")])
    assert len(notes.texts) == MOST_REASONS + 1
    assert notes.texts[0] == "point 0 (seed=0, geom/a.size=0.0): reason 0"
    assert notes.texts[-1] == "points fail for more reasons; the table contains all of them"


def test_failures_are_counted_by_reason_the_most_frequent_first() -> None:
    results = [result(i, "failed", "one") for i in range(2)] + [result(i, "unstable", f"at {i}") for i in range(2, 5)]
    outcome = point_failures(POINTS, ResultColumns.of(results, 1))
    assert [(each.status, each.message, each.count, each.point) for each in outcome] == [
        ("unstable", "at 2", 3, 2), ("failed", "one", 2, 0),
    ]  # fmt: skip
    assert outcome[0].values == {"seed": "2", "geom/a.size": "0.2"}
