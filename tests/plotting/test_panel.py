"""Panels of figures, and the texts that describe them."""

from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import BadValueError, UnknownNameError, UsageError
from mjrun.model.table_column import split_unit
from mjrun.outputs.trace import columns
from mjrun.plotting.curve_syntax import (
    ReferenceLine,
    panel_index,
    parse_curves,
    parse_log,
    parse_panel,
    parse_reference_line,
)
from mjrun.plotting.figure_plan import CURVES, chosen_panels, panels_by_unit, time_column, with_units
from mjrun.simulation.simulation import Simulation
from tests.cases import cases

UNITS = {
    "qpos/root/x": "m",
    "qpos/root/y": "m",
    "qpos/root/qw": "",
    "qpos/knee": "rad",
    "qpos/hip": "rad",
    "energy/total": "J",
}


def shown(panels: list) -> list[tuple[str, list[str]]]:  # type: ignore[type-arg]
    return [(panel.label, [curve.name for curve in panel.curves]) for panel in panels]


def test_a_panel_for_each_group_and_each_unit() -> None:
    assert shown(panels_by_unit(list(UNITS), UNITS)) == [
        ("qpos/root [m]", ["x", "y"]),
        ("qpos/root/qw", ["qpos/root/qw"]),
        ("qpos [rad]", ["knee", "hip"]),
        ("energy/total [J]", ["energy/total"]),
    ]


def test_columns_may_end_with_spaces() -> None:
    names = ["time", "qpos/  ", "qvel/ "]
    curves = [curve.column for name in names[1:] for curve in parse_panel(name, names).curves]
    assert curves == names[1:]


def test_a_panel_for_each_column() -> None:
    panels = panels_by_unit(list(UNITS), UNITS, apart=True)
    assert [panel.label for panel in panels] == [f"{n} [{u}]" if u else n for n, u in UNITS.items()]


@pytest.mark.parametrize("count", [1, 12, 13, 25, 60, 61])
def test_many_columns_are_split_into_numbered_panels_and_none_is_lost(count: int) -> None:
    names = [f"qpos/joint_{i}" for i in range(count)]
    panels = panels_by_unit(names, dict.fromkeys(names, "rad"))
    assert [curve.text.name for panel in panels for curve in panel.curves] == names
    assert max(len(panel.curves) for panel in panels) <= CURVES
    assert len(panels) <= -(-count // CURVES) + 1
    assert len({panel.label for panel in panels}) == len(panels)


def test_components_of_an_object_stay_in_one_panel() -> None:
    names = [f"xpos/body_{i}/{axis}" for i in range(7) for axis in "xyz"]
    for panel in panels_by_unit(names, dict.fromkeys(names, "m")):
        assert len(panel.curves) % 3 == 0


def test_columns_without_groups_are_reported_apart_by_unit() -> None:
    units = {"a": "", "b": "", "force [N]": "N"}
    assert shown(panels_by_unit(list(units), units)) == [("", ["a", "b"]), ("force [N]", ["force [N]"])]


def test_a_chosen_panel_is_one_whatever_its_units() -> None:
    (panel,) = chosen_panels(["qpos"], UNITS)
    assert panel.label == "qpos"
    assert [c.name for c in panel.curves] == ["root/x [m]", "root/y [m]", "root/qw", "knee [rad]", "hip [rad]"]


@cases("text, label")
def test_a_chosen_panel_has_the_label_that_its_text_says(text: str, label: str) -> None:
    (panel,) = chosen_panels([text], UNITS)
    assert panel.label == label


@cases("names, time")
def test_the_time_is_found_by_its_name(names: list[str], time: str | None) -> None:
    assert time_column(names) == time


SCENES = Path(__file__).parents[2] / "scenes"


@pytest.mark.parametrize("scene", ["humanoid", "free_body", "pinata", "car"])
def test_no_unit_is_wrong(scene: str) -> None:
    known = {column.name: column.unit for column in columns(Simulation(SCENES / f"{scene}.xml"))}
    guessed = with_units(list(known), {})
    told = {name: unit for name, unit in guessed.items() if unit}
    assert told == {name: known[name] for name in told}
    assert {"time", "energy/total", "com/z"} <= set(told)


def test_a_table_s_own_units_come_first_and_brackets_second() -> None:
    names = ["time", "time [ms]", "energy/total", "force [N]", "Speed (m/s)", "f(x)", "a"]
    assert with_units(names, {"energy/total": "kJ"}) == {
        "time": "s",
        "time [ms]": "ms",
        "energy/total": "kJ",
        "force [N]": "N",
        "Speed (m/s)": "m/s",
        "f(x)": "",
        "a": "",
    }


def test_the_time_of_another_program_may_be_in_anything() -> None:
    assert with_units(["time", "force"], {}) == {"time": "", "force": ""}


COLUMNS = ["time", "qpos/knee", "qpos/hip/x", "qvel/knee", "a,b", "force [N]", "x=y", "joint:3"]
ROWS = {name: np.array([1.0, 2.0]) * (i + 1) for i, name in enumerate(COLUMNS)}


def curves(text: str) -> list[tuple[str, str | None, float]]:
    """Name, unit and first value of every curve of a panel."""
    found = parse_panel(text, COLUMNS).curves
    return [(c.name, c.unit, float(c.expression.values(ROWS)[0])) for c in found]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("qpos/knee", [("qpos/knee", None, 2)]),
        ("qpos/*", [("qpos/knee", None, 2), ("qpos/hip/x", None, 3)]),
        ("qpos", [("qpos/knee", None, 2), ("qpos/hip/x", None, 3)]),
        ("*knee", [("qpos/knee", None, 2), ("qvel/knee", None, 4)]),
        ("qpos/knee, qvel/knee", [("qpos/knee", None, 2), ("qvel/knee", None, 4)]),
        ("a,b", [("a,b", None, 5)]),
        ('"a,b"', [("a,b", None, 5)]),
        ('"x=y", time', [("x=y", None, 7), ("time", None, 1)]),
        ("'a,b' * 2, time", [("'a,b' * 2", None, 10), ("time", None, 1)]),
        ("max(qpos/knee, qvel/knee)", [("max(qpos/knee, qvel/knee)", None, 4)]),
        ("qpos/knee*qvel/knee", [("qpos/knee*qvel/knee", None, 8)]),
        ("qpos/knee * 2", [("qpos/knee * 2", None, 4)]),
        ("force [N]", [("force [N]", None, 6)]),
        ("knee [°]=qpos/knee*180/pi", [("knee", "°", 360 / np.pi)]),
        ("angle=qpos/knee", [("angle", None, 2)]),
        ("pure []=qpos/knee", [("pure", "", 2)]),
        ("x=y", [("x=y", None, 7)]),
        ("joint:3", [("joint:3", None, 8)]),
        ("both: joint:3, time", [("joint:3", None, 8), ("time", None, 1)]),
    ],
)
def test_a_panel_has_the_curves_that_its_text_names(text: str, expected: list[object]) -> None:
    assert curves(text) == expected


def test_a_wildcard_leaves_out_the_column_of_the_x_axis_unless_that_is_all_it_names() -> None:
    def names(text: str) -> list[str]:
        return [curve.name for curve in parse_panel(text, ["time", "a", "b"], "time").curves]

    assert names("*") == ["a", "b"]
    assert names("t*") == names("time") == ["time"]


def test_a_panel_may_have_a_title_and_a_unit() -> None:
    panel = parse_panel("contact force [N]: qpos/knee, up=qvel/knee", COLUMNS)
    assert (panel.title, panel.unit, [c.name for c in panel.curves]) == ("contact force", "N", ["qpos/knee", "up"])


@pytest.mark.parametrize(
    ("text", "kind", "message"),
    [
        ("qpoz/*", UnknownNameError, "no column 'qpoz/\\*' in y .did you mean 'qpos/"),
        ("qpos/kne", UnknownNameError, "did you mean 'qpos/knee'"),
        ("both=qpos/*", UsageError, "'qpos/\\*' matches 2 columns, but has one name"),
        ("qpos/knee +", UsageError, "found the end"),
        ("mean(qpos/knee)", UsageError, "over all rows"),
        (" ", UsageError, "y"),
    ],
)
def test_what_names_nothing_is_refused(text: str, kind: type, message: str) -> None:
    with pytest.raises(kind, match=message):
        parse_panel(text, COLUMNS)


def test_x_is_written_as_a_curve() -> None:
    (x,) = parse_curves("t [ms]=time*1000", COLUMNS, "x")
    assert (x.name, x.unit, x.column, x.expression.columns) == ("t", "ms", None, ("time",))


@pytest.mark.parametrize(
    ("text", "mark"),
    [
        ("m·g=87.356", ReferenceLine("m·g", 87.356)),
        ("2:0.50", ReferenceLine("0.50", 0.5, panel=2)),
        ("2:m·g = -1e3", ReferenceLine("m·g", -1000, panel=2)),
        ("x:impact=0.52", ReferenceLine("impact", 0.52, vertical=True)),
        ("a=b=3", ReferenceLine("a=b", 3)),
        ("7", ReferenceLine("7", 7)),
    ],
)
def test_a_mark_is_a_label_and_a_number(text: str, mark: ReferenceLine) -> None:
    assert parse_reference_line(text) == mark


@pytest.mark.parametrize("text", ["m·g", "a=", "a=nan", "x:a=b", "=inf"])
def test_a_mark_without_a_number_is_refused(text: str) -> None:
    with pytest.raises(BadValueError, match=r"mark: .* is not a NUMBER or LABEL=NUMBER"):
        parse_reference_line(text)


def test_axes_are_logarithmic_for_all_panels_or_one() -> None:
    assert parse_log([], 3) == (False, frozenset())
    assert parse_log(["x"], 3) == (True, frozenset())
    assert parse_log(["y"], 3) == (False, {0, 1, 2})
    assert parse_log(["both"], 2) == (True, {0, 1})
    assert parse_log(["2:y", "x"], 3) == (True, {1})
    with pytest.raises(BadValueError, match="log: 'z' is not x, y, both"):
        parse_log(["z"], 1)
    with pytest.raises(UsageError, match="log: panel 4 does not exist; the last is 3"):
        parse_log(["4:y"], 3)


def test_panels_are_counted_from_one() -> None:
    assert panel_index(3, 3, "mark") == 2


KNEE = {"qpos/knee": np.array([-1.0, 0.5, 0.5, 2.0]), "contact/a/b": np.array([0.0, 2.0, 1.0, 0.0])}


@pytest.mark.parametrize("label", ["", "high=", "high [m]=", "high (max) =", "high! = ", "P: "])
@pytest.mark.parametrize(
    ("operator", "holds"), [(">=", [0, 1, 1, 1]), ("<=", [1, 1, 1, 0]), ("==", [0, 1, 1, 0]), ("!=", [1, 0, 0, 1])]
)
def test_comparisons_in_curves_are_not_labels(label: str, operator: str, holds: list[int]) -> None:
    text = f"where(qpos/knee {operator} 0.5, 1, 0)"
    (curve,) = parse_panel(label + text, list(KNEE)).curves
    assert curve.name == (label.split("=")[0].removesuffix(" [m]").strip() if "=" in label else text)
    assert curve.expression.values(KNEE).tolist() == holds


@pytest.mark.parametrize("operator", [">=", "<=", "==", "!="])
def test_a_comparison_is_not_a_curve(operator: str) -> None:
    with pytest.raises(UsageError, match="found a comparison, expected a number"):
        parse_panel(f"qpos/knee {operator} 0.5", list(KNEE))


@pytest.mark.parametrize("name", ["q?", "a/*b", "st*r", "a*/b", "*", "it's?", "a, b?", "k=v?", "T: q?"])
def test_a_column_in_quotes_is_not_a_wildcard(name: str) -> None:
    quoted = "'" + name.replace("'", "''") + "'"
    for text, factor in ((quoted, 1), (f"L={quoted}", 1), (f"{quoted}*2", 2), (f"2*{quoted}", 2)):
        (curve,) = parse_panel(text, ["time", name]).curves
        assert curve.expression.values({"time": np.zeros(1), name: np.array([3.0])}).tolist() == [3 * factor]


def test_curves_refer_to_columns_by_group_and_object_as_events_do() -> None:
    (curve,) = parse_panel("2*contact(a, b) - qpos(knee)", list(KNEE)).curves
    assert curve.expression.values(KNEE).tolist() == [1.0, 3.5, 1.5, -2.0]


def test_a_unit_stands_in_brackets_at_the_end() -> None:
    assert split_unit("depth [mm]") == ("depth", "mm")
    assert split_unit("a[0] b") == ("a[0] b", None)
    assert split_unit("[m]") == ("[m]", None)
