"""Tables of studies and evaluations are recognised, and compared by what identifies a point or an episode."""

import math
from pathlib import Path

import pytest

from mjrun.diff.file_kind import TABLE, VIDEO, kind_of
from mjrun.diff.result import TableDifference
from mjrun.diff.result_tables import ResultTable, is_results, result_manifest, table_path
from mjrun.diff.table_files import compare_tables
from mjrun.options.diff import TableDiffOptions
from mjrun.study.design import Design
from mjrun.study.results import result_columns, write_results
from mjrun.study.simulate import PointResult

EPISODE_NAMES = ["episode", "seed", "return", "length", "steps", "ending", "outcome"]

DESIGN = [("0.5", "rk4"), ("0.1", "euler"), ("2", "rk4")]
ENDS = [(1.5, "ok", ""), (math.nan, "unstable", "so,\nit"), (-1.0, "ok", "")]


def study(folder: Path, order: list[int], drift: float = 0.0) -> str:
    """The folder of a study whose points are in an order, and in whose metric there is a drift."""
    folder.mkdir()
    design = Design(("mass", "integrator"), [DESIGN[index] for index in order])
    results = [PointResult(i, ENDS[k][1], (ENDS[k][0] + drift,), 9, 0, ENDS[k][2]) for i, k in enumerate(order)]  # type: ignore[arg-type]
    columns, rows = result_columns(design, ["end"], results)
    write_results(folder, columns, rows, {"metrics": {"end": "last(x)"}})
    return str(folder)


def compare(a: str, b: str, **options: object) -> TableDifference:
    return compare_tables(a, b, TableDiffOptions(**options))[0]  # type: ignore[arg-type]


@pytest.mark.parametrize("form", ["", "/results.csv", "/results.parquet"])
def test_studies_are_compared_by_their_parameters_in_any_order(tmp_path: Path, form: str) -> None:
    a, b = study(tmp_path / "a", [0, 1, 2]), study(tmp_path / "b", [2, 0, 1])
    assert is_results(Path(a))
    assert kind_of(a) == TABLE
    table = compare(a + form, b)
    assert (table.aligned, table.rows, table.shared_agree) == ("mass, integrator", 3, True)
    assert sorted(column.name for column in table.columns) == ["end", "exit_code", "message", "status", "steps"]
    drifted = compare(a + form, study(tmp_path / "c", [1, 0], 0.25))
    (end, *others) = drifted.columns
    assert (end.name, end.differing, end.maximum) == ("end", 1, 0.25)
    assert end.first is not None
    assert (end.first.row, end.first.row_b, end.first.key) == (0, 1, "mass = 0.5, integrator = rk4")
    assert not any(column.differing for column in others)
    assert drifted.only_a.key == "mass = 2, integrator = rk4"
    assert compare(a + form, b, align="row").columns[0].differing


def test_without_a_manifest_points_belong_together_by_their_numbers(tmp_path: Path) -> None:
    a, b = study(tmp_path / "a", [0, 1, 2]), study(tmp_path / "b", [0, 1, 2])
    for folder in (a, b):
        Path(folder, "results.parquet").unlink()
    assert result_manifest(Path(a, "results.csv")) is None
    assert table_path(a) == f"{a}/results.csv"
    assert (compare(a, b).aligned, compare(a, b).shared_agree) == ("point", True)


def test_episodes_are_compared_by_policy_parameters_and_seed(tmp_path: Path) -> None:
    names = ["policy", "point", "friction", *EPISODE_NAMES]
    lines = [
        f"walk,{point},{point / 2},{seed},{seed},{seed}.5,1,9,timeout,timeout" for point in (0, 1) for seed in (3, 4)
    ]
    a, b = tmp_path / "episodes.csv", tmp_path / "b.csv"
    a.write_text("\n".join([",".join(names), *lines]) + "\n")
    other = [line.replace("walk,0,", "walk,7,").replace(",3.5,", ",3.25,") for line in reversed(lines)]
    b.write_text("\n".join([",".join(names), *other]) + "\n")
    assert kind_of(str(tmp_path)) == TABLE
    table = compare(str(tmp_path), str(b))
    assert (table.aligned, table.rows) == ("policy, friction, seed", 4)
    assert [column.name for column in table.columns if column.differing] == ["return"]
    assert table.columns[0].differing == 2
    assert not {"point", "episode"} & {column.name for column in table.columns}


def test_other_tables_and_folders_are_none_of_these(tmp_path: Path) -> None:
    assert ResultTable.of(["point", "x"]) is None
    assert ResultTable.of(["time", *EPISODE_NAMES[1:]]) is None
    assert not is_results(tmp_path)
    assert kind_of(str(tmp_path)) == VIDEO
    assert table_path(str(tmp_path)) == str(tmp_path)
    assert result_manifest(tmp_path / "table.csv") is None
