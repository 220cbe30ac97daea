"""Units that are told by names are those that mjrun's own tables hold."""

from pathlib import Path

import pytest

from mjrun.outputs.trace import columns
from mjrun.plotting.column_units import with_units
from mjrun.simulation.simulation import Simulation

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
