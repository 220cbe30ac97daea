"""Panels by group and unit, and their titles."""

from pathlib import Path

import pytest

from mjrun.outputs.trace import columns
from mjrun.plotting.panel import CURVES, chosen_panels, panels_by_unit, time_column, with_units
from mjrun.simulation.simulation import Simulation

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


def test_columns_without_groups_are_told_apart_by_unit() -> None:
    units = {"a": "", "b": "", "force [N]": "N"}
    assert shown(panels_by_unit(list(units), units)) == [("", ["a", "b"]), ("force [N]", ["force [N]"])]


def test_a_chosen_panel_is_one_whatever_its_units() -> None:
    (panel,) = chosen_panels(["qpos"], UNITS)
    assert panel.label == "qpos"
    assert [c.name for c in panel.curves] == ["root/x [m]", "root/y [m]", "root/qw", "knee [rad]", "hip [rad]"]


@pytest.mark.parametrize(
    ("text", "label"),
    [
        ("energy/total", "energy/total [J]"),
        ("knee [°]=qpos/knee*180/pi", "knee [°]"),
        ("legs: qpos/knee, qpos/hip", "legs [rad]"),
        ("legs [deg]: qpos/knee*57.3, qpos/hip*57.3", "legs [deg]"),
        ("only: energy/total", "only [J]"),
        ("qpos/knee * 2", "qpos/knee * 2"),
    ],
)
def test_a_chosen_panel_has_the_label_that_its_text_says(text: str, label: str) -> None:
    (panel,) = chosen_panels([text], UNITS)
    assert panel.label == label


@pytest.mark.parametrize(
    ("names", "time"),
    [
        (["a", "time"], "time"),
        (["Time", "a"], "Time"),
        (["t [ms]", "a"], "t [ms]"),
        (["T", "time"], "time"),
        (["a"], None),
    ],
)
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
    names = ["time", "time [ms]", "energy/total", "force [N]", "a"]
    assert with_units(names, {"energy/total": "kJ"}) == {
        "time": "s",
        "time [ms]": "ms",
        "energy/total": "kJ",
        "force [N]": "N",
        "a": "",
    }


def test_the_time_of_another_program_may_be_in_anything() -> None:
    assert with_units(["time", "force"], {}) == {"time": "", "force": ""}
