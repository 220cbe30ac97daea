"""Tables are called by what differs in their names."""

import pytest

from mjrun.plotting.table_names import table_names


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
