"""A figure of tables in a page, and what else is read of them on the way."""

import json
from contextlib import ExitStack
from pathlib import Path

import pytest

from mjrun.errors import FileError
from mjrun.options.plot import FigureOptions
from mjrun.plotting.table_figure import TableFigure, table_names
from mjrun.plotting.table_summary import TableSummary


def test_columns_that_nobody_asks_for_may_hold_anything(tmp_path: Path) -> None:
    file = tmp_path / "run.csv"
    file.write_text("time,a,b,name\n0,1,2,x\n1,3,4,y\n")
    with ExitStack() as stack:
        figure = TableFigure([str(file)], FigureOptions(y=["a"]), stack)
        summary = TableSummary(str(file), figure.units[str(file)], ["a"], ["max(b) == 4"])
        figure.read([summary])
        assert figure.rows == [2]
    assert [verdict.passed for verdict in summary.verdicts()] == [True]
    assert [column.name for column in summary.statistics()] == ["a", "b"]
    with ExitStack() as stack, pytest.raises(FileError, match="is not a number"):
        TableFigure([str(file)], FigureOptions(), stack).read()


def test_panels_stand_under_each_other_in_a_page(tmp_path: Path) -> None:
    file = tmp_path / "run.csv"
    file.write_text("time,a,b,c,d,e,f\n0,1,2,3,4,5,6\n1,3,4,5,6,7,8\n")
    with ExitStack() as stack:
        figure = TableFigure([str(file)], FigureOptions(y=list("abcdef")), stack)
        assert (figure.plan.grid.columns, figure.plan.page_grid().columns) == (2, 1)
        chosen = TableFigure([str(file)], FigureOptions(y=list("abcdef"), columns=3), stack)
        assert chosen.plan.page_grid().columns == 3


@pytest.mark.parametrize(("style", "follows"), [("light", True), ("dark", False), ("print", False)])
def test_a_figure_follows_its_page_unless_a_style_was_chosen(style: str, follows: bool, tmp_path: Path) -> None:
    file = tmp_path / "run.csv"
    file.write_text("time,a\n0,1\n1,3\n")
    with ExitStack() as stack:
        figure = TableFigure([str(file)], FigureOptions(style=style), stack)
        figure.read()
        assert ("var(--figure-ground)" in figure.for_page().svg) == follows


@pytest.mark.parametrize(
    ("paths", "names"),
    [
        (["kick_1.csv", "kick_2.csv"], ["1", "2"]),
        (["out/energy_0.01.csv", "out/energy_0.001.csv"], ["0.01", "0.001"]),
        (["a_slow_run.csv", "a_very_fast_run.csv"], ["slow", "very_fast"]),
        (["energy.csv", "energy_0.01.csv"], ["energy", "energy_0.01"]),
        (["old/run.csv", "new/run.csv"], ["old", "new"]),
        (["run.csv", "run.parquet"], ["run.csv", "run.parquet"]),
        (["ball.csv", "top.npz"], ["ball", "top"]),
        (["one.csv"], ["one"]),
        (["a.csv", "a.csv"], ["a.csv", "a.csv"]),
    ],
)
def test_names_are_short_and_tell_tables_apart(paths: list[str], names: list[str]) -> None:
    assert table_names(paths) == names


def test_files_of_points_are_called_by_the_values_in_which_they_differ(tmp_path: Path) -> None:
    paths = []
    for index, step in enumerate(["0.01", "0.02"]):
        folder = tmp_path / f"{index:06}"
        folder.mkdir()
        (folder / "point.json").write_text(json.dumps({"values": {"opt.timestep": step, "seed": "1"}}))
        paths.append(str(folder / "trace.parquet"))
    assert table_names(paths) == ["timestep 0.01", "timestep 0.02"]
    assert table_names([*paths, "other/trace.parquet"])[2] == "other"
