"""The table of a study reads back in pandas, with numbers where there are numbers."""

import math
from pathlib import Path

import pandas as pd

from mjrun.study.design import Design
from mjrun.study.results import BLOCK, result_columns, write_results
from mjrun.study.simulate import PointResult

DESIGN = Design(("opt.timestep", "integrator"), [("1e-3", "rk4"), ("0.1", "euler"), ("2", "rk4")])
RESULTS = [
    PointResult(0, "ok", (1 / 3,), 9),
    PointResult(1, "unstable", (math.nan,), 2, 4, "so,\nit"),
    PointResult(2, "ok", (-1.0,), 9),
]


def test_a_long_table_is_whole(tmp_path: Path) -> None:
    count = 2 * BLOCK + 3
    design = Design(("seed",), [(str(k),) for k in range(count)])
    columns, rows = result_columns(design, ["half"], [PointResult(k, "ok", (k / 2,), 9) for k in range(count)])
    for file in write_results(tmp_path, columns, rows, {}):
        table = pd.read_parquet(file) if file.suffix == ".parquet" else pd.read_csv(file)
        assert table["half"].tolist() == [k / 2 for k in range(count)]


def test_the_table_holds_points_metrics_and_how_each_ended(tmp_path: Path) -> None:
    columns, rows = result_columns(DESIGN, ["drift"], RESULTS)
    files = write_results(tmp_path, columns, rows, {})
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


def test_the_same_results_are_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_results(tmp_path / name, *result_columns(DESIGN, ["drift"], RESULTS), {})
    for name in ("results.parquet", "results.csv"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
