"""Tables are called by what differs in their names."""

import json
from pathlib import Path

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


def test_files_of_points_are_called_by_the_values_in_which_they_differ(tmp_path: Path) -> None:
    paths = []
    for index, step in enumerate(["0.01", "0.02"]):
        folder = tmp_path / f"{index:06}"
        folder.mkdir()
        (folder / "point.json").write_text(json.dumps({"values": {"opt.timestep": step, "seed": "1"}}))
        paths.append(str(folder / "trace.parquet"))
    assert table_names(paths) == ["timestep 0.01", "timestep 0.02"]
    assert table_names([*paths, "other/trace.parquet"])[2] == "other"
