"""What a figure shows of tables, before and after their rows."""

import tracemalloc

import numpy as np
import pytest

from mjrun.errors import BadValueError, MjrunError, UnknownNameError, UsageError, option
from mjrun.options.plot import FigureOptions
from mjrun.plotting.figure_data import DrawnFigure
from mjrun.plotting.figure_plan import EVENTS, PANELS, FigurePlan, TableColumns

UNITS = {"time": "s", "qpos/a": "rad", "qpos/b": "rad", "contact/ncon": ""}
TABLE = TableColumns("run", UNITS)


def rows(count: int = 10) -> dict[str, np.ndarray]:
    time = np.arange(count) / 10
    return {"time": time, "qpos/a": time**2, "qpos/b": 1 - time, "contact/ncon": np.arange(count) % 4.0}


def drawn(options: FigureOptions, values: dict[str, np.ndarray]) -> tuple[DrawnFigure, list[str]]:
    plan = FigurePlan(options, [TableColumns("run", {name: UNITS.get(name, "") for name in values})])
    collector = plan.collector(0)
    half = len(values["time"]) // 2 if "time" in values else 1
    collector.feed({name: column[:half] for name, column in values.items()})
    collector.feed({name: column[half:] for name, column in values.items()})
    return plan.drawing([collector]), [*plan.notes, *collector.notes()]


def test_all_columns_over_time_by_default() -> None:
    drawing, notes = drawn(FigureOptions(), rows())
    assert [panel.label for panel in drawing.panels] == ["qpos [rad]", "contact/ncon"]
    assert drawing.x_label == "time [s]"
    assert np.array_equal(drawing.panels[0].curves[1].points.y, rows()["qpos/b"])
    assert notes == []


def test_expressions_are_of_the_rows_with_their_first_value() -> None:
    drawing, _ = drawn(FigureOptions(y=["gone [mm]=(qpos/b - first(qpos/b))*1000"], x="qpos/a"), rows())
    (panel,) = drawing.panels
    assert (panel.label, drawing.x_label) == ("gone [mm]", "qpos/a [rad]")
    assert np.allclose(panel.curves[0].points.y, -1000 * rows()["time"])
    assert np.array_equal(panel.curves[0].points.x, rows()["qpos/a"])


def test_without_a_time_the_rows_are_counted_and_that_is_reported() -> None:
    drawing, notes = drawn(FigureOptions(), {"a": np.arange(5.0), "b": np.ones(5)})
    assert drawing.x_label == "row"
    assert drawing.panels[0].curves[0].points.x.tolist() == [0, 1, 2, 3, 4]
    assert "no column is called time" in notes[0]


@pytest.mark.parametrize("name", ["point", "seed"])
def test_rows_that_are_results_of_simulations_are_dots_and_no_line_joins_them(name: str) -> None:
    values = {name: np.arange(6.0), "a": np.array([1.0, 1, 2, 2, 1, 3]), "b": np.arange(6.0) ** 2}
    for x in ("a", name):
        drawing, _ = drawn(FigureOptions(x=x, y="b"), values)
        points = drawing.panels[0].curves[0].points
        shown = np.isfinite(points.y)
        assert not (shown[1:] & shown[:-1]).any()
        assert sorted(zip(points.x[shown], points.y[shown], strict=True)) == sorted(
            zip(values[x], values["b"], strict=True)
        )

    drawing, _ = drawn(FigureOptions(x="a", y="b"), {**values, "time": np.arange(6.0)})
    assert np.isfinite(drawing.panels[0].curves[0].points.y).all()


def test_events_are_marked_where_a_condition_begins_to_hold() -> None:
    drawing, notes = drawn(FigureOptions(mark_event=["hit=contact/ncon > 1", "qpos/a > 99"]), rows())
    assert [(mark.label, mark.value) for mark in drawing.marks] == [("hit", 0.2), ("hit", 0.6)]
    assert notes == ["qpos/a > 99 never happens"]


def test_texts_and_ranges_are_those_that_were_chosen() -> None:
    texts = FigureOptions(title="A fall", xlabel="t", legend_title="joint", ylabel=["2:count"])
    ranges = FigureOptions(xlim=(0.1, 0.5), ylim=["-1..1", "2:0..9"])
    drawing, _ = drawn(texts, rows())
    assert (drawing.title, drawing.x_label, drawing.legend_title) == ("A fall", "t", "joint")
    assert [panel.axis_label for panel in drawing.panels] == ["", "count"]

    drawing, _ = drawn(ranges, rows())
    assert drawing.x_limits == (0.1, 0.5)
    assert [panel.limits for panel in drawing.panels] == [(-1, 1), (0, 9)]
    assert (drawing.title, drawing.legend_title) == ("", "")


def test_columns_of_one_table_are_named_without_it_and_have_their_colours() -> None:
    drawing, _ = drawn(FigureOptions(), rows())
    names = [[(c.name, c.colour, c.variant) for c in panel.curves] for panel in drawing.panels]
    assert names == [[("a", 0, 0), ("b", 1, 0)], [("contact/ncon", 0, 0)]]


def test_horizontal_marks_are_in_their_panel_or_all_and_vertical_marks_in_the_figure() -> None:
    drawing, _ = drawn(FigureOptions(mark=["limit=0.5", "2:two=2", "x:impact=0.3"]), rows())
    horizontal = [[(mark.label, mark.value) for mark in panel.marks] for panel in drawing.panels]
    assert horizontal == [[("limit", 0.5)], [("limit", 0.5), ("two", 2)]]
    assert [(mark.label, mark.value) for mark in drawing.marks] == [("impact", 0.3)]


def test_events_beyond_a_bound_are_counted() -> None:
    values = rows(10 * EVENTS)
    drawing, notes = drawn(FigureOptions(mark_event=["contact/ncon > 1"]), values)
    assert len(drawing.marks) == EVENTS
    assert notes == [f"contact/ncon > 1: the first {EVENTS} of {10 * EVENTS // 4} are marked"]


def test_what_a_logarithmic_axis_cannot_show_is_counted() -> None:
    drawing, notes = drawn(FigureOptions(y=["contact/ncon", "qpos/b"], log=["1:y"]), rows())
    assert [panel.log for panel in drawing.panels] == [True, False]
    assert np.isnan(drawing.panels[0].curves[0].points.y).sum() == 2  # the gap at the beginning needs no point
    assert notes == ["contact/ncon: 3 values at or below zero are not on a logarithmic axis"]
    _, notes = drawn(FigureOptions(y=["qpos/b"], log=["x"]), rows())
    assert notes == ["1 row with x at or below zero is left out"]


def test_rows_without_x_are_left_out_and_infinite_values_are_gaps() -> None:
    values = rows()
    values["time"][3] = np.nan
    values["qpos/a"][5] = np.inf
    drawing, notes = drawn(FigureOptions(y=["qpos/a"]), values)
    assert notes == ["1 row without x is left out"]
    points = drawing.panels[0].curves[0].points
    assert len(points.x) == 9
    assert np.isnan(points.y).tolist() == [False] * 4 + [True] + [False] * 4


def test_a_column_without_values_is_reported() -> None:
    values = {**rows(), "qpos/b": np.full(10, np.nan)}
    assert drawn(FigureOptions(), values)[1] == ["qpos/b: no values to draw"]


def test_a_column_without_a_name_is_drawn_if_chosen() -> None:  # the numbers of rows, or an empty last column
    values = {"": np.arange(10.0), **rows()}
    drawing, notes = drawn(FigureOptions(), values)
    assert [panel.label for panel in drawing.panels] == ["qpos [rad]", "contact/ncon"]
    assert notes == [f"a column without a name is left out; choose with {option('y')}"]
    assert len(drawn(FigureOptions(y=["''"]), values)[0].panels) == 1


def test_tables_have_their_colours_and_a_panel_for_each_column() -> None:
    plan = FigurePlan(FigureOptions(), [TableColumns(name, UNITS) for name in "12"])
    collectors = [plan.collector(0), plan.collector(1)]
    for collector in collectors:
        collector.feed(rows())
    drawing = plan.drawing(collectors)
    assert [panel.label for panel in drawing.panels] == ["qpos/a [rad]", "qpos/b [rad]", "contact/ncon"]
    assert [(c.name, c.colour, c.variant) for c in drawing.panels[0].curves] == [("1", 0, 0), ("2", 1, 0)]


def test_columns_of_tables_in_one_panel_differ_in_their_lines() -> None:
    plan = FigurePlan(FigureOptions(y=["qpos"]), [TableColumns(name, UNITS) for name in "12"])
    collectors = [plan.collector(0), plan.collector(1)]
    for collector in collectors:
        collector.feed(rows())
    names = [(c.name, c.colour, c.variant) for c in plan.drawing(collectors).panels[0].curves]
    assert names == [("1 a", 0, 0), ("2 a", 1, 0), ("1 b", 0, 1), ("2 b", 1, 1)]


def test_a_column_that_one_table_lacks_is_drawn_of_the_others() -> None:
    plan = FigurePlan(FigureOptions(), [TABLE, TableColumns("other", {"time": "s", "qpos/a": "rad"})])
    collectors = [plan.collector(0), plan.collector(1)]
    collectors[0].feed(rows())
    collectors[1].feed({name: rows()[name] for name in ("time", "qpos/a")})
    assert [len(panel.curves) for panel in plan.drawing(collectors).panels] == [2, 1, 1]


def test_a_chosen_curve_that_one_table_lacks_is_reported() -> None:
    tables = [TABLE, TableColumns("other", {"time": "s", "qpos/a": "rad"})]
    plan = FigurePlan(FigureOptions(y=["qpos/a", "qpos/b", "contact/ncon * 2"]), tables)
    assert [plan.collector(i).notes() for i in (0, 1)] == [[], ["other: the table lacks qpos/b, contact/ncon * 2"]]


def test_memory_does_not_grow_with_the_rows() -> None:
    def peak(blocks: int) -> int:
        collector = FigurePlan(FigureOptions(y=["qpos/a * 2", "qpos/b"], mark_event=["qpos/a > 1"]), [TABLE]).collector(
            0
        )
        values = rows(20_000)
        tracemalloc.start()
        for block in range(blocks):
            collector.feed({**values, "time": values["time"] + 2000 * block})
        collector.points()
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    assert peak(50) < 1.3 * peak(5)  # 10⁶ rows against 10⁵


def test_panels_beyond_a_bound_are_left_out_and_named() -> None:
    names = [f"g{i}/a" for i in range(PANELS + 2)]
    plan = FigurePlan(FigureOptions(), [TableColumns("run", {"time": "s", **dict.fromkeys(names, "m")})])
    assert len(plan.panels) == PANELS
    assert plan.notes == [f"2 columns are left out, g{PANELS}/a, g{PANELS + 1}/a; choose with \x02y\x03"]


def test_only_what_is_shown_is_read() -> None:
    plan = FigurePlan(FigureOptions(y=["qpos/a"], mark_event=["contact/ncon > 0"]), [TABLE])
    assert plan.columns == ["qpos/a", "time", "contact/ncon"]


@pytest.mark.parametrize(
    ("options", "kind", "message"),
    [
        ({"y": ["qpos/c"]}, UnknownNameError, "did you mean"),
        ({"x": "qpos/*"}, BadValueError, "one column, it is 2"),
        ({"x": "tim"}, UnknownNameError, "did you mean 'time'"),
        ({"mark": ["9:a=1"]}, UsageError, "panel 9 does not exist; the last is 2"),
        ({"mark_event": ["contact(a, b)"]}, UnknownNameError, "contact/a/b"),
        ({"size": (100, 100)}, BadValueError, "size: '100x100' is not at least"),
        ({"log": ["1"]}, BadValueError, "log"),
    ],
)
def test_what_cannot_be_is_refused_before_the_first_row(options: dict[str, object], kind: type, message: str) -> None:
    with pytest.raises(kind, match=message):
        FigurePlan(FigureOptions(**options), [TABLE])  # type: ignore[arg-type]


def test_tables_with_different_times_and_tables_of_time_alone_are_refused() -> None:
    with pytest.raises(MjrunError, match="different time columns: 't', 'time'"):
        FigurePlan(FigureOptions(), [TABLE, TableColumns("other", {"t": "s", "a": ""})])
    with pytest.raises(UsageError, match="nothing to plot"):
        FigurePlan(FigureOptions(), [TableColumns("run", {"time": "s"})])
